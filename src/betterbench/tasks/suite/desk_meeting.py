"""Preparing a desk meeting: mouse, mug and speaker go to their sides of the laptop."""

from __future__ import annotations

import itertools

from betterbench.tasks.axes import Axis
from betterbench.tasks.condition import Condition, ObjectSpec, Slot
from betterbench.tasks.registry import task
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.templates import PATTERNED_ARRANGEMENT
from betterbench.tasks.variation import Variation, do

MOUSE = ObjectSpec("mouse", "mouse", "computer_mouse")
MUG = ObjectSpec("mug", "mug", "mug", "blue")
SPEAKER = ObjectSpec("speaker", "speaker", "speaker")
LAPTOP = ObjectSpec("laptop", "laptop", "laptop", role="fixture")
SOAP = ObjectSpec("soap_bar", "soap bar", "soap_bar", "gray", role="distractor")

THINGS = (MOUSE, MUG, SPEAKER)
LAYOUTS = (
    {MOUSE.name: "front_1", MUG.name: "front_2", SPEAKER.name: "front_3", LAPTOP.name: "desk_right"},
    {SPEAKER.name: "front_4", MOUSE.name: "front_5", MUG.name: "front_6", LAPTOP.name: "desk_left"},
)
WHERE = {"right": "to the right of", "left": "to the left of", "behind": "behind"}
TRAINED = {MOUSE.name: "right", MUG.name: "left", SPEAKER.name: "behind"}


def put(*steps: tuple[ObjectSpec, str]) -> Instruction:
    """Return the instruction to put things to sides of the laptop, in any order."""
    parts = [f"the {thing.kind} {WHERE[side]} the laptop" for thing, side in steps]
    text = f"Put {', '.join(parts[:-1])} and {parts[-1]}."
    return Instruction(
        text,
        tuple(
            Subgoal(f"{t.name}_{side}", "beside", Reference(kind=t.kind), LAPTOP.name, t.kind, region=side)
            for t, side in steps
        ),
    )


def _trained(*things: ObjectSpec) -> Instruction:
    return put(*((thing, TRAINED[thing.name]) for thing in things))


def _training() -> tuple[Condition, ...]:
    settings = [(layout, pair) for layout in LAYOUTS for pair in itertools.permutations(THINGS, 2)]
    return tuple(
        Condition("desk_meeting", f"train{i}", (*THINGS, LAPTOP), layout, _trained(*pair))
        for i, (layout, pair) in enumerate(settings, start=1)
    )


@task
def desk_meeting() -> Task:
    """Put the named things to the named sides of the laptop.

    Sides are those of somebody who sits in front of the laptop, as the front camera does.

    Randomizations: each thing within 15 mm and 9 degrees of its slot, the laptop within 10 mm; the look of everything.
    Success: each named thing stands in the zone of its side, the mouse along the laptop, at rest and released for
    0.5 s; nothing else was brought to a side.
    Premise: the named things stand in their slots in front of the laptop.
    """
    shift, recompose, perturb, extrapolate = Axis
    return Task(
        id="desk_meeting",
        version=1,
        title="Preparing a Desk Meeting",
        template=PATTERNED_ARRANGEMENT,
        description="Put the named things to the named sides of the laptop.",
        slots=(
            Slot("front_1", 0.68, -0.24),
            Slot("front_2", 0.68, -0.04),
            Slot("front_3", 0.68, 0.16),
            Slot("front_4", 0.68, -0.16),
            Slot("front_5", 0.68, 0.04),
            Slot("front_6", 0.68, 0.24),
            Slot("desk_right", 0.47, 0.10, jitter_m=0.010, yaw_jitter=0.05),
            Slot("desk_left", 0.47, -0.10, jitter_m=0.010, yaw_jitter=0.05),
        ),
        training=_training(),
        variations=(
            Variation(
                "L1",
                shift,
                "train1",
                (do("swap", a=MOUSE.name, b=MUG.name),),
                "mouse and mug exchange their slots",
                "Things are found by what they are and not by where they stood in training.",
                ("lexical_kinematic_shortcut", "visual_layout_bias"),
            ),
            Variation(
                "L2",
                shift,
                "train1",
                (do("move", object=LAPTOP.name, slot="desk_left"),),
                "laptop at its other position",
                "A side is a side of the laptop and not a place on the table.",
                ("visual_layout_bias", "behavioral_inertia"),
            ),
            Variation(
                "R1",
                recompose,
                "train1",
                (do("instruct", instruction=put((MUG, "right"), (MOUSE, "left"))),),
                "mug right, mouse left",
                "Thing and side, each known, are put together in a new way.",
                ("behavioral_inertia", "lexical_kinematic_shortcut"),
            ),
            Variation(
                "R2",
                recompose,
                "train6",
                (do("instruct", instruction=put((SPEAKER, "left"), (MUG, "right"))),),
                "speaker left, mug right",
                "Thing and side, each known, are put together in a new way.",
                ("behavioral_inertia", "lexical_kinematic_shortcut"),
            ),
            Variation(
                "O1",
                perturb,
                "train1",
                (
                    do("remove", object=SPEAKER.name),
                    do("move", object=MOUSE.name, slot="front_3"),
                    do("add", object=SOAP, slot="front_1"),
                ),
                "gray soap bar where the mouse lay",
                "The mouse is told from a soap bar of its shape that lies in its place.",
                ("semantic_feature_collapse", "early_halt"),
            ),
            Variation(
                "T1",
                extrapolate,
                "train1",
                (do("chain", instruction=_trained(MOUSE, MUG, SPEAKER)),),
                "all three in one instruction",
                "A longer chain of known steps is carried to its end.",
                ("early_halt", "causal_confusion", "timeout"),
            ),
        ),
    )
