"""Sequential allocation of trials, to test with few trials whether variations are solved less often than their twins.

A question is whether one condition (a variation) is solved less often than its twin (a training condition) on the same
seeds. In each round, all open questions get the same additional seeds. After every round, questions with a verdict get
no more trials. The choice of trials depends only on the outcomes, so replaying the rounds shows which trials have been
run and which come next.

The drop in a question is the twin's rate minus the condition's rate. Two null hypotheses are tested on the pairs by
:mod:`~betterbench.statistics.betting`: "the drop is at most 0" and "the drop is at least the margin". At most one of
them is true. Over all questions, each of the two families of hypotheses is corrected by
:func:`~betterbench.statistics.multiplicity.e_benjamini_hochberg`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache

from betterbench.errors import InvalidInputError
from betterbench.statistics.betting import SIGNED, evidence_above, evidence_below
from betterbench.statistics.interval import check_fraction
from betterbench.statistics.multiplicity import e_benjamini_hochberg
from betterbench.statistics.power import DEFAULT_ALPHA

DROP_MARGIN = 0.5
"""Size of the drop that a "no drop" verdict excludes.

It matches the power matrix, in which a policy fails a variation if it fails half of the trials. A smaller margin needs
more trials: if no pair differs, a margin of 50 points takes 5 pairs and a margin of 20 points takes 15.
"""

FIRST_PAIRS = 5
"""Number of pairs in the first round. It is the smallest number that allows a verdict if all pairs agree."""

TWIN_SHARE = 0.5
"""Minimum fraction of pairs in which the training twin must succeed.

If the twin succeeds less often, a drop by the margin can hardly be detected.
"""


class Verdict(StrEnum):
    """Verdict on a question."""

    DROP = "drop"
    """The condition is solved less often than its twin (the training condition on the same seeds)."""
    NO_DROP = "no_drop"
    """The drop of the condition's rate against the twin's rate is smaller than the margin."""
    NOT_LEARNED = "not_learned"
    """No drop was found, but the training twin fails in most pairs, so a drop could hardly be detected."""
    OPEN = "open"
    """The evidence is not yet sufficient for a verdict."""

    @property
    def words(self) -> str:
        """The verdict in words, such as "no drop"."""
        return self.value.replace("_", " ")


@dataclass(frozen=True, slots=True)
class StoppingRule:
    """Rule by which questions are decided.

    Attributes:
        level: Bound on the expected fraction of wrong verdicts, separately for "drop" and for "no drop" verdicts.
        margin: Size of the drop that a "no drop" verdict excludes, as a fraction.
        first: Number of pairs in the first round. Every further round adds one pair.
    """

    level: float = DEFAULT_ALPHA
    margin: float = DROP_MARGIN
    first: int = FIRST_PAIRS

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the level, the margin or the first round is out of range."""
        check_fraction("level", self.level)
        check_fraction("margin", self.margin)
        if self.first < 1:
            raise InvalidInputError("first", f"{self.first} is out of range", "Use a number ≥ 1")


@dataclass(frozen=True, slots=True)
class Question:
    """Question of whether a condition is solved less often than its training twin. Both are given by name."""

    condition: str
    twin: str


@dataclass(frozen=True, slots=True)
class Answer:
    """Current answer to a question: its verdict, its counts and its evidence.

    Attributes:
        pairs: Number of pairs in the complete rounds during which the question was open.
        solved: Number of pairs in which the condition was solved.
        twin_solved: Number of pairs in which its twin was solved.
        drop: Evidence against "the drop is at most 0" (e-value).
        no_drop: Evidence against "the drop is at least the margin" (e-value).
    """

    question: Question
    verdict: Verdict = Verdict.OPEN
    pairs: int = 0
    solved: int = 0
    twin_solved: int = 0
    drop: float = 1.0
    no_drop: float = 1.0

    @property
    def decided(self) -> bool:
        """Whether the question has a verdict and gets no more trials."""
        return self.verdict is not Verdict.OPEN


