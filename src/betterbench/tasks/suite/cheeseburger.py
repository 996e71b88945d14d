"""Assembling a cheeseburger: layers go onto the bottom bun in the order in which they are named."""

from __future__ import annotations

from betterbench.tasks.axes import Axis
from betterbench.tasks.condition import Condition, ObjectSpec, Slot
from betterbench.tasks.registry import task
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.templates import LOGICAL_ASSEMBLY
from betterbench.tasks.variation import Variation, do

PATTY = ObjectSpec("patty", "patty", "patty")
PATTY_2 = ObjectSpec("patty_2", "patty", "patty")
CHEESE = ObjectSpec("cheese", "cheese", "cheese_slice")
LETTUCE = ObjectSpec("lettuce", "lettuce", "lettuce_leaf")
TOP = ObjectSpec("top_bun", "top bun", "bun_top")
BASE = ObjectSpec("bottom_bun", "bottom bun", "bun_bottom", role="container")
SPONGE = ObjectSpec("sponge", "sponge", "sponge", role="distractor")

LAYOUT = {
    PATTY.name: "first",
    CHEESE.name: "second",
    LETTUCE.name: "third",
    TOP.name: "fourth",
    BASE.name: "stand",
}


def stack(*things: ObjectSpec) -> Instruction:
    """Return the instruction to stack layers on the bottom bun, from below."""
    names = [f"the {t.kind}" for t in things]
    if names[0] == names[1]:
        names[1] = "another patty"
    text = f"Put {names[0]} on the bottom bun, then {', then '.join(names[1:])}."
    return Instruction(
        text,
        tuple(
            Subgoal(
                f"layer_{i}_{t.kind.replace(' ', '_')}",
                "layer",
                Reference(kind=t.kind),
                BASE.name,
                t.kind,
                region=str(i),
            )
            for i, t in enumerate(things, start=1)
        ),
        ordered=True,
    )


def _train(name: str, instruction: Instruction) -> Condition:
    return Condition("cheeseburger", name, (PATTY, CHEESE, LETTUCE, TOP, BASE), LAYOUT, instruction)


@task
def cheeseburger() -> Task:
    """Stack the named layers on the bottom bun, in the order in which they are named.

    Randomizations: each layer within 15 mm and 9 degrees of its slot; the look of everything.
    Success: the layers lie on each other in the named order, each centered within 20 mm of the bun and flat, nothing
    else lies there, at rest and released for 0.5 s.
    Premise: the named layers lie in their slots and the bottom bun is bare; in T1 the patty lies on it.
    """
    shift, recompose, perturb, extrapolate = Axis
    return Task(
        id="cheeseburger",
        version=1,
        title="Assembling a Cheeseburger",
        template=LOGICAL_ASSEMBLY,
        description="Stack the named layers on the bottom bun in the named order.",
        slots=(
            Slot("first", 0.42, -0.27),
            Slot("second", 0.60, -0.27),
            Slot("third", 0.42, -0.09),
            Slot("fourth", 0.60, -0.09),
            Slot("stand", 0.50, 0.17, jitter_m=0.005, yaw_jitter=0.0),
        ),
        training=(_train("train1", stack(PATTY, CHEESE, TOP)), _train("train2", stack(PATTY, LETTUCE, TOP))),
        variations=(
            Variation(
                "L1",
                shift,
                "train1",
                (do("swap", a=PATTY.name, b=CHEESE.name),),
                "patty and cheese exchanged",
                "Layers are found by what they are and not by where they lay in training.",
                ("lexical_kinematic_shortcut", "visual_layout_bias"),
            ),
            Variation(
                "R1",
                recompose,
                "train2",
                (do("instruct", instruction=stack(CHEESE, LETTUCE, TOP)),),
                "cheese, lettuce, top bun (B→C)",
                "Known steps are put together in a new way, without the step that always came first.",
                ("behavioral_inertia", "order_violation"),
            ),
            Variation(
                "R2",
                recompose,
                "train1",
                (do("instruct", instruction=stack(CHEESE, PATTY, TOP)),),
                "cheese, patty, top bun",
                "Known steps are carried out in an order never shown.",
                ("behavioral_inertia", "order_violation"),
            ),
            Variation(
                "O1",
                perturb,
                "train1",
                (
                    do("remove", object=LETTUCE.name),
                    do("move", object=CHEESE.name, slot="third"),
                    do("add", object=SPONGE, slot="second"),
                ),
                "yellow sponge where the cheese lay",
                "Cheese is told from a sponge of its color and shape that lies in its place.",
                ("semantic_feature_collapse",),
            ),
            Variation(
                "T1",
                extrapolate,
                "train1",
                (do("preplace", object=PATTY.name, target=BASE.name, at="1"),),
                "patty already on the bun",
                "What is done already is seen, and the work goes on from there.",
                ("phase_conflict", "causal_confusion", "behavioral_inertia"),
                mid_task_look=True,
            ),
            Variation(
                "T2",
                extrapolate,
                "train1",
                (
                    do("replace", object=CHEESE.name, by=PATTY_2),
                    do("repeat", instruction=stack(PATTY, PATTY_2, TOP)),
                ),
                "patty, patty, top bun",
                "A known step is repeated as often as it is asked for.",
                ("causal_confusion", "behavioral_inertia"),
            ),
        ),
    )
