"""What labels and axes are called on the page, and what each label means in one sentence."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.tasks import Axis
from betterbench.tasks.labels import Kind, Label


@dataclass(frozen=True, slots=True)
class Entry:
    """How one outcome label is shown.

    Attributes:
        label: The label.
        name: Full name for lists and filters.
        short: Name of one or two words for a segment of a bar.
        conclusion: What it says about a policy whose failures are mostly of this kind, one sentence.
        definition: What the record has to show, one sentence (suite, section 5).
    """

    label: Label
    name: str
    short: str
    conclusion: str
    definition: str

    @property
    def family(self) -> str:
        """Color family: "right", "reasoning", "execution" or "system"."""
        return "right" if self.label.kind is Kind.NONE else self.label.kind.value


_ENTRIES = (
    Entry(Label.SUCCESS, "Success", "solved", "", "The goal is met, at rest and released, before the step limit."),
    Entry(
        Label.CORRECT_FREEZE, "Correct freeze", "stayed still", "",
        "Nothing was left to do, nothing was touched, and the arm settled.",
    ),
    Entry(
        Label.CORRECT_REFUSAL, "Correct refusal", "refused", "",
        "What was asked for was absent, and nothing was grasped in its place.",
    ),
    Entry(
        Label.LEXICAL_KINEMATIC_SHORTCUT, "Lexical-kinematic shortcut", "lexical",
        "It maps words to motions: it goes where a word led in training, not to what the word means.",
        "The first attempt goes where the word of the instruction led in training, to another object that the "
        "instruction could have meant in another layout.",
    ),
    Entry(
        Label.VISUAL_LAYOUT_BIAS, "Visual layout bias", "layout bias",
        "It goes to the same place whatever the instruction says.",
        "The first attempt goes to the same place whatever the instruction; decided over several trials.",
    ),
    Entry(
        Label.BEHAVIORAL_INERTIA, "Behavioral inertia", "inertia",
        "It plays the habitual step of training, whether or not it was asked for.",
        "A step frequent in training but not asked for is begun, or the next step of a memorized sequence is played "
        "without its object.",
    ),
    Entry(
        Label.CAUSAL_CONFUSION, "Causal confusion", "causal",
        "It loses track of what has been done: it skips steps that are open or repeats finished ones.",
        "A required step whose object is present is skipped and a later one attempted, or a finished one is repeated.",
    ),
    Entry(
        Label.SEMANTIC_FEATURE_COLLAPSE, "Semantic feature collapse", "look-alike",
        "It takes look-alikes for the real thing.",
        "The attempt is at an object that no instruction of the task means.",
    ),
    Entry(
        Label.ORDER_VIOLATION, "Order violation", "order",
        "It handles the right objects in the wrong order.",
        "The right objects are handled in the wrong order where the order is part of the goal.",
    ),
    Entry(
        Label.PHASE_CONFLICT, "Phase conflict", "phase",
        "It freezes or wavers when the scene looks half finished.",
        "The initial state looks mid-task, and the arm freezes or wavers without an attempt.",
    ),
    Entry(
        Label.EARLY_HALT, "Early halt", "halt",
        "It stops before the work is done.",
        "The arm stands still with steps open and no attempt under way.",
    ),
    Entry(
        Label.WRONG_OBJECT, "Wrong object", "wrong object",
        "It goes for the wrong object; this run cannot tell by which rule.",
        "The attempt is at the wrong object, and the run lacks the pairs that would tell why.",
    ),
    Entry(
        Label.EXECUTION_FAILURE, "Execution failure", "execution",
        "It goes for the right things, but its hand fails.",
        "The right target at the right time, but slipped, dropped, collided or missed.",
    ),
    Entry(
        Label.TIMEOUT, "Timeout", "timeout",
        "It is on the right course, but runs out of time.",
        "The right course, and the step limit was reached.",
    ),
    Entry(
        Label.POLICY_ERROR, "Policy error", "error",
        "The policy itself failed to run; this says nothing about its reasoning.",
        "The policy crashed, answered too late or sent an invalid action, or the trial did not finish.",
    ),
)  # fmt: skip

LEGEND: dict[Label, Entry] = {entry.label: entry for entry in _ENTRIES}
"""Every label's entry, in the order in which bars are stacked."""

FAMILIES: dict[str, str] = {
    "right": "Right",
    "reasoning": "Reasoning failure",
    "execution": "Execution failure",
    "system": "System failure",
}
"""Color families and their names, in the order in which bars are stacked."""

AXIS_NAMES: dict[str, str] = {
    Axis.SPATIAL_LAYOUT_SHIFT.value: "Spatial layout shift",
    Axis.PRIMITIVE_RECOMPOSITION.value: "Primitive recomposition",
    Axis.ADVERSARIAL_OBJECT_PERTURBATION.value: "Adversarial object perturbation",
    Axis.TEMPORAL_EXTRAPOLATION.value: "Temporal extrapolation",
}
"""Axes and their names, in the order of the paper."""

EXPECTED_NAMES: dict[str, str] = {
    "succeed": "reach the goal",
    "refuse": "refuse: what is asked for is not there",
    "stay_still": "stay still: it is done already",
}
"""What a right policy does, in words."""
