"""Preparing morning coffee: the instructed mug goes onto the marked ring of the coffee machine."""

from __future__ import annotations

from betterbench.tasks.axes import Axis, Expected
from betterbench.tasks.condition import Condition, ObjectSpec, Slot
from betterbench.tasks.registry import task
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.templates import CONSTRAINED_POSITIONING
from betterbench.tasks.variation import Variation, do

NEAR, FAR, STAND = "near", "far", "machine"
RED_MUG = ObjectSpec("red_mug", "red mug", "mug", "red")
BLUE_MUG = ObjectSpec("blue_mug", "blue mug", "mug", "blue")
RED_CAN = ObjectSpec("red_can", "red can", "can", "red", role="distractor")
MACHINE = ObjectSpec("coffee_machine", "coffee machine", "coffee_machine", role="fixture", fixed=True)


def place(word: str, reference: Reference) -> Instruction:
    """Return the instruction to put the mug that ``word`` picks out onto the ring."""
    return Instruction(
        f"Put the {word} mug on the ring of the coffee machine.",
        (Subgoal("place_mug", "on_ring", reference, MACHINE.name, word),),
    )


RED = place("red", Reference(kind=RED_MUG.kind))
BLUE = place("blue", Reference(kind=BLUE_MUG.kind))
TOP = place("top", Reference(slot=FAR))
BOTTOM = place("bottom", Reference(slot=NEAR))

LAYOUT_1 = {RED_MUG.name: NEAR, BLUE_MUG.name: FAR, MACHINE.name: STAND}
LAYOUT_2 = {RED_MUG.name: FAR, BLUE_MUG.name: NEAR, MACHINE.name: STAND}


def _train(name: str, layout: dict[str, str], instruction: Instruction) -> Condition:
    return Condition("morning_coffee", name, (RED_MUG, BLUE_MUG, MACHINE), layout, instruction)


@task
def morning_coffee() -> Task:
    """Put the instructed mug on the marked ring under the spout.

    "Near" and "far" are seen from the front camera: the far slot is at the top of the image, close to the robot.

    Randomizations: each mug within 15 mm and 9 degrees of its slot; the look of mugs and machine.
    Success: the mug stands within 10 mm of the ring's center, upright, handle clear of the spout, released, for 0.5 s.
    Premise: the instructed mug stands in its slot and the ring is free; for T1 the red mug already stands on the ring.
    """
    shift, perturb, extrapolate = (
        Axis.SPATIAL_LAYOUT_SHIFT,
        Axis.ADVERSARIAL_OBJECT_PERTURBATION,
        Axis.TEMPORAL_EXTRAPOLATION,
    )
    fooled = ("lexical_kinematic_shortcut", "visual_layout_bias", "early_halt")
    return Task(
        id="morning_coffee",
        version=1,
        title="Preparing Morning Coffee",
        template=CONSTRAINED_POSITIONING,
        description="Put the instructed mug on the marked ring of the coffee machine.",
        slots=(
            Slot(NEAR, 0.60, -0.12, yaw=-1.5708),
            Slot(FAR, 0.40, -0.12, yaw=-1.5708),
            Slot(STAND, 0.50, 0.25, yaw=-1.5708, jitter_m=0.0, yaw_jitter=0.0),
        ),
        training=(
            _train("train1", LAYOUT_1, RED),
            _train("train2", LAYOUT_1, BLUE),
            _train("train3", LAYOUT_2, TOP),
            _train("train4", LAYOUT_2, BOTTOM),
        ),
        variations=(
            Variation(
                "L1",
                shift,
                "train2",
                (do("instruct", instruction=TOP),),
                "layout 1, top",
                "A place word is understood although it was never heard in this layout.",
                fooled,
            ),
            Variation(
                "L2",
                shift,
                "train1",
                (do("instruct", instruction=BOTTOM),),
                "layout 1, bottom",
                "A place word is understood although it was never heard in this layout.",
                fooled,
            ),
            Variation(
                "L3",
                shift,
                "train3",
                (do("instruct", instruction=RED),),
                "layout 2, red",
                "A color word means the object and not the place where that object stood in training.",
                fooled,
            ),
            Variation(
                "L4",
                shift,
                "train4",
                (do("instruct", instruction=BLUE),),
                "layout 2, blue",
                "A color word means the object and not the place where that object stood in training.",
                fooled,
            ),
            Variation(
                "O1",
                perturb,
                "train1",
                (
                    do("remove", object=BLUE_MUG.name),
                    do("move", object=RED_MUG.name, slot=FAR),
                    do("add", object=RED_CAN, slot=NEAR),
                ),
                "red can where the red mug stood",
                "The red mug is told from another red thing that stands in its place.",
                ("semantic_feature_collapse", "early_halt"),
            ),
            Variation(
                "T1",
                extrapolate,
                "train1",
                (do("preplace", object=RED_MUG.name, target=MACHINE.name),),
                "red mug already on the ring",
                "What is done already is seen, and nothing is done again.",
                ("behavioral_inertia", "causal_confusion", "semantic_feature_collapse"),
                expected=Expected.STAY_STILL,
                mid_task_look=True,
            ),
        ),
    )
