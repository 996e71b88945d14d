"""Stacking dinner plates: red and blue plates go onto the white one or onto each other."""

from __future__ import annotations

from collections.abc import Mapping

from betterbench.tasks.axes import Axis
from betterbench.tasks.condition import Condition, ObjectSpec, Slot, TargetRegion
from betterbench.tasks.registry import task
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.templates import RECURSIVE_STACKING
from betterbench.tasks.variation import Variation, do

WHITE = ObjectSpec("white_plate", "white plate", "plate_large", "white")
RED = ObjectSpec("red_plate", "red plate", "plate_medium", "red")
BLUE = ObjectSpec("blue_plate", "blue plate", "plate_small", "blue")
BOWL = ObjectSpec("red_bowl", "red bowl", "shallow_bowl", "red", role="distractor")

LAYOUTS = (
    {RED.name: "left_back", BLUE.name: "left_front", WHITE.name: "stand_right"},
    {RED.name: "right_back", BLUE.name: "right_front", WHITE.name: "stand_middle"},
)


def onto(*steps: tuple[ObjectSpec, ObjectSpec]) -> Instruction:
    """Return the instruction to put plates on plates, from below."""
    parts = [f"the {upper.kind} on the {lower.kind}" for upper, lower in steps]
    return Instruction(
        f"Put {', then '.join(parts)}.",
        tuple(
            Subgoal(f"{u.name}_on_{lo.name}", "on_plate", Reference(kind=u.kind), lo.name, u.kind.split()[0])
            for u, lo in steps
        ),
        ordered=True,
    )


RED_ON_WHITE, BLUE_ON_WHITE, BLUE_ON_RED = onto((RED, WHITE)), onto((BLUE, WHITE)), onto((BLUE, RED))
WHOLE_STACK = onto((RED, WHITE), (BLUE, RED))


def _train(name: str, layout: Mapping[str, str], instruction: Instruction, *, stacked: bool = False) -> Condition:
    places = {n: slot for n, slot in layout.items() if not (stacked and n == RED.name)}
    preplaced = {RED.name: TargetRegion(WHITE.name)} if stacked else {}
    return Condition("dinner_plates", name, (RED, BLUE, WHITE), places, instruction, preplaced=preplaced)


@task
def dinner_plates() -> Task:
    """Put the named plate on the named plate.

    Randomizations: each plate within 15 mm of its slot, the white one within 10 mm; the look of everything.
    Success: the named plate stands in the middle of the named one, flat and touching it, nothing else was put on a
    plate that is asked for, at rest and released for 0.5 s.
    Premise: the named plates stand in their slots; in training a red plate may stand on the white one already.
    """
    shift, recompose, perturb, extrapolate = Axis
    return Task(
        id="dinner_plates",
        version=1,
        title="Stacking Dinner Plates",
        template=RECURSIVE_STACKING,
        description="Put the named plate on the named plate or stack.",
        slots=(
            Slot("left_back", 0.46, -0.28),
            Slot("left_front", 0.64, -0.17),
            Slot("right_back", 0.46, 0.28),
            Slot("right_front", 0.64, 0.17),
            Slot("stand_right", 0.45, 0.20, jitter_m=0.010),
            Slot("stand_middle", 0.45, -0.02, jitter_m=0.010),
        ),
        training=(
            _train("train1", LAYOUTS[0], RED_ON_WHITE),
            _train("train2", LAYOUTS[0], BLUE_ON_WHITE),
            _train("train3", LAYOUTS[0], BLUE_ON_RED, stacked=True),
            _train("train4", LAYOUTS[1], RED_ON_WHITE),
            _train("train5", LAYOUTS[1], BLUE_ON_WHITE),
            _train("train6", LAYOUTS[1], BLUE_ON_RED, stacked=True),
        ),
        variations=(
            Variation(
                "L1",
                shift,
                "train1",
                (do("swap", a=RED.name, b=BLUE.name),),
                "red and blue plate exchanged",
                "Plates are found by what they are and not by where they stood in training.",
                ("lexical_kinematic_shortcut", "visual_layout_bias"),
            ),
            Variation(
                "L2",
                shift,
                "train1",
                (do("move", object=WHITE.name, slot="stand_middle"),),
                "white plate at its other position",
                "A plate is put where the white one stands and not where it stood.",
                ("visual_layout_bias", "execution_failure"),
            ),
            Variation(
                "R1",
                recompose,
                "train2",
                (do("swap", a=WHITE.name, b=RED.name), do("instruct", instruction=BLUE_ON_RED)),
                "blue on red, which stands where the white plate stood",
                "What a plate is put on is chosen by its color and not by its place.",
                ("lexical_kinematic_shortcut", "behavioral_inertia", "visual_layout_bias"),
            ),
            Variation(
                "O1",
                perturb,
                "train1",
                (
                    do("remove", object=BLUE.name),
                    do("move", object=RED.name, slot="left_front"),
                    do("add", object=BOWL, slot="left_back"),
                ),
                "red bowl where the red plate stood",
                "A plate is told from a bowl of its color that stands in its place.",
                ("semantic_feature_collapse",),
            ),
            Variation(
                "T1",
                extrapolate,
                "train1",
                (do("chain", instruction=WHOLE_STACK),),
                "stack of three from single plates",
                "A longer chain of known steps is carried to its end.",
                ("early_halt", "causal_confusion", "timeout"),
            ),
            Variation(
                "T2",
                extrapolate,
                "train3",
                (do("chain", instruction=WHOLE_STACK),),
                "whole stack asked for, red already on white",
                "What is done already is seen, and the work is finished from there.",
                ("phase_conflict", "causal_confusion", "behavioral_inertia"),
                mid_task_look=True,
            ),
        ),
    )
