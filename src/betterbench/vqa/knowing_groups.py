"""Paired tests of a model's knowledge against the policy's actions, by axis, variation and failure mode.

The unit is a trial. The model counts as knowing the decision in a trial only if it answers all deciding questions about
the trial correctly. In each group, the fraction of trials where the model knew the decision is compared with the
policy's success rate in the same trials.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any, Literal, Protocol

from betterbench.statistics import (
    Difference,
    PairedTable,
    Rate,
    guessing_p,
    holm,
    mcnemar_p,
    newcombe_paired_difference,
)
from betterbench.tasks import Axis

GroupKind = Literal["all", "axis", "variation", "label"]
TRAINING = "training"
"""Name of the group of trials on training conditions."""


class GroupVerdict(StrEnum):
    """Result of the tests for one group of trials. They compare the model's knowledge with the policy's actions."""

    KNOWS_MORE = "knows more than it does"
    DOES_MORE = "does more than it knows"
    OPEN = "not decided"


class AskedTrial(Protocol):
    """Knowledge of a model about one trial, with the outcome of the trial.

    See :class:`~betterbench.vqa.knowing.TrialKnowledge`.
    """

    @property
    def task(self) -> str:
        """Name of the task."""

    @property
    def variation(self) -> str | None:
        """Name of the variation, or None for a training condition."""

    @property
    def axis(self) -> str | None:
        """Variation axis, or None."""

    @property
    def label(self) -> str:
        """Outcome label of the diagnosis."""

    @property
    def success(self) -> bool:
        """Whether the trial succeeded."""

    @property
    def chance(self) -> float:
        """Probability of knowing the right decision without seeing the image."""

    @property
    def is_known(self) -> bool | None:
        """Whether the model knew the decision, or None if it did not answer the deciding questions."""


@dataclass(frozen=True, slots=True)
class GroupKnowledge:
    """Comparison of knowledge and action in the trials of one group.

    Attributes:
        kind: Kind of the group.
        name: "all", an axis or "training", "TASK/VARIATION" or "TASK/training", or a label.
        trials: Number of trials, with or without answers.
        knows: Fraction of trials where the model knew the decision, among the trials with answers.
        does: Fraction of trials that the policy solved, among the trials with answers.
        expected: Expected number of trials where a model that does not see the image knows the decision.
        failed: Number of failed trials with answers.
        known_failures: Number of these failed trials where the model knew the decision.
        expected_failures: Expected number of these failed trials where a model that does not see the image knows the
            decision.
        difference: The fraction ``knows`` minus the fraction ``does``, with Newcombe's interval for paired data.
        p_paired: Two-sided p-value of McNemar's exact test. It compares the trials where the model knew the decision
            with the solved trials.
        p_guessing: One-sided exact p-value: the probability of at least as many known failures if the answers were
            guessed.
        p: p-value of the group's claim. The claim that the model knows more than the policy does requires both tests,
            so that ``p`` is the larger of the two p-values. For the opposite claim, ``p`` is ``p_paired``.
        adjusted: ``p`` after Holm's correction over all groups with answers.
        verdict: The claim, if ``adjusted`` is below the significance level.
    """

    kind: GroupKind
    name: str
    trials: int
    knows: Rate
    does: Rate
    expected: float
    failed: int
    known_failures: int
    expected_failures: float
    difference: Difference
    p_paired: float
    p_guessing: float
    p: float
    adjusted: float = 1.0
    verdict: GroupVerdict = GroupVerdict.OPEN

    @property
    def corrected(self) -> float | None:
        """Fraction of trials where the model knew the decision, corrected for guessing.

        The value is (knows - chance) / (1 - chance), or None if there are no answers.
        """
        n = self.knows.n
        if not n or self.expected >= n:
            return None
        return (self.knows.k - self.expected) / (n - self.expected)

    @property
    def sentence(self) -> str:
        """Verdict in one sentence."""
        points = 100.0 * (self.difference.value or 0.0)
        return (
            f"{self.name}: it knows {self.knows.k}/{self.knows.n} and does {self.does.k}/{self.does.n}, a difference "
            f"of {points:+.0f} points ({self.difference.low_pp:+.0f} to {self.difference.high_pp:+.0f}). Verdict: "
            f"{self.verdict.value}."
        )

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        rates = {name: rate.to_json() for name, rate in (("knows", self.knows), ("does", self.does))}
        told = {"difference": self.difference.to_json(), "corrected": self.corrected, "sentence": self.sentence}
        return {**asdict(self), **rates, **told}


def group_knowledge(trials: Sequence[AskedTrial], *, alpha: float = 0.05) -> tuple[GroupKnowledge, ...]:
    """Compare knowledge and action in groups of a policy's trials: all trials, axes, variations and failure modes.

    Args:
        trials: Knowledge of the model about each trial.
        alpha: Significance level of the tests of all groups together.
    """
    found = [_group(kind, name, members) for kind, name, members in _members(trials)]
    tested = [group for group in found if group.knows.n]
    adjusted = dict(zip(map(id, tested), holm([group.p for group in tested]), strict=True))
    return tuple(_judged(group, adjusted.get(id(group), 1.0), alpha) for group in found)


def _members(trials: Sequence[AskedTrial]) -> Iterable[tuple[GroupKind, str, list[AskedTrial]]]:
    yield "all", "all", list(trials)
    for axis in (None, *(a.value for a in Axis)):
        if members := [t for t in trials if t.axis == axis and (axis is not None or t.variation is None)]:
            yield "axis", axis or TRAINING, members
    names = dict.fromkeys((t.task, t.variation or TRAINING) for t in trials)
    several = len({task for task, _ in names}) > 1
    for task, name in sorted(names, key=lambda pair: (pair[0], pair[1] != TRAINING, pair[1])):
        if name == TRAINING and not several:
            continue  # the group of the training axis already covers these trials
        yield "variation", f"{task}/{name}", [t for t in trials if (t.task, t.variation or TRAINING) == (task, name)]
    for label in sorted({t.label for t in trials if not t.success}):
        yield "label", label, [t for t in trials if t.label == label]


def _group(kind: GroupKind, name: str, members: Sequence[AskedTrial]) -> GroupKnowledge:
    asked = [t for t in members if t.is_known is not None]
    table = PairedTable.from_outcomes((bool(t.is_known), t.success) for t in asked)
    failed = [t for t in asked if not t.success]
    chances = [t.chance for t in failed]
    difference = newcombe_paired_difference(table)
    p_paired, p_guessing = mcnemar_p(table), guessing_p(table.only_first, chances)
    return GroupKnowledge(
        kind=kind,
        name=name,
        trials=len(members),
        knows=Rate(table.both + table.only_first, len(asked)),
        does=Rate(table.both + table.only_second, len(asked)),
        expected=sum(t.chance for t in asked),
        failed=len(failed),
        known_failures=table.only_first,
        expected_failures=sum(chances),
        difference=difference,
        p_paired=p_paired,
        p_guessing=p_guessing,
        p=max(p_paired, p_guessing) if (difference.value or 0.0) > 0.0 else p_paired,
    )


def _judged(group: GroupKnowledge, adjusted: float, alpha: float) -> GroupKnowledge:
    verdict = GroupVerdict.OPEN
    if adjusted < alpha:
        verdict = GroupVerdict.KNOWS_MORE if (group.difference.value or 0.0) > 0.0 else GroupVerdict.DOES_MORE
    return replace(group, adjusted=adjusted, verdict=verdict)
