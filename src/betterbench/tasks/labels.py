"""Outcome labels, in a package that both the tasks and the diagnosis can import.

Each label has a file in ``diagnosis/modes`` with its meaning, its rule and its text in reports.
"""

from __future__ import annotations

from enum import StrEnum
from typing import ClassVar

from betterbench.errors import InvalidInputError, UnknownNameError


class Kind(StrEnum):
    """Kind of an outcome label. An unfinished trial is neither a success nor a failure."""

    NONE = "none"
    REASONING = "reasoning"
    EXECUTION = "execution"
    SYSTEM = "system"
    UNFINISHED = "unfinished"


_LABELS: dict[str, Label] = {}


class Label(str):
    """Outcome label of a trial: a string with a kind of outcome. There is exactly one object for each name.

    If several pieces of evidence concern the same moment, the label that comes first in the order of labels is
    assigned. Use :func:`new_label` to create further labels.

    Raises:
        UnknownNameError: If there is no label with this name.
    """

    __slots__ = ("kind",)

    kind: Kind

    SUCCESS: ClassVar[Label]
    CORRECT_FREEZE: ClassVar[Label]
    CORRECT_REFUSAL: ClassVar[Label]
    LEXICAL_KINEMATIC_SHORTCUT: ClassVar[Label]
    VISUAL_LAYOUT_BIAS: ClassVar[Label]
    BEHAVIORAL_INERTIA: ClassVar[Label]
    CAUSAL_CONFUSION: ClassVar[Label]
    SEMANTIC_FEATURE_COLLAPSE: ClassVar[Label]
    ORDER_VIOLATION: ClassVar[Label]
    PHASE_CONFLICT: ClassVar[Label]
    EARLY_HALT: ClassVar[Label]
    WRONG_OBJECT: ClassVar[Label]
    EXECUTION_FAILURE: ClassVar[Label]
    TIMEOUT: ClassVar[Label]
    POLICY_ERROR: ClassVar[Label]
    UNFINISHED: ClassVar[Label]

    def __new__(cls, name: str) -> Label:  # noqa: PYI034 -- one object per name
        """Return the existing label with this name."""
        try:
            return _LABELS[name]
        except KeyError:
            raise UnknownNameError("label", name, _LABELS) from None

    def __reduce__(self) -> tuple[type[Label], tuple[str]]:
        """Return the class and the name with which copying and unpickling find the same label again."""
        return Label, (self.value,)

    @property
    def value(self) -> str:
        """Name of the label as a plain string."""
        return str(self)


def new_label(name: str, kind: Kind, *, after: Label | None = None) -> Label:
    """Create a label. It is placed directly after the label ``after``, or at the end of the order if ``after`` is None.

    Raises:
        InvalidInputError: If there is already a label with this name.
    """
    if name in _LABELS:
        raise InvalidInputError("label", f"there is already a label {name!r}", "Choose a different name")
    label = str.__new__(Label, name)
    label.kind = kind
    ordered = list(_LABELS.values())
    ordered.insert(len(ordered) if after is None else ordered.index(after) + 1, label)
    _LABELS.clear()
    _LABELS.update((known.value, known) for known in ordered)
    return label


def remove_label(label: Label) -> None:
    """Remove a label. This is meant for tests."""
    del _LABELS[label.value]


def all_labels() -> tuple[Label, ...]:
    """Return all labels in label order.

    ``wrong_object`` is the most general reasoning label, so it comes after all other reasoning labels.
    """
    return tuple(_LABELS.values())


Label.SUCCESS = new_label("success", Kind.NONE)
Label.CORRECT_FREEZE = new_label("correct_freeze", Kind.NONE)
Label.CORRECT_REFUSAL = new_label("correct_refusal", Kind.NONE)
Label.LEXICAL_KINEMATIC_SHORTCUT = new_label("lexical_kinematic_shortcut", Kind.REASONING)
Label.VISUAL_LAYOUT_BIAS = new_label("visual_layout_bias", Kind.REASONING)
Label.BEHAVIORAL_INERTIA = new_label("behavioral_inertia", Kind.REASONING)
Label.CAUSAL_CONFUSION = new_label("causal_confusion", Kind.REASONING)
Label.SEMANTIC_FEATURE_COLLAPSE = new_label("semantic_feature_collapse", Kind.REASONING)
Label.ORDER_VIOLATION = new_label("order_violation", Kind.REASONING)
Label.PHASE_CONFLICT = new_label("phase_conflict", Kind.REASONING)
Label.EARLY_HALT = new_label("early_halt", Kind.REASONING)
Label.WRONG_OBJECT = new_label("wrong_object", Kind.REASONING)
Label.EXECUTION_FAILURE = new_label("execution_failure", Kind.EXECUTION)
Label.TIMEOUT = new_label("timeout", Kind.EXECUTION)
Label.POLICY_ERROR = new_label("policy_error", Kind.SYSTEM)
Label.UNFINISHED = new_label("unfinished", Kind.UNFINISHED)
