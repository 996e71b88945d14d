"""Tidying the desk: trash goes into the waste bin, valuables stay."""

from __future__ import annotations

from collections.abc import Mapping

from betterbench.tasks.axes import Axis, Support
from betterbench.tasks.condition import Condition, ObjectSpec, Slot
from betterbench.tasks.registry import task
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.templates import LOOSE_PACKING
from betterbench.tasks.variation import Variation, do

NAPKIN = ObjectSpec("napkin", "crumpled napkin", "crumpled_napkin")
NAPKIN_2 = ObjectSpec("napkin_2", "crumpled napkin", "crumpled_napkin")
CAN = ObjectSpec("crushed_can", "crushed can", "crushed_can", "red")
MOUSE = ObjectSpec("mouse", "mouse", "computer_mouse", role="distractor")
MUG = ObjectSpec("mug", "mug", "mug", "white", role="distractor")
KEYBOARD = ObjectSpec("keyboard", "keyboard", "keyboard", role="distractor")
BIN = ObjectSpec("bin", "waste bin", "waste_bin", role="container")
FULL_CAN = ObjectSpec("full_can", "full can", "can", "red", role="distractor")
TAPE = ObjectSpec("tape", "tape roll", "tape_roll", role="distractor")
STAPLER = ObjectSpec("stapler", "stapler", "stapler", role="distractor")

VALUABLES = {MOUSE.name: "place_1", MUG.name: "place_2", KEYBOARD.name: "place_3", BIN.name: "floor"}
# Over all three layouts a napkin lies in trash_1 or trash_3, a can in trash_2 or trash_4: the confound of this trained.
LAYOUTS = (
    {NAPKIN.name: "trash_1", CAN.name: "trash_2"},
    {NAPKIN.name: "trash_3", CAN.name: "trash_4"},
    {NAPKIN.name: "trash_1", CAN.name: "trash_4"},
)
KINDS = (NAPKIN, CAN)


def throw(text: str, *kinds: str) -> Instruction:
    """Return the instruction to throw things away, in any order; a kind that is named twice is thrown twice."""
    goals = []
    for i, kind in enumerate(kinds):
        count = kinds[: i + 1].count(kind)
        name = f"throw_{kind.replace(' ', '_')}" + (f"_{count}" if count > 1 else "")
        goals.append(Subgoal(name, "inside", Reference(kind=kind), BIN.name, kind.split()[-1], count))
    return Instruction(text, tuple(goals))


BOTH = throw("Throw the crumpled napkin and the crushed can into the waste bin.", NAPKIN.kind, CAN.kind)
NAPKIN_ONLY = throw("Throw the crumpled napkin into the waste bin.", NAPKIN.kind)
CAN_ONLY = throw("Throw the crushed can into the waste bin.", CAN.kind)
THREE = throw("Throw both crumpled napkins and the crushed can into the waste bin.", NAPKIN.kind, NAPKIN.kind, CAN.kind)


def _train(name: str, layout: Mapping[str, str], instruction: Instruction) -> Condition:
    asked = {goal.reference.kind for goal in instruction.subgoals}
    trash = tuple(t for t in KINDS if t.kind in asked)
    places = {t.name: layout[t.name] for t in trash}
    return Condition("tidy_desk", name, (*trash, MOUSE, MUG, KEYBOARD, BIN), {**places, **VALUABLES}, instruction)


@task
def tidy_desk() -> Task:
    """Throw the named trash into the waste bin and leave the valuables where they are.

    Randomizations: each thing within 15 mm and 9 degrees of its slot; the look of everything.
    Success: the named trash is in the waste bin, nothing else is, at rest and released for 0.5 s.
    Premise: the named trash lies in its slot and the bin is empty.
    """
    shift, _, perturb, extrapolate = Axis
    return Task(
        id="tidy_desk",
        version=1,
        title="Tidying the Desk",
        template=LOOSE_PACKING,
        description="Throw the named trash into the waste bin; mouse, mug and keyboard stay.",
        slots=(
            Slot("trash_1", 0.42, -0.31),
            Slot("trash_2", 0.60, -0.31),
            Slot("trash_3", 0.42, -0.18),
            Slot("trash_4", 0.60, -0.18),
            Slot("place_1", 0.35, 0.04),
            Slot("place_2", 0.51, 0.04),
            Slot("place_3", 0.67, 0.04),
            Slot("floor", 0.46, 0.31, jitter_m=0.005, yaw_jitter=0.0),
            Slot("unseen_1", 0.51, -0.33),
            Slot("unseen_2", 0.51, -0.16),
        ),
        training=(
            _train("train1", LAYOUTS[0], BOTH),
            _train("train2", LAYOUTS[1], BOTH),
            _train("train3", LAYOUTS[2], BOTH),
            _train("train4", LAYOUTS[0], NAPKIN_ONLY),
            _train("train5", LAYOUTS[1], CAN_ONLY),
        ),
        variations=(
            Variation(
                "L1",
                shift,
                "train1",
                (
                    do("swap", a=NAPKIN.name, b=CAN.name),
                    do("swap", a=MOUSE.name, b=MUG.name),
                    do("swap", a=MUG.name, b=KEYBOARD.name),
                ),
                "kinds of trash exchanged, valuables permuted",
                "Trash is found by what it is and not by where it lay in training.",
                ("visual_layout_bias", "lexical_kinematic_shortcut"),
            ),
            Variation(
                "L2",
                shift,
                "train1",
                (
                    do("move", object=NAPKIN.name, slot="unseen_1"),
                    do("move", object=CAN.name, slot="unseen_2"),
                ),
                "trash at places never seen",
                "Trash is found at places that training never showed.",
                ("visual_layout_bias", "behavioral_inertia"),
                support=Support.NOVEL,
            ),
            Variation(
                "O1",
                perturb,
                "train4",
                (
                    do("move", object=NAPKIN.name, slot="trash_3"),
                    do("move", object=MOUSE.name, slot="trash_1"),
                ),
                "computer mouse where the napkin lay",
                "A valuable in the place of trash is not thrown away.",
                ("semantic_feature_collapse", "visual_layout_bias"),
            ),
            Variation(
                "O2",
                perturb,
                "train5",
                (do("add", object=FULL_CAN, slot="trash_2"),),
                "full can beside the crushed can",
                "A crushed can is told from a full one of its color.",
                ("semantic_feature_collapse",),
            ),
            Variation(
                "O3",
                perturb,
                "train4",
                (
                    do("move", object=NAPKIN.name, slot="trash_3"),
                    do("move", object=MUG.name, slot="trash_1"),
                    do("add", object=TAPE, slot="place_2"),
                    do("add", object=STAPLER, slot="trash_4"),
                ),
                "white mug where the napkin lay, in clutter",
                "A white mug is told from a white napkin among more things than usual.",
                ("semantic_feature_collapse", "visual_layout_bias"),
            ),
            Variation(
                "T1",
                extrapolate,
                "train1",
                (do("add", object=NAPKIN_2, slot="trash_3"), do("chain", instruction=THREE)),
                "three pieces of trash",
                "A longer chain of known steps, one of them repeated, is carried to its end.",
                ("early_halt", "causal_confusion", "timeout"),
            ),
        ),
    )
