"""Filing office supplies: stapler and tape go into their drawers, and the drawers are closed."""

from betterbench.tasks import authoring as a

STAPLER = a.item("stapler", color="red")
TAPE = a.item("tape", category="tape_roll", color="blue")
BLOCK = a.distractor("stapler_block", "stapler-shaped block", "stapler_block", "red")
CABINET = a.fixture("cabinet", category="drawer_cabinet", fixed=True)
UPPER, LOWER = a.drawer("upper", "upper_drawer", CABINET), a.drawer("lower", "lower_drawer", CABINET)

LEFT_BACK, LEFT_FRONT = a.Slot("left_back", 0.38, -0.22), a.Slot("left_front", 0.56, -0.21)
RIGHT_BACK, RIGHT_FRONT = a.Slot("right_back", 0.46, -0.20), a.Slot("right_front", 0.64, -0.22)
CABINET_BACK, CABINET_FRONT = (
    a.Slot(f"cabinet_{name}", x, 0.25, yaw=-1.0472, jitter_m=0.0, yaw_jitter=0.0)
    for name, x in (("back", 0.44), ("front", 0.54))
)
OPEN_M = 0.15
LAYOUTS = (
    {STAPLER: LEFT_BACK, TAPE: LEFT_FRONT, CABINET: CABINET_BACK},
    {STAPLER: RIGHT_FRONT, TAPE: RIGHT_BACK, CABINET: CABINET_FRONT},
)


def load(*steps: tuple[a.ObjectSpec, a.ObjectSpec]) -> a.Instruction:
    """Return the instruction to put objects into drawers and close these drawers."""
    parts = [f"the {thing.kind} into the {into.kind}" for thing, into in steps]
    goals: list[a.Subgoal] = []
    for thing, into in steps:
        goals.append(a.subgoal(f"load_{thing.name}", a.INSIDE, thing, into, word=thing.kind))
        goals.append(a.subgoal(f"close_{into.name}", a.CLOSED, into, CABINET, into.name, word=into.kind))
    return a.Instruction(f"Put {' and '.join(parts)}, then close {'it' if len(steps) == 1 else 'both'}.", tuple(goals))


BY_KIND = "Objects are found by their appearance, not by their training slots."
BY_CABINET = "A drawer is found at the cabinet's current position, not at its position in training."
NEW_PAIR = "A known object and a known drawer are combined in a new way."
LOOK_ALIKE = "The policy distinguishes a stapler from a block of the same shape in its slot."
IN_THE_WAY = "An obstacle is noticed and removed first."
LONGER = "The policy completes a sequence of known steps that is longer than any in training."


@a.task
def office_drawer() -> a.Task:
    """Put the named object into the named drawer of the cabinet and close the drawer.

    While the upper drawer is open, the lower drawer cannot be loaded.

    Randomizations: each object is within 15 mm and 9 degrees of its slot. The looks of all objects vary.
    """
    steps = ((STAPLER, UPPER), (TAPE, LOWER))
    demonstrations = tuple((load(step), opened) for step in steps for opened in ({}, {step[1]: OPEN_M}))
    look_alike = (a.remove(TAPE), a.move(STAPLER, LEFT_FRONT), a.add(BLOCK, LEFT_BACK))
    cabinet, block = "cabinet at its other position", "stapler-shaped block in the stapler's slot"
    blocked, stapler_down = "open upper drawer in the way, objects exchanged", a.instruct(load((STAPLER, LOWER)))
    exchanged, in_the_way = a.swap(STAPLER, TAPE), (a.draw_out(UPPER, OPEN_M), a.swap(STAPLER, TAPE))
    return a.Task(
        version=5,
        title="Filing Office Supplies",
        template=a.CONTAINER_LOADING,
        slots=(LEFT_BACK, LEFT_FRONT, RIGHT_BACK, RIGHT_FRONT, CABINET_BACK, CABINET_FRONT),
        training=tuple(a.condition(at, asked, UPPER, LOWER, opened=o) for at in LAYOUTS for asked, o in demonstrations),
        variations=(
            a.Variation("L1", (exchanged,), "stapler and tape exchanged", BY_KIND, "train2"),
            a.Variation("L2", (a.move(CABINET, CABINET_FRONT),), cabinet, BY_CABINET, "train3"),
            a.Variation("R1", (stapler_down,), "stapler into the lower drawer", NEW_PAIR),
            a.Variation("O1", look_alike, block, LOOK_ALIKE, "train2"),
            a.Variation("T1", in_the_way, blocked, IN_THE_WAY, "train3", mid_task_look=True),
            a.Variation("T2", (exchanged, a.chain(load(*steps))), "load both drawers, objects exchanged", LONGER),
        ),
    )
