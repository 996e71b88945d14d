"""Dataset card of a training set: a README.md with statistics, pictures, shortcuts, and the command to reproduce it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from betterbench.demonstrations.making.variety import TaskVariety, variety_lines
from betterbench.demonstrations.sets.numbers import ConditionCounts, SetNumbers
from betterbench.demonstrations.sets.pairs import pairs_by_task
from betterbench.demonstrations.sets.recipe import SetRecipe
from betterbench.demonstrations.shortcuts.examine import ShortcutAudit
from betterbench.demonstrations.shortcuts.page import audit_lines, doubt, prediction_lines
from betterbench.demonstrations.shortcuts.prediction import Prediction
from betterbench.quoting import markdown_address, markdown_table, markdown_text
from betterbench.records.twins import TwinPair
from betterbench.tasks.interventions.listed_regimes import crossed_in

MOST_FORECASTS = 15
PROVEN = (
    "The states of each demonstration were checked. It starts in a condition of this regime and follows the "
    "instruction in order. It handles objects only where certified demonstrations do, and does not show a test "
    "condition of another regime."
)
RANGES = (
    "Ranges over the training frames. `statistics.json` contains mean, standard deviation and quantiles of actions "
    "and states."
)
ABOUT_REGIME = {
    "training": "The training conditions of each task with their confounds: associated words, slots and orders.",
    "balanced": (
        "The control arm: the same number of demonstrations of the same skills (at least one of each condition), in "
        "conditions that vary words, slots, orders and objects independently and include no test condition."
    ),
    "diverse-confounded": (
        "The control arm for diversity: the same number of conditions, layouts and additional objects as the "
        "balanced regime, but each word always refers to the same slot."
    ),
    "covered": (
        "The test conditions themselves, to measure which tests can be learned at all. Success on them is not "
        "generalization. Do not test a policy trained on this set with the same variations."
    ),
}


@dataclass(frozen=True, slots=True)
class CardFacts:
    """Content of a dataset card apart from the recipe.

    Attributes:
        sheets: For each task, the path of its picture relative to the card, or the reason why there is none.
        variety: Variety of the demonstrations of each task.
        sources: Variety of the source demonstrations of each task.
    """

    sha256: str
    command: str
    counts: Sequence[ConditionCounts]
    numbers: SetNumbers
    audit: ShortcutAudit | None
    prediction: Prediction | None
    pairs: Sequence[TwinPair]
    sheets: Mapping[str, str]
    variety: Sequence[TaskVariety]
    sources: Sequence[TaskVariety]


def dataset_card(recipe: SetRecipe, facts: CardFacts) -> str:
    """Return the dataset card of a training set as Markdown."""
    total = sum(c.demonstrations for c in facts.counts)
    held_out = sum(c.validation for c in facts.counts)
    given = ", ".join(f"{count} {markdown_text(kind)}" for kind, count in facts.numbers.demonstrators.items())
    counted = (
        f"{total} demonstrations ({given}) with {facts.numbers.steps} steps; {total - held_out} are for training and "
        f"{held_out} for validation, by seed (`split.json`)."
    )
    lines = [
        f"# Demonstrations of {len(recipe.tasks)} BeTTER task{'s'[: len(recipe.tasks) - 1]}: {recipe.regime}",
        "",
        ABOUT_REGIME[recipe.regime],
        "",
        counted,
        "",
        PROVEN,
        "",
        f"Hash of the set: `{facts.sha256}`. This command reproduces the set and compares the hash:",
        "",
        "```sh",
        facts.command,
        "```",
        "",
        "## Conditions",
        "",
        *markdown_table(
            ("task", "condition", "demonstrations", "for validation", "steps", "instruction"), _rows(facts.counts)
        ),
        "",
        "## Actions",
        "",
        RANGES,
        "",
        *markdown_table(("number", "least", "1 %", "99 %", "most"), _ranges(facts.numbers)),
        "",
        *variety_lines(facts.variety, facts.sources),
        *_task_lines(recipe, facts),
        *_shortcut_lines(facts),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _rows(counts: Iterable[ConditionCounts]) -> Iterator[tuple[str, ...]]:
    for c in counts:
        steps = f"{c.steps_min} to {c.steps_max}, median {c.steps_median}"
        cells = (c.task, c.condition, c.demonstrations, c.validation, steps, c.instruction)
        yield tuple(map(markdown_text, cells))


def _ranges(numbers: SetNumbers) -> Iterator[tuple[str, ...]]:
    stats = numbers.statistics()["action"]
    for i, name in enumerate(numbers.components):
        yield markdown_text(name), *(f"{stats[key][i]:.3f}" for key in ("min", "q01", "q99", "max"))


def _task_lines(recipe: SetRecipe, facts: CardFacts) -> Iterator[str]:
    """Yield the lines of one section per task: picture, factors that vary independently, and number of pairs of twins.

    Twins are demonstrations with the same initial state and different instructions.
    """
    pairs = pairs_by_task(facts.pairs)
    for task in recipe.tasks:
        yield from ("", f"## {markdown_text(task)}", "")
        file = facts.sheets.get(task, "none: not requested")
        shown = (
            f"![Starts of {markdown_text(task)}]({markdown_address(file)})"
            if file.endswith(".jpg")
            else f"No picture ({markdown_text(file.removeprefix('none: '))})"
        )
        yield shown
        if lines := crossed_in(recipe.regime, task):
            yield from ("", "Crossed:", "", *(f"- {markdown_text(line)}" for line in lines))
        if recipe.pairs:
            found = pairs.get(task, [])
            rows = sorted(p.shared_rows for p in found)
            middle = f", which share {rows[0]} to {rows[-1]} rows, {rows[len(rows) // 2]} in the median" if rows else ""
            yield from ("", f"{len(found)} pairs of twins{middle}.")


def _shortcut_lines(facts: CardFacts) -> Iterator[str]:
    if facts.audit is None or facts.prediction is None:
        yield from ("", "## Shortcuts", "", "There are too few demonstrations for an audit.")
        return
    yield from ("", "## Shortcuts", "", *audit_lines(facts.audit))
    yield from (
        "## Prediction",
        "",
        "Variations that a learner trained on this set is predicted to fail:",
        "",
    )
    if unsure := doubt(facts.audit, facts.prediction):
        yield from (f"{unsure}.", "")
    yield from prediction_lines(facts.prediction, most=MOST_FORECASTS)
    rest = len(facts.prediction.variations) - MOST_FORECASTS
    if rest > 0:
        yield from ("", f"`prediction.json` has all {len(facts.prediction.variations)}, with its hash.")