@dataclass(frozen=True, slots=True)
class Decisions:
    """State of all questions after the last complete round.

    Attributes:
        answers: One answer per question, in the order of the questions.
        waiting: Condition and seed of each trial of the current round that has no outcome yet, including twins. Empty
            when all questions have been decided or all seeds have been used.
    """

    answers: tuple[Answer, ...]
    waiting: tuple[tuple[str, int], ...]

    @property
    def decided(self) -> int:
        """Number of questions that are decided."""
        return sum(a.decided for a in self.answers)

    def count(self, verdict: Verdict) -> int:
        """Return the number of questions with the given verdict."""
        return sum(a.verdict is verdict for a in self.answers)


Outcomes = Callable[[str, int], bool | None]
"""Function that returns whether a condition was solved with a seed, or None if this is not known."""


def decide(
    questions: Sequence[Question],
    seeds: Sequence[int],
    outcome: Outcomes,
    *,
    rule: StoppingRule,
    unasked: Sequence[str] = (),
) -> Decisions:
    """Replay the rounds of the questions up to the last known outcome.

    Args:
        questions: The questions, each about a different condition. Several questions may share the trials of one twin.
        seeds: Seeds in the order in which they are run. Their number is the maximum number of pairs per question.
        outcome: Function that returns the known outcomes of trials.
        rule: Rule by which questions are decided.
        unasked: Conditions without a question, which are run only in the first round.
    """
    answers = [Answer(q) for q in questions]
    done = 0
    while done < len(seeds) and not (all(a.decided for a in answers) and (done or not unasked)):
        until = min(len(seeds), max(rule.first, done + 1))
        asked = [a.question for a in answers if not a.decided]
        names = dict.fromkeys(name for q in asked for name in (q.condition, q.twin))
        if not done:
            names |= dict.fromkeys(unasked)
        waiting = tuple((n, s) for n in names for s in seeds[done:until] if outcome(n, s) is None)
        if waiting:
            return Decisions(tuple(answers), waiting)
        done = until
        answers = [a if a.decided else _answer(a.question, seeds[:done], outcome, rule) for a in answers]
        answers = _judged(answers, rule)
    return Decisions(tuple(answers), ())


def _answer(question: Question, seeds: Sequence[int], outcome: Outcomes, rule: StoppingRule) -> Answer:
    pairs = [(bool(outcome(question.twin, s)), bool(outcome(question.condition, s))) for s in seeds]
    lost, won = pairs.count((True, False)), pairs.count((False, True))
    solved, twin_solved = (sum(side) for side in zip(*((condition, twin) for twin, condition in pairs), strict=True))
    evidence = _evidence(lost, len(pairs) - lost - won, won, rule.margin)
    return Answer(question, Verdict.OPEN, len(pairs), solved, twin_solved, *evidence)


@lru_cache(maxsize=4096)
def _evidence(lost: int, kept: int, won: int, margin: float) -> tuple[float, float]:
    """Return the evidence for a drop and the evidence for no drop.

    Args:
        lost: Number of pairs in which only the twin succeeded.
        kept: Number of pairs with equal outcomes.
        won: Number of pairs in which only the condition succeeded.
        margin: Drop that "no drop" excludes, as a fraction.
    """
    values = [1.0] * lost + [0.0] * kept + [-1.0] * won
    return evidence_above(values, 0.0, span=SIGNED), evidence_below(values, margin, span=SIGNED)


def _judged(answers: Sequence[Answer], rule: StoppingRule) -> list[Answer]:
    """Update the verdicts of the open questions. Questions that are decided keep their verdicts."""
    judged = list(answers)
    for family in ((Verdict.DROP,), (Verdict.NO_DROP, Verdict.NOT_LEARNED)):
        eligible = [i for i, a in enumerate(judged) if not a.decided or a.verdict in family]
        evidence = [judged[i].drop if Verdict.DROP in family else judged[i].no_drop for i in eligible]
        for place in e_benjamini_hochberg(evidence, level=rule.level, hypotheses=len(answers)):
            answer = judged[eligible[place]]
            if not answer.decided:
                judged[eligible[place]] = replace(answer, verdict=_named(answer, family))
    return judged


def _named(answer: Answer, family: tuple[Verdict, ...]) -> Verdict:
    learned = answer.twin_solved >= TWIN_SHARE * answer.pairs
    return family[0] if len(family) == 1 or learned else family[1]
