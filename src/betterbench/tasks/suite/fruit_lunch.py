"""Packing a fruit lunch: apple, orange and lemon go into the lunchbox in the order in which they are named."""

from __future__ import annotations

from betterbench.tasks.axes import Axis, Expected
from betterbench.tasks.condition import Condition, ObjectSpec, Slot
from betterbench.tasks.registry import task
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.templates import LOOSE_PACKING
from betterbench.tasks.variation import Variation, do

APPLE = ObjectSpec("apple", "apple", "apple", "red")
APPLE_2 = ObjectSpec("apple_2", "apple", "apple", "red")
ORANGE = ObjectSpec("orange", "orange", "orange")
LEMON = ObjectSpec("lemon", "lemon", "lemon")
LUNCHBOX = ObjectSpec("lunchbox", "lunchbox", "lunchbox", role="container")
BLOCK = ObjectSpec("red_block", "red block", "block", "red", role="distractor")

LAYOUT = {APPLE.name: "first", ORANGE.name: "second", LEMON.name: "third", LUNCHBOX.name: "stand"}


def pack(kind: str, *, count: int = 1) -> Subgoal:
    """Return the subgoal to pack the ``count``-th object of a kind."""
    name = f"pack_{kind}" if count == 1 else f"pack_{kind}_{count}"
    return Subgoal(name, "inside", Reference(kind=kind), LUNCHBOX.name, kind, count)


A, A_AGAIN, B, C = pack("apple"), pack("apple", count=2), pack("orange"), pack("lemon")


def order(text: str, *subgoals: Subgoal) -> Instruction:
    """Return an instruction whose order is part of the goal."""
    return Instruction(text, subgoals, ordered=True)


APPLE_THEN_ORANGE = order("Put the apple into the lunchbox, then the orange.", A, B)
APPLE_THEN_LEMON = order("Put the apple into the lunchbox, then the lemon.", A, C)
ORANGE_THEN_LEMON = order("Put the orange into the lunchbox, then the lemon.", B, C)
BOTH_APPLES = order("Put both apples into the lunchbox.", A, A_AGAIN)


def _train(name: str, instruction: Instruction) -> Condition:
    return Condition("fruit_lunch", name, (APPLE, ORANGE, LEMON, LUNCHBOX), LAYOUT, instruction)


@task
def fruit_lunch() -> Task:
    """Pack the named fruit into the lunchbox, in the order in which it is named.

    Randomizations: each fruit within 15 mm and 9 degrees of its slot; the look of everything.
    Success: what was named is in the lunchbox, nothing else is, packed in the named order, at rest and released for
    0.5 s. For O1 the instructed apple does not exist: no attempt at the block.
    Premise: what is named lies in its slot and the lunchbox is empty; broken on purpose in O1.
    """
    shift, recompose, perturb, extrapolate = Axis
    return Task(
        id="fruit_lunch",
        version=1,
        title="Packing a Fruit Lunch",
        template=LOOSE_PACKING,
        description="Put the named fruit into the lunchbox in the named order.",
        slots=(
            Slot("first", 0.42, -0.28),
            Slot("second", 0.60, -0.28),
            Slot("third", 0.60, -0.09),
            Slot("stand", 0.50, 0.20, yaw=-1.5708, jitter_m=0.005, yaw_jitter=0.03),
        ),
        training=(_train("train1", APPLE_THEN_ORANGE), _train("train2", APPLE_THEN_LEMON)),
        variations=(
            Variation(
                "L1",
                shift,
                "train1",
                (do("swap", a=APPLE.name, b=ORANGE.name),),
                "apple and orange exchanged",
                "Fruit is found by what it is and not by where it lay in training.",
                ("lexical_kinematic_shortcut", "visual_layout_bias"),
            ),
            Variation(
                "R1",
                recompose,
                "train1",
                (do("instruct", instruction=ORANGE_THEN_LEMON),),
                "orange, then lemon (B→C)",
                "Known steps are put together in a new way, without the step that always came first.",
                ("behavioral_inertia", "order_violation", "early_halt"),
            ),
            Variation(
                "O1",
                perturb,
                "train1",
                (do("replace", object=APPLE.name, by=BLOCK),),
                "red block where the apple lay, and no apple",
                "What is asked for but is not there is not replaced by something of its color.",
                ("semantic_feature_collapse", "causal_confusion"),
                expected=Expected.REFUSE,
                premise_broken=True,
            ),
            Variation(
                "O2",
                perturb,
                "train1",
                (
                    do("remove", object=LEMON.name),
                    do("move", object=APPLE.name, slot="third"),
                    do("add", object=BLOCK, slot="first"),
                ),
                "red block where the apple lay, apple in the lemon's slot",
                "An apple is told from a block of its color that lies in its place.",
                ("semantic_feature_collapse", "early_halt"),
            ),
            Variation(
                "T1",
                extrapolate,
                "train1",
                (do("preplace", object=APPLE.name, target=LUNCHBOX.name),),
                "apple already in the lunchbox",
                "What is done already is seen, and the work goes on from there.",
                ("phase_conflict", "causal_confusion", "behavioral_inertia"),
                mid_task_look=True,
            ),
            Variation(
                "T2",
                extrapolate,
                "train1",
                (do("replace", object=LEMON.name, by=APPLE_2), do("repeat", instruction=BOTH_APPLES)),
                "two apples to be packed (A→A)",
                "A known step is repeated as often as it is asked for.",
                ("causal_confusion", "behavioral_inertia", "early_halt"),
            ),
        ),
    )
