"""Laying the breakfast table: fork, cup and spoon go to their places around the plate."""

from __future__ import annotations

from betterbench.tasks.axes import Axis
from betterbench.tasks.condition import Condition, ObjectSpec, Slot
from betterbench.tasks.registry import task
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.templates import PATTERNED_ARRANGEMENT
from betterbench.tasks.variation import Variation, do

FORK = ObjectSpec("fork", "fork", "fork")
CUP = ObjectSpec("cup", "cup", "cup", "blue")
SPOON = ObjectSpec("spoon", "spoon", "spoon")
PLATE = ObjectSpec("plate", "plate", "place_plate", role="fixture")
BOWL = ObjectSpec("bowl", "bowl", "cereal_bowl", role="distractor")
SALT = ObjectSpec("salt", "salt shaker", "salt_shaker", role="distractor")
JAM = ObjectSpec("jam", "jam jar", "jam_jar", role="distractor")
EGG = ObjectSpec("egg", "egg cup", "egg_cup", role="distractor")
TUMBLER = ObjectSpec("tumbler", "tumbler", "tumbler", "blue", role="distractor")

LAYOUTS = (
    {
        FORK.name: "left_edge",
        CUP.name: "front",
        SPOON.name: "right_edge",
        BOWL.name: "back_left",
        SALT.name: "back",
        JAM.name: "front_left",
        EGG.name: "front_right",
        PLATE.name: "table_right",
    },
    {
        FORK.name: "left_corner",
        CUP.name: "front_right",
        SPOON.name: "right_corner",
        BOWL.name: "back_left",
        SALT.name: "back",
        JAM.name: "front_left",
        EGG.name: "front",
        PLATE.name: "table_left",
    },
)
WHERE = {
    "left": "to the left of the plate",
    "right": "to the right of the plate",
    "upper_right": "at the upper right of the plate",
}
TRAINED = {FORK.name: "left", CUP.name: "upper_right", SPOON.name: "right"}


def lay(*steps: tuple[ObjectSpec, str]) -> Instruction:
    """Return the instruction to lay things around the plate, in any order."""
    parts = [f"the {thing.kind} {WHERE[side]}" for thing, side in steps]
    text = f"Put {', '.join(parts[:-1])} and {parts[-1]}."
    return Instruction(
        text,
        tuple(
            Subgoal(f"{t.name}_{side}", "beside", Reference(kind=t.kind), PLATE.name, t.kind, region=side)
            for t, side in steps
        ),
    )


def _trained(*things: ObjectSpec) -> Instruction:
    return lay(*((thing, TRAINED[thing.name]) for thing in things))


def _training() -> tuple[Condition, ...]:
    pairs = ((FORK, CUP), (SPOON, FORK), (CUP, SPOON))
    settings = [(layout, pair) for layout in LAYOUTS for pair in pairs]
    objects = (FORK, CUP, SPOON, BOWL, SALT, JAM, EGG, PLATE)
    return tuple(
        Condition("breakfast_table", f"train{i}", objects, layout, _trained(*pair))
        for i, (layout, pair) in enumerate(settings, start=1)
    )


@task
def breakfast_table() -> Task:
    """Lay the named pieces around the plate, among other tableware.

    Sides are those of somebody who sits in front of the plate, as the front camera does.

    Randomizations: each piece within 15 mm and 9 degrees of its slot, the plate within 8 mm; the look of everything.
    Success: each named piece lies in the zone of its side, cutlery along the front-to-back axis, at rest and released
    for 0.5 s; nothing else was brought to a side.
    Premise: the named pieces lie in their slots and the sides of the plate are free.
    """
    shift, recompose, perturb, extrapolate = Axis
    return Task(
        id="breakfast_table",
        version=1,
        title="Laying the Breakfast Table",
        template=PATTERNED_ARRANGEMENT,
        description="Lay the named pieces around the plate.",
        slots=(
            Slot("left_edge", 0.44, -0.33, jitter_m=0.010),
            Slot("left_corner", 0.56, -0.33, jitter_m=0.010),
            Slot("front", 0.70, -0.04),
            Slot("right_edge", 0.44, 0.33, jitter_m=0.010),
            Slot("right_corner", 0.56, 0.33, jitter_m=0.010),
            Slot("back_left", 0.32, -0.15),
            Slot("back", 0.30, 0.25),
            Slot("front_left", 0.70, -0.17),
            Slot("front_right", 0.70, 0.11),
            Slot("table_right", 0.51, 0.08, jitter_m=0.008, yaw_jitter=0.05),
            Slot("table_left", 0.51, -0.08, jitter_m=0.008, yaw_jitter=0.05),
        ),
        training=_training(),
        variations=(
            Variation(
                "L1",
                shift,
                "train1",
                (
                    do("swap", a=BOWL.name, b=JAM.name),
                    do("swap", a=SALT.name, b=EGG.name),
                    do("swap", a=BOWL.name, b=SALT.name),
                ),
                "other tableware rearranged over the same slots",
                "Known pieces are found among tableware that stands in another order.",
                ("visual_layout_bias", "semantic_feature_collapse"),
            ),
            Variation(
                "L2",
                shift,
                "train1",
                (do("move", object=PLATE.name, slot="table_left"),),
                "plate at its other position",
                "A side is a side of the plate and not a place on the table.",
                ("visual_layout_bias", "behavioral_inertia"),
            ),
            Variation(
                "R1",
                recompose,
                "train3",
                (do("instruct", instruction=lay((SPOON, "left"), (CUP, "right"))),),
                "spoon left, cup right",
                "Piece and side, each known, are put together in a new way.",
                ("behavioral_inertia", "lexical_kinematic_shortcut"),
            ),
            Variation(
                "O1",
                perturb,
                "train1",
                (do("swap", a=FORK.name, b=SPOON.name),),
                "spoon where the fork lay, fork where the spoon lay",
                "A fork is told from a spoon that lies in its place.",
                ("lexical_kinematic_shortcut", "visual_layout_bias"),
            ),
            Variation(
                "O2",
                perturb,
                "train1",
                (
                    do("remove", object=SPOON.name),
                    do("move", object=CUP.name, slot="right_edge"),
                    do("add", object=TUMBLER, slot="front"),
                ),
                "tumbler of the cup's color where the cup stood",
                "A cup is told from a tumbler of its color that stands in its place.",
                ("semantic_feature_collapse", "early_halt"),
            ),
            Variation(
                "T1",
                extrapolate,
                "train1",
                (do("chain", instruction=_trained(FORK, CUP, SPOON)),),
                "three pieces in one instruction",
                "A longer chain of known steps is carried to its end.",
                ("early_halt", "causal_confusion", "timeout"),
            ),
        ),
    )
