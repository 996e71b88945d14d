"""Packing a fruit basket with the SO-101: the paper's real-world experiment, with its two diagnostic matrices."""

from betterbench.tasks import authoring as a
from betterbench.tasks.authoring.condition_matrix import Horizon, State
from betterbench.tasks.authoring.operations import Operation

LEMON, MANGOSTEEN = a.item("lemon"), a.item("mangosteen")
BLOCK, SOAP = a.distractor("block", color="red"), a.distractor("soap_bar", color="white")
BASKET = a.container("basket", "fruit basket")

# The slots are 14 to 26 cm from the first axis of the arm, which is at x = 0.039 m. They are at least 15 cm from the
# initial position of the tool, because an open gripper that rests above an object counts as an interaction. Both
# layouts use the same four slots.
NEAR = a.Slot("near", 0.118, 0.127, jitter_m=0.01)
RIGHT = a.Slot("right", 0.257, 0.142, jitter_m=0.01)
MIDDLE = a.Slot("middle", 0.180, 0.218, jitter_m=0.01)
LEFT = a.Slot("left", 0.074, 0.248, jitter_m=0.01)
UNTRAINED = a.Slot("untrained", 0.026, 0.149, jitter_m=0.01)
STAND = a.Slot("stand", 0.185, -0.185, jitter_m=0.005, yaw_jitter=0.15)
LAYOUT_1 = {LEMON: RIGHT, MANGOSTEEN: MIDDLE, BLOCK: NEAR, SOAP: LEFT, BASKET: STAND}
LAYOUT_2 = {LEMON: LEFT, MANGOSTEEN: NEAR, BLOCK: MIDDLE, SOAP: RIGHT, BASKET: STAND}

ALL_FRUITS = "Put all the fruits into the fruit basket."
ONE = a.ordered("Put the lemon into the fruit basket.", *a.packed("pack", BASKET, LEMON))


def fruits(*present: a.ObjectSpec) -> a.Instruction:
    """Return the instruction to pack all fruits, with one step for each fruit in the scene, in any order."""
    steps = (a.subgoal(f"pack_{fruit.name}", a.INSIDE, fruit, BASKET, word="fruits") for fruit in present)
    return a.Instruction(ALL_FRUITS, tuple(steps))


BOTH = fruits(LEMON, MANGOSTEEN)

SHORT = "With one step, a success shows only that the policy finds the target and recognizes its state."
DONE = "The policy recognizes that the lemon is in the basket and does not move."
BROKEN = "The premise is broken: the trial shows the policy's behavior without its target, which is not judged."
ENDS = "After the first fruit, the policy looks for a second fruit and does not grasp at its training slot."
RESUMES = "The policy infers progress from the scene, even though the arm starts at home."
SKIPS = "The policy skips the first step of the memorized sequence if its object is absent."
PLACE = "The policy goes to the target's current position, not to its position in training."

STILL, AMBIGUOUS = a.Expected.STAY_STILL, a.Expected.AMBIGUOUS


def _cells(*rows: tuple[tuple[str, str], ...]) -> tuple[a.MatrixCell, ...]:
    """Return the cells of a matrix. Each row lists the names of the conditions and the outcome in the paper's table."""
    return tuple(
        a.MatrixCell(row, column, tuple(names.split()), paper)
        for row, told in zip(State, rows, strict=True)
        for column, (names, paper) in zip(State, told, strict=True)
    )


SHORT_MATRIX = a.ConditionMatrix(
    Horizon.SHORT,
    "lemon",
    "mangosteen",
    _cells(
        (
            ("train1 train2", "success: grasps the target"),
            ("O1", "success: grasps the target"),
            ("O2", "success: grasps the target"),
        ),
        (
            ("T1", "correct freeze: sees that it is done"),
            ("T2", "correct freeze: sees that it is done"),
            ("T3", "correct freeze: sees that it is done"),
        ),
        (
            ("O3", "ambiguous: grasps the distractor"),
            ("O4", "ambiguous: freezes or air grasp"),
            ("O5", "ambiguous: air grasp"),
        ),
    ),
)
"""Outcomes in the paper for "Put the lemon into the fruit basket.". The mangosteen is the distractor."""

LONG_MATRIX = a.ConditionMatrix(
    Horizon.LONG,
    "lemon",
    "mangosteen",
    _cells(
        (
            ("train3 train4", "success: packs both"),
            ("T4", "success: packs the first, ends"),
            ("O6", "behavioral inertia: packs the first, air grasp"),
        ),
        (
            ("T5", "phase conflict I: freezes or skips"),
            ("T6", "success: sees that it is done"),
            ("T7", "phase conflict II: oscillates or air grasp"),
        ),
        (
            ("O7", "success: packs the second"),
            ("O8", "correct freeze: sees that it is done"),
            ("O9", "ambiguous: air grasp"),
        ),
    ),
)
"""Outcomes in the paper for "Put all the fruits into the fruit basket."."""


