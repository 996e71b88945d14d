"""Table of a model's knowledge next to a policy's behavior, for the report page."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.statistics import Rate
from betterbench.statistics.wording import counted
from betterbench.tasks.labels import Label, all_labels
from betterbench.vqa.knowing import Knowledge, KnowledgeStanding, LabelKnowledge

COLUMNS = {
    KnowledgeStanding.KNOWS_AND_DOES: "knows and does",
    KnowledgeStanding.KNOWS_AND_DOES_NOT: "knows and does not",
    KnowledgeStanding.DOES_NOT_KNOW: "does not know",
    KnowledgeStanding.DOES_WITHOUT_KNOWING: "does without knowing",
    KnowledgeStanding.NOT_ASKED: "not asked",
}
"""Columns of the table, in order, with their titles."""


@dataclass(frozen=True, slots=True)
class KnowledgeRow:
    """Row of the table for one outcome label."""

    label: Label | str
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class KnowledgeView:
    """The table of one policy and one model.

    Attributes:
        roles: Correct answers by role of the question, one phrase each.
        known_failures: Keys of the failed trials whose right decision the model knew.
    """

    model: str
    policy: str
    sentence: str
    columns: tuple[str, ...]
    rows: tuple[KnowledgeRow, ...]
    roles: tuple[str, ...]
    known_failures: tuple[str, ...]


def knowledge_view(known: Knowledge) -> KnowledgeView:
    """Return the view of a model's knowledge for the page."""
    failures = tuple(t.key for t in known.trials if t.standing is KnowledgeStanding.KNOWS_AND_DOES_NOT)
    return KnowledgeView(
        known.model,
        known.policy,
        known.sentence,
        ("trials", "knows", "without image", *COLUMNS.values()),
        tuple(_row(entry) for entry in known.labels),
        tuple(f"{role} {counted(rate)}" for role, rate in known.roles.items()),
        failures,
    )


def _row(entry: LabelKnowledge) -> KnowledgeRow:
    labels = {label.value: label for label in all_labels()}
    counts = (str(entry.counts[standing.value]) for standing in COLUMNS)
    cells = (str(entry.n), _knows(entry.knows), f"{100 * entry.chance:.1f} %", *counts)
    return KnowledgeRow(labels.get(entry.label, entry.label), cells)


def _knows(rate: Rate) -> str:
    if not rate.n:
        return "–"
    return f"{rate.k}/{rate.n} ({100 * rate.low:.0f} to {100 * rate.high:.0f} %)"
