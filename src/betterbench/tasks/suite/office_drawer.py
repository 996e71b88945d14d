"""Filing office supplies: stapler and tape go into their drawers, and the drawers are closed."""

from __future__ import annotations

from collections.abc import Mapping

from betterbench.tasks.axes import Axis
from betterbench.tasks.condition import Condition, ObjectSpec, Slot, TargetRegion
from betterbench.tasks.registry import task
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.templates import CONTAINER_LOADING
from betterbench.tasks.variation import Variation, do

STAPLER = ObjectSpec("stapler", "stapler", "stapler", "red")
TAPE = ObjectSpec("tape", "tape", "tape_roll", "blue")
BLOCK = ObjectSpec("stapler_block", "stapler-shaped block", "stapler_block", "red", role="distractor")
CABINET = ObjectSpec("cabinet", "cabinet", "drawer_cabinet", role="fixture", fixed=True)
UPPER = ObjectSpec("upper", "upper drawer", "upper_drawer", role="drawer", mount=TargetRegion(CABINET.name, "upper"))
LOWER = ObjectSpec("lower", "lower drawer", "lower_drawer", role="drawer", mount=TargetRegion(CABINET.name, "lower"))

OPEN_M = 0.15
LAYOUTS = (
    {STAPLER.name: "left_back", TAPE.name: "left_front", CABINET.name: "cabinet_back"},
    {TAPE.name: "right_back", STAPLER.name: "right_front", CABINET.name: "cabinet_front"},
)


def load(*steps: tuple[ObjectSpec, ObjectSpec]) -> Instruction:
    """Return the instruction to put things into drawers and to close these."""
    parts = [f"the {thing.kind} into the {drawer.kind}" for thing, drawer in steps]
    close = "close it" if len(steps) == 1 else "close both"
    goals: list[Subgoal] = []
    for thing, drawer in steps:
        word = thing.kind
        goals.append(Subgoal(f"load_{thing.name}", "inside", Reference(kind=thing.kind), drawer.name, word))
        goals.append(
            Subgoal(
                f"close_{drawer.name}",
                "closed",
                Reference(kind=drawer.kind),
                CABINET.name,
                drawer.kind,
                region=drawer.name,
            )
        )
    return Instruction(f"Put {' and '.join(parts)}, then {close}.", tuple(goals))


STAPLER_UP, TAPE_DOWN = load((STAPLER, UPPER)), load((TAPE, LOWER))
STAPLER_DOWN = load((STAPLER, LOWER))
EVERYTHING = load((STAPLER, UPPER), (TAPE, LOWER))


def _train(name: str, layout: Mapping[str, str], instruction: Instruction, opened: ObjectSpec | None) -> Condition:
    objects = (STAPLER, TAPE, CABINET, UPPER, LOWER)
    drawn = {} if opened is None else {opened.name: OPEN_M}
    return Condition("office_drawer", name, objects, layout, instruction, opened=drawn)


def _training() -> tuple[Condition, ...]:
    demonstrations = ((STAPLER_UP, None), (STAPLER_UP, UPPER), (TAPE_DOWN, None), (TAPE_DOWN, LOWER))
    settings = [(layout, *d) for layout in LAYOUTS for d in demonstrations]
    return tuple(_train(f"train{i}", *setting) for i, setting in enumerate(settings, start=1))


@task
def office_drawer() -> Task:
    """Put the named thing into the named drawer of the cabinet and close the drawer.

    The drawers run on rails with friction and stops. While the upper drawer stands open nothing can be put into the
    lower one.

    Randomizations: each thing within 15 mm and 9 degrees of its slot; the look of everything.
    Success: the named thing is in the named drawer, nothing else is in either, and the drawer is pushed home, all at
    rest and released for 0.5 s.
    Premise: the named thing stands in its slot and the drawers are empty.
    """
    shift, recompose, perturb, extrapolate = Axis
    return Task(
        id="office_drawer",
        version=1,
        title="Filing Office Supplies",
        template=CONTAINER_LOADING,
        description="Put the named thing into the named drawer and close it.",
        slots=(
            Slot("left_back", 0.42, -0.28),
            Slot("left_front", 0.60, -0.28),
            Slot("right_back", 0.42, -0.14),
            Slot("right_front", 0.60, -0.14),
            Slot("cabinet_back", 0.46, 0.345, yaw=-1.5708, jitter_m=0.0, yaw_jitter=0.0),
            Slot("cabinet_front", 0.56, 0.345, yaw=-1.5708, jitter_m=0.0, yaw_jitter=0.0),
        ),
        training=_training(),
        variations=(
            Variation(
                "L1",
                shift,
                "train2",
                (do("swap", a=STAPLER.name, b=TAPE.name),),
                "stapler and tape exchanged",
                "Things are found by what they are and not by where they stood in training.",
                ("lexical_kinematic_shortcut", "visual_layout_bias"),
            ),
            Variation(
                "L2",
                shift,
                "train1",
                (do("move", object=CABINET.name, slot="cabinet_front"),),
                "cabinet at its other position",
                "A drawer is found where the cabinet is and not where it was.",
                ("visual_layout_bias", "execution_failure"),
            ),
            Variation(
                "R1",
                recompose,
                "train1",
                (do("instruct", instruction=STAPLER_DOWN),),
                "stapler into the lower drawer",
                "Thing and drawer, each known, are put together in a new way.",
                ("behavioral_inertia", "lexical_kinematic_shortcut"),
            ),
            Variation(
                "O1",
                perturb,
                "train2",
                (
                    do("remove", object=TAPE.name),
                    do("move", object=STAPLER.name, slot="left_front"),
                    do("add", object=BLOCK, slot="left_back"),
                ),
                "stapler-shaped block where the stapler stood",
                "A stapler is told from a block of its shape that stands in its place.",
                ("semantic_feature_collapse",),
            ),
            Variation(
                "T1",
                extrapolate,
                "train3",
                (do("draw_out", drawer=UPPER.name, distance_m=OPEN_M),),
                "open upper drawer blocks the lower one",
                "What stands in the way is seen and put right first.",
                ("behavioral_inertia", "execution_failure", "phase_conflict"),
                mid_task_look=True,
            ),
            Variation(
                "T2",
                extrapolate,
                "train1",
                (do("chain", instruction=EVERYTHING),),
                "load both drawers and close them",
                "A longer chain of known steps is carried to its end.",
                ("early_halt", "causal_confusion", "timeout"),
            ),
        ),
    )