@a.task
def fruit_basket() -> a.Task:
    """Put the lemon, or all the fruits, into the fruit basket with the SO-101.

    The tablecloth is blue if the lemon is requested and green if all the fruits are requested. In the short-horizon
    matrix, the mangosteen is the distractor: demonstrations put it into the basket, so that a mangosteen in the
    basket is at its final position in training. A red block and a bar of soap lie on the table in every condition.

    "All the fruits" means the fruits in the scene. If a fruit is absent, the instruction has no step for this fruit.

    Randomizations: each object is within 10 mm and 9 degrees of its slot, the basket within 5 mm.
    The looks of all objects vary.
    Success: in O3, O4, O5 and O9, the premise is broken, and no behavior counts as a failure.
    """
    in_basket, gone = a.preplace(MANGOSTEEN, BASKET), a.remove(MANGOSTEEN)
    lemon_in, no_lemon = a.preplace(LEMON, BASKET), a.remove(LEMON)
    only_lemon, only_mangosteen = a.instruct(fruits(LEMON)), a.instruct(fruits(MANGOSTEEN))

    def short(name: str, *do: Operation, title: str, says: str, expected: a.Expected = STILL) -> a.Variation:
        return a.Variation(
            name, do, title, says, "train1", expected, mid_task_look=lemon_in in do, premise_broken=no_lemon in do
        )

    def long(name: str, *do: Operation, title: str, says: str, expected: a.Expected = STILL) -> a.Variation:
        broken = expected is AMBIGUOUS
        started = lemon_in in do or in_basket in do
        # After the lemon, the paper's policy grasps at the slot of the missing mangosteen. 10 s are enough to show
        # this.
        watch = 200 if expected is a.Expected.SUCCEED and lemon_in not in do and no_lemon not in do else 0
        return a.Variation(
            name, do, title, says, "train3", expected, mid_task_look=started, premise_broken=broken, watch_steps=watch
        )

    succeed = a.Expected.SUCCEED
    return a.Task(
        version=2,
        title="Packing a Fruit Basket",
        template=a.LOOSE_PACKING,
        slots=(NEAR, RIGHT, MIDDLE, LEFT, UNTRAINED, STAND),
        training=tuple(
            a.condition(layout, asked, cloth=cloth)
            for asked, cloth in ((ONE, "blue"), (BOTH, "green"))
            for layout in (LAYOUT_1, LAYOUT_2)
        ),
        variations=(
            a.Variation("L1", (a.move(LEMON, UNTRAINED),), "lemon in an unseen slot", PLACE, support=a.Support.NOVEL),
            a.Variation("L2", (a.swap(LEMON, BLOCK),), "lemon in the block's slot", PLACE),
            short("O1", in_basket, title="mangosteen in the basket", says=SHORT, expected=succeed),
            short("O2", gone, title="no mangosteen", says=SHORT, expected=succeed),
            short("T1", lemon_in, title="lemon in the basket", says=DONE),
            short("T2", lemon_in, in_basket, title="both fruits in the basket", says=DONE),
            short("T3", lemon_in, gone, title="lemon in the basket, no mangosteen", says=DONE),
            short("O3", no_lemon, title="no lemon", says=BROKEN, expected=AMBIGUOUS),
            short(
                "O4", no_lemon, in_basket, title="no lemon, mangosteen in the basket", says=BROKEN, expected=AMBIGUOUS
            ),
            short("O5", no_lemon, gone, title="neither fruit", says=BROKEN, expected=AMBIGUOUS),
            long("T4", in_basket, title="all fruits, mangosteen in the basket", says=RESUMES, expected=succeed),
            long("O6", gone, only_lemon, title="all fruits, no mangosteen", says=ENDS, expected=succeed),
            long("T5", lemon_in, title="all fruits, lemon in the basket", says=RESUMES, expected=succeed),
            long("T6", lemon_in, in_basket, title="all fruits, both in the basket", says=RESUMES),
            long(
                "T7", lemon_in, gone, only_lemon, title="all fruits, lemon in the basket, no mangosteen", says=RESUMES
            ),
            long("O7", no_lemon, only_mangosteen, title="all fruits, no lemon", says=SKIPS, expected=succeed),
            long(
                "O8",
                no_lemon,
                in_basket,
                only_mangosteen,
                title="all fruits, no lemon, mangosteen in the basket",
                says=SKIPS,
            ),
            long("O9", no_lemon, gone, title="all fruits, none present", says=BROKEN, expected=AMBIGUOUS),
        ),
        robot="so101",
        matrices=(SHORT_MATRIX, LONG_MATRIX),
    )
