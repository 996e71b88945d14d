"""Table that compares a model's knowledge with a policy's actions, for the report page."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.statistics import Rate
from betterbench.statistics.wording import counted
from betterbench.tasks.labels import Label, all_labels
from betterbench.vqa.knowing import Knowledge, KnowledgeStanding, LabelKnowledge
from betterbench.vqa.knowing_groups import GroupKnowledge, GroupVerdict

COLUMNS = {
    KnowledgeStanding.KNOWS_AND_DOES: "knows and does",
    KnowledgeStanding.KNOWS_AND_DOES_NOT: "knows and does not",
    KnowledgeStanding.DOES_NOT_KNOW: "does not know",
    KnowledgeStanding.DOES_WITHOUT_KNOWING: "does without knowing",
    KnowledgeStanding.NOT_ASKED: "not asked",
}
"""Columns of the table in order, with their titles."""


@dataclass(frozen=True, slots=True)
class KnowledgeRow:
    """Row of the table for all trials with one outcome label."""

    label: Label | str
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class GroupRow:
    """Row of the table for one group of trials.

    Attributes:
        kind: Kind of the group. It is the heading of a part of the table.
        name: Name of the group, or the label of its trials.
        cells: Texts of the other columns.
        is_supported: Whether the finding about the group is statistically significant.
    """

    kind: str
    name: Label | str
    cells: tuple[str, ...]
    is_supported: bool


@dataclass(frozen=True, slots=True)
class KnowledgeView:
    """Comparison of one model's knowledge with one policy's actions.

    Attributes:
        roles: Phrases that state how many answers were correct, one for each role that a question can have.
        known_failures: Keys of the failed trials in which the model knew the right decision.
        groups: Knowledge and behavior by axis, variation and failure mode.
        tested: Number of groups that were tested. Holm's correction is based on this number.
    """

    model: str
    policy: str
    sentence: str
    columns: tuple[str, ...]
    rows: tuple[KnowledgeRow, ...]
    roles: tuple[str, ...]
    known_failures: tuple[str, ...]
    group_columns: tuple[str, ...] = ()
    groups: tuple[GroupRow, ...] = ()
    tested: int = 0


def knowledge_view(known: Knowledge) -> KnowledgeView:
    """Prepare the comparison of a model's knowledge with a policy's behavior for the page."""
    failures = tuple(t.key for t in known.trials if t.standing is KnowledgeStanding.KNOWS_AND_DOES_NOT)
    return KnowledgeView(
        known.model,
        known.policy,
        known.sentence,
        ("trials", "knows", "without image", *COLUMNS.values()),
        tuple(_row(entry) for entry in known.labels),
        tuple(f"{role} {counted(rate)}" for role, rate in known.roles.items()),
        failures,
        ("knows", "guessed", "does", "knows − does, points", "failed, knows", "p, Holm", "finding"),
        tuple(_group_row(group) for group in known.groups),
        sum(group.knows.n > 0 for group in known.groups),
    )


def _row(entry: LabelKnowledge) -> KnowledgeRow:
    labels = {label.value: label for label in all_labels()}
    counts = (str(entry.counts[standing.value]) for standing in COLUMNS)
    cells = (str(entry.n), _knows(entry.knows), f"{100 * entry.chance:.1f} %", *counts)
    return KnowledgeRow(labels.get(entry.label, entry.label), cells)


_KINDS = {"all": "All trials", "axis": "By axis", "variation": "By variation", "label": "Failures by label"}


def _group_row(group: GroupKnowledge) -> GroupRow:
    labels = {label.value: label for label in all_labels()}
    shown = group.name.replace("_", " ") if group.kind == "axis" else group.name
    name = labels.get(group.name, group.name) if group.kind == "label" else shown
    if not group.knows.n:
        return GroupRow(_KINDS[group.kind], name, ("–", "–", "–", "–", "–", "–", "not asked"), is_supported=False)
    gap = group.difference
    cells = (
        _knows(group.knows),
        f"{group.expected:.1f}",
        _knows(group.does),
        f"{100 * (gap.value or 0.0):+.0f} ({gap.low_pp:+.0f} to {gap.high_pp:+.0f})".replace("-", "−"),
        f"{group.known_failures}/{group.failed} (guessed {group.expected_failures:.1f})",
        f"{group.adjusted:.2g}",
        group.verdict.value,
    )
    return GroupRow(_KINDS[group.kind], name, cells, is_supported=group.verdict is not GroupVerdict.OPEN)


def _knows(rate: Rate) -> str:
    if not rate.n:
        return "–"
    return f"{rate.k}/{rate.n} ({100 * rate.low:.0f} to {100 * rate.high:.0f} %)"
