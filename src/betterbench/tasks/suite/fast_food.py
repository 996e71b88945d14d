"""Packing a fast food order: burger, fries and drink go into the takeaway box in the order in which they are named."""

from __future__ import annotations

from betterbench.tasks.axes import Axis
from betterbench.tasks.condition import Condition, ObjectSpec, Slot
from betterbench.tasks.registry import task
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.templates import LOOSE_PACKING
from betterbench.tasks.variation import Variation, do

BURGER_1 = ObjectSpec("burger_1", "burger", "burger")
BURGER_2 = ObjectSpec("burger_2", "burger", "burger")
FRIES = ObjectSpec("fries", "fries", "fries_box")
DRINK = ObjectSpec("drink", "drink", "drink_cup")
BOX = ObjectSpec("box", "box", "takeaway_box", role="container")
BLOCK = ObjectSpec("round_block", "round block", "round_block", role="distractor")

LAYOUT = {
    BURGER_1.name: "first",
    BURGER_2.name: "second",
    FRIES.name: "third",
    DRINK.name: "fourth",
    BOX.name: "stand",
}


def pack(kind: str, *, count: int = 1) -> Subgoal:
    """Return the subgoal to pack the ``count``-th object of a kind."""
    name = f"pack_{kind}" if count == 1 else f"pack_{kind}_{count}"
    return Subgoal(name, "inside", Reference(kind=kind), BOX.name, kind, count)


A, A_AGAIN, B, C = pack("burger"), pack("burger", count=2), pack("fries"), pack("drink")


def order(text: str, *subgoals: Subgoal) -> Instruction:
    """Return an instruction whose order is part of the goal."""
    return Instruction(text, subgoals, ordered=True)


BURGER_THEN_FRIES = order("Put a burger into the takeaway box, then the fries.", A, B)
BURGER_THEN_DRINK = order("Put a burger into the takeaway box, then the drink.", A, C)
FRIES_THEN_DRINK = order("Put the fries into the takeaway box, then the drink.", B, C)
DRINK_THEN_FRIES = order("Put the drink into the takeaway box, then the fries.", C, B)
EVERYTHING = order("Put both burgers into the takeaway box, then the fries, then the drink.", A, A_AGAIN, B, C)


def _train(name: str, instruction: Instruction) -> Condition:
    return Condition("fast_food", name, (BURGER_1, BURGER_2, FRIES, DRINK, BOX), LAYOUT, instruction)


@task
def fast_food() -> Task:
    """Pack the ordered food into the takeaway box, in the order in which it is named.

    Randomizations: each item within 15 mm and 9 degrees of its slot; the look of every item. In training either burger
    is packed, and always a burger comes first.
    Success: what was named is in the box, nothing else is, packed in the named order, at rest and released for 0.5 s.
    Premise: what is named stands in its slot and the box is empty.
    """
    shift, recompose, perturb, extrapolate = Axis
    inertia = ("behavioral_inertia", "order_violation", "early_halt")
    return Task(
        id="fast_food",
        version=1,
        title="Packing a Fast Food Order",
        template=LOOSE_PACKING,
        description="Put the named food into the takeaway box in the named order.",
        slots=(
            Slot("first", 0.42, -0.30),
            Slot("second", 0.60, -0.30),
            Slot("third", 0.42, -0.11),
            Slot("fourth", 0.60, -0.11),
            Slot("stand", 0.50, 0.21, jitter_m=0.005, yaw_jitter=0.03),
        ),
        training=(_train("train1", BURGER_THEN_FRIES), _train("train2", BURGER_THEN_DRINK)),
        variations=(
            Variation(
                "L1",
                shift,
                "train1",
                (do("swap", a=BURGER_1.name, b=FRIES.name),),
                "burger and fries exchanged",
                "Food is found by what it is and not by where it stood in training.",
                ("lexical_kinematic_shortcut", "visual_layout_bias"),
            ),
            Variation(
                "R1",
                recompose,
                "train1",
                (do("instruct", instruction=FRIES_THEN_DRINK),),
                "fries, then drink (B→C)",
                "Known steps are put together in a new way, without the step that always came first.",
                inertia,
            ),
            Variation(
                "R2",
                recompose,
                "train2",
                (do("instruct", instruction=DRINK_THEN_FRIES),),
                "drink, then fries (C→B)",
                "Known steps are put together in a new way, without the step that always came first.",
                inertia,
            ),
            Variation(
                "O1",
                perturb,
                "train1",
                (do("replace", object=BURGER_1.name, by=BLOCK),),
                "round block where the first burger stood",
                "A burger is told from a block of its color and shape that stands in its place.",
                ("semantic_feature_collapse",),
            ),
            Variation(
                "T1",
                extrapolate,
                "train1",
                (do("remove", object=BURGER_2.name),),
                "one burger at the start",
                "Progress is known from what was done and not from how many burgers are left.",
                ("causal_confusion", "phase_conflict"),
                mid_task_look=True,
            ),
            Variation(
                "T2",
                extrapolate,
                "train1",
                (do("chain", instruction=EVERYTHING),),
                "both burgers, fries and drink (A→A→B→C)",
                "A longer chain of known steps, one of them repeated, is carried to its end.",
                ("causal_confusion", "early_halt", "timeout"),
            ),
        ),
    )
