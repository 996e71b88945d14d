"""Laying the breakfast table: fork, cup and spoon go to their sides of the plate."""

from betterbench.tasks import authoring as a

FORK, CUP, SPOON = a.item("fork"), a.item("cup", color="blue"), a.item("spoon")
PLATE = a.fixture("plate", category="place_plate")
BOWL, SALT = a.distractor("bowl", category="cereal_bowl"), a.distractor("salt", "salt shaker")
JAM, EGG = a.distractor("jam", "jam jar"), a.distractor("egg", "egg cup")
TUMBLER = a.distractor("tumbler", color="blue")

LEFT_EDGE, LEFT_CORNER = (a.Slot(f"left_{n}", x, -0.255, jitter_m=0.010) for n, x in (("edge", 0.52), ("corner", 0.44)))
RIGHT_EDGE, RIGHT_CORNER = (
    a.Slot(f"right_{n}", x, 0.255, jitter_m=0.010) for n, x in (("edge", 0.52), ("corner", 0.44))
)
BACK_LEFT, BACK = a.Slot("back_left", 0.32, -0.15), a.Slot("back", 0.29, 0.24)
FRONT, FRONT_LEFT, FRONT_RIGHT = (
    a.Slot(n, 0.69, y) for n, y in (("front", -0.04), ("front_left", -0.17), ("front_right", 0.13))
)
TABLE_RIGHT = a.Slot("table_right", 0.51, 0.06, jitter_m=0.008, yaw_jitter=0.05)
TABLE_LEFT = a.Slot("table_left", 0.51, -0.06, jitter_m=0.008, yaw_jitter=0.05)
OUTSIDE = (LEFT_EDGE, LEFT_CORNER, FRONT, RIGHT_EDGE, RIGHT_CORNER)
TABLEWARE = {BOWL: BACK_LEFT, SALT: BACK, JAM: FRONT_LEFT}
LAYOUTS = (
    {FORK: LEFT_EDGE, CUP: FRONT, SPOON: RIGHT_EDGE, **TABLEWARE, EGG: FRONT_RIGHT, PLATE: TABLE_RIGHT},
    {FORK: LEFT_CORNER, CUP: FRONT_RIGHT, SPOON: RIGHT_CORNER, **TABLEWARE, EGG: FRONT, PLATE: TABLE_LEFT},
)
F, C, S = (FORK, "left"), (CUP, "upper_right"), (SPOON, "right")


def laid(*steps: tuple[a.ObjectSpec, str]) -> a.Instruction:
    """Return the instruction to lay pieces of tableware next to the plate, each at its own side."""
    return a.arranged(PLATE, *steps, close=True)


BY_KIND = "Known pieces are found among tableware in another arrangement."
BY_ANCHOR = "A side is relative to the plate, not a fixed position on the table."
NEW_PAIR = "A known piece and a known side are combined in a new way."
FORK_OR_SPOON = "The policy distinguishes a fork from a spoon in its slot."
LOOK_ALIKE = "The policy distinguishes a cup from a tumbler of the same color in its slot."
LONGER = "The policy completes a sequence of known steps that is longer than any in training."


@a.task
def breakfast_table() -> a.Task:
    """Lay the named pieces around the plate, among other tableware.

    Sides are from the view of a person in front of the plate and of the front camera.

    Randomizations: each piece is within 15 mm and 9 degrees of its slot, the plate within 8 mm.
    The looks of all objects vary.
    Success: each piece lies next to the plate. The handle of cutlery points to the front; it may lie on any side.
    """
    other_order = (a.swap(CUP, EGG), a.swap(BOWL, JAM), a.swap(BOWL, SALT))
    other_sides = (a.instruct(laid((SPOON, "left"), (CUP, "right"))),)
    look_alike = (a.remove(EGG), a.move(CUP, FRONT_RIGHT), a.add(TUMBLER, FRONT))
    exchanged = "fork and spoon exchanged"
    return a.Task(
        version=10,
        title="Laying the Breakfast Table",
        template=a.PATTERNED_ARRANGEMENT,
        slots=(*OUTSIDE, BACK_LEFT, BACK, FRONT_LEFT, FRONT_RIGHT, TABLE_RIGHT, TABLE_LEFT),
        training=a.conditions(LAYOUTS, (laid(*pair) for pair in ((F, C), (S, F), (C, S)))),
        variations=(
            a.Variation("L1", other_order, "dense set rearranged over the same slots", BY_KIND),
            a.Variation("L2", (a.move(PLATE, TABLE_LEFT),), "plate at its other position", BY_ANCHOR, "train2"),
            a.Variation("R1", other_sides, "spoon left, cup right", NEW_PAIR, "train3"),
            a.Variation("O1", (a.swap(FORK, SPOON),), exchanged, FORK_OR_SPOON),
            a.Variation("O2", look_alike, "tumbler of the cup's color in the cup's slot", LOOK_ALIKE),
            a.Variation("T1", (a.chain(laid(F, C, S)),), "three pieces in one instruction", LONGER),
        ),
    )
