"""Tidying the desk: trash goes into the waste bin, valuables stay."""

from betterbench.tasks import authoring as a

NAPKIN, NAPKIN_2 = a.item("napkin", "crumpled napkin"), a.item("napkin_2", "crumpled napkin")
CAN, FULL_CAN = a.item("crushed_can", color="red"), a.distractor("full_can", category="can", color="red")
MOUSE, MUG = a.distractor("mouse", category="computer_mouse"), a.distractor("mug", color="white")
KEYBOARD, STAPLER = a.distractor("keyboard"), a.distractor("stapler")
TAPE, BIN = a.distractor("tape", "tape roll"), a.container("bin", "waste bin")

TRASH_1, TRASH_2 = a.Slot("trash_1", 0.48, -0.235), a.Slot("trash_2", 0.62, -0.24)
TRASH_3, TRASH_4 = a.Slot("trash_3", 0.475, -0.12), a.Slot("trash_4", 0.605, -0.13, yaw=1.5708)
PLACE_1, PLACE_2 = a.Slot("place_1", 0.33, -0.02), a.Slot("place_2", 0.51, -0.01)
PLACE_3 = a.Slot("place_3", 0.72, 0.042)
FLOOR = a.Slot("floor", 0.52, 0.168, jitter_m=0.005, yaw_jitter=0.0)
UNSEEN_1, UNSEEN_2 = a.Slot("unseen_1", 0.545, -0.225), a.Slot("unseen_2", 0.535, -0.115)
VALUABLES = {MOUSE: PLACE_1, MUG: PLACE_2, KEYBOARD: PLACE_3, BIN: FLOOR}


def throw(text: str, *things: a.ObjectSpec) -> a.Instruction:
    """Return the instruction to throw objects into the waste bin, in any order."""
    return a.Instruction(f"Throw {text} into the waste bin.", a.packed("throw", BIN, *things))


BOTH = throw("the crumpled napkin and the crushed can", NAPKIN, CAN)
NAPKIN_ONLY, CAN_ONLY = throw("the crumpled napkin", NAPKIN), throw("the crushed can", CAN)
THREE = throw("both crumpled napkins and the crushed can", NAPKIN, NAPKIN_2, CAN)

BY_KIND = "Trash is found by its appearance, not by its training slots."
NEW_PLACE = "Trash is found in slots that do not occur in training."
VALUABLE = "A valuable object in a trash slot is not thrown away."
FULL_OR_CRUSHED = "The policy distinguishes a crushed can from a full can of the same color."
WHITE = "The policy distinguishes a white napkin from a white mug among more objects than usual."
LONGER = (
    "The policy completes a sequence of known steps that is longer than any in training and contains one step twice."
)


@a.task
def tidy_desk() -> a.Task:
    """Throw the named trash into the waste bin; mouse, mug and keyboard stay.

    In all layouts, napkins are in trash_1 or trash_3 and cans in trash_2 or trash_4; this is the confound.

    Randomizations: each object is within 15 mm and 9 degrees of its slot. The looks of all objects vary.
    """
    layouts = ({NAPKIN: TRASH_1, CAN: TRASH_2}, {NAPKIN: TRASH_3, CAN: TRASH_4}, {NAPKIN: TRASH_1, CAN: TRASH_4})
    settings = (*((trash, BOTH) for trash in layouts), (layouts[2], NAPKIN_ONLY), (layouts[0], CAN_ONLY))
    permuted = (a.swap(NAPKIN, CAN), a.swap(MOUSE, MUG), a.swap(MUG, KEYBOARD))
    mouse = (a.move(NAPKIN, TRASH_3), a.move(MOUSE, TRASH_1))
    mug = (a.move(NAPKIN, TRASH_3), a.move(MUG, TRASH_1), a.add(TAPE, PLACE_2), a.add(STAPLER, TRASH_2))
    full = (a.move(CAN, TRASH_3), a.add(FULL_CAN, TRASH_2))
    unseen = (a.move(NAPKIN, UNSEEN_1), a.move(CAN, UNSEEN_2))
    three = (a.add(NAPKIN_2, TRASH_3), a.chain(THREE))
    novel = a.Support.NOVEL
    return a.Task(
        version=7,
        title="Tidying the Desk",
        template=a.LOOSE_PACKING,
        slots=(TRASH_1, TRASH_2, TRASH_3, TRASH_4, PLACE_1, PLACE_2, PLACE_3, FLOOR, UNSEEN_1, UNSEEN_2),
        training=tuple(a.condition({**trash, **VALUABLES}, asked) for trash, asked in settings),
        variations=(
            a.Variation("L1", permuted, "kinds of trash exchanged, valuables permuted", BY_KIND, "train5"),
            a.Variation("L2", unseen, "trash in unseen slots", NEW_PLACE, support=novel),
            a.Variation("O1", mouse, "computer mouse in the napkin's slot", VALUABLE, "train3"),
            a.Variation(
                "O2", full, "full can in the crushed can's slot, both in trash slots", FULL_OR_CRUSHED, "train5"
            ),
            a.Variation("O3", mug, "white mug in the napkin's slot, with more objects than usual", WHITE, "train3"),
            a.Variation("T1", three, "three pieces of trash", LONGER),
        ),
    )
