"""Functions that print question sets, scores, and a comparison of a model's knowledge with a policy's behavior."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from betterbench.cli.console import OUT, print_table
from betterbench.statistics import Difference, Rate, percent
from betterbench.vqa.asking import Score
from betterbench.vqa.blind import TARGET_POINTS
from betterbench.vqa.dataset import QuestionSet
from betterbench.vqa.knowing import Knowledge, KnowledgeStanding

if TYPE_CHECKING:
    from betterbench.learning.training.own_answers import OwnAnswers


def print_set(made: QuestionSet) -> None:
    """Print the number of questions of each type in a set, and the accuracy that can be reached without the images."""
    images = len({q.image for q in made.questions})
    title = f"{len(made.questions)} questions about {images} images, for {made.purpose}"
    rows = [
        [
            b.name,
            str(b.n),
            f"{100 * b.chance:.1f}",
            percent_of(b.majority, b.n),
            percent_of(b.blind, b.n),
            f"{b.excess_points:+.1f}",
        ]
        for b in made.baselines
    ]
    columns = ["type", "questions", "chance %", "majority %", "blind %", "blind − chance"]
    print_table(columns, rows, title=title)
    over = [b.name for b in made.baselines if not b.is_balanced]
    if over:
        text = (
            f"Without images, guesses are more than {TARGET_POINTS:g} points better than chance on: {', '.join(over)}."
        )
        OUT.print(f"{text} More trials, variations and cameras balance the set better.", markup=False)


def print_scores(scores: Sequence[Score]) -> None:
    """Print the scores of a model for each type of question."""
    rows = [
        [
            s.name,
            f"{s.rate.k}/{s.rate.n}",
            percent_of(s.rate.k, s.rate.n),
            interval(s.rate),
            f"{100 * s.chance:.1f}",
            f"{100 * s.blind:.1f}",
            f"{s.read}/{s.rate.n}",
        ]
        for s in scores
    ]
    print_table(["part", "right", "%", "95 % interval", "chance %", "blind %", "readable"], rows, title="answers")


def print_knowledge(known: Knowledge) -> None:
    """Print the agreement between a model's answers and a policy's behavior, by label."""
    columns = ["label", "trials", "knows", "without image", *(s.value.replace("_", " ") for s in KnowledgeStanding)]
    rows = [
        [
            x.label,
            str(x.n),
            f"{x.knows.k}/{x.knows.n} ({interval(x.knows)})",
            f"{100 * x.chance:.1f} %",
            *(str(x.counts[s.value]) for s in KnowledgeStanding),
        ]
        for x in known.labels
    ]
    print_table(columns, rows, title=f"knowledge of {known.model} and behavior of {known.policy}")
    OUT.print(known.sentence, markup=False)
    _print_groups(known)
    if not known.is_complete:
        missing = known.asked - known.answered
        OUT.print(
            f"{missing} of {known.asked} questions about this run have no answer. Trials with unanswered questions "
            "are counted as not asked.",
            markup=False,
        )


def _print_groups(known: Knowledge) -> None:
    """Print how often a model knows the correct action, and how often the policy takes this action.

    The counts are grouped by axis, variation and failure mode.
    """
    rows = [
        [
            group.name.replace("_", " "),
            f"{group.knows.k}/{group.knows.n}",
            f"{group.expected:.1f}",
            f"{group.does.k}/{group.does.n}",
            difference_in_points(group.difference) if group.knows.n else "–",
            f"{group.adjusted:.2g}" if group.knows.n else "–",
            group.verdict.value if group.knows.n else "not asked",
        ]
        for group in known.groups
    ]
    if not rows:
        return
    columns = ["trials", "knows", "guessed", "does", "knows − does", "p", "finding"]
    print_table(columns, rows, title="knowing versus doing, on the same trials")
    OUT.print(
        "'Guessed' is the number of right answers that is expected without the image. The model knows more than the "
        "policy does if McNemar's exact test is significant and guessing alone does not explain the failures that "
        "the model knows. p is the larger of the two p-values after Holm's correction over "
        f"{sum(group.knows.n > 0 for group in known.groups)} groups.",
        markup=False,
    )


def difference_in_points(difference: Difference) -> str:
    """Format a difference with its interval in percentage points."""
    if difference.value is None:
        return "–"
    return f"{100 * difference.value:+.0f} ({difference.low_pp:+.0f} to {difference.high_pp:+.0f})"


def print_own_answers(summaries: Sequence[OwnAnswers]) -> None:
    """Print the accuracy of a learner's answers about its own trials, by condition."""
    columns = [
        "condition",
        "right cell",
        "answers nearest to the object",
        "95 % interval",
        "trials with all answers nearest",
    ]
    rows = [
        [
            s.where,
            f"{s.cells.k}/{s.cells.n}",
            f"{s.nearest.k}/{s.nearest.n}",
            interval(s.nearest) if s.nearest.n else "–",
            f"{s.trials.k}/{s.trials.n}",
        ]
        for s in summaries
    ]
    print_table(columns, rows, title="where is the object that the instruction names?")


def percent_of(k: int, n: int) -> str:
    """Format the fraction k / n in percent. Return a dash if n is 0."""
    return str(percent(k, n)) if n else "–"


def interval(rate: Rate) -> str:
    """Format the confidence interval of a rate in percent."""
    return f"{100 * rate.low:.0f} to {100 * rate.high:.0f} %"
