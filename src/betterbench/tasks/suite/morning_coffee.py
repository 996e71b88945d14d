"""Preparing morning coffee: the instructed mug goes onto the marked ring of the coffee machine."""

from betterbench.tasks import authoring as a

RED_MUG, BLUE_MUG = a.item("red_mug", category="mug", color="red"), a.item("blue_mug", category="mug", color="blue")
RED_CAN = a.distractor("red_can", category="can", color="red")
MACHINE = a.fixture("coffee_machine", fixed=True)

NEAR, FAR = a.Slot("near", 0.60, -0.13, yaw=-1.5708), a.Slot("far", 0.42, -0.14, yaw=-1.5708)
STAND = a.Slot("machine", 0.52, 0.19, yaw=-1.5708, jitter_m=0.0, yaw_jitter=0.0)
LAYOUT_1 = {RED_MUG: NEAR, BLUE_MUG: FAR, MACHINE: STAND}
LAYOUT_2 = {RED_MUG: FAR, BLUE_MUG: NEAR, MACHINE: STAND}


def place(word: str, mug: a.ObjectSpec | a.Reference) -> a.Instruction:
    """Return the instruction to put the mug that ``word`` refers to onto the ring of the coffee machine."""
    step = a.subgoal("place_mug", a.ON_RING, mug, MACHINE, word=word)
    text = f"Put the {word} mug inside the ring of the coffee machine, its handle not facing the machine."
    return a.Instruction(text, (step,))


RED, BLUE = place("red", RED_MUG), place("blue", BLUE_MUG)
TOP, BOTTOM = place("top", a.Reference(slot=FAR.name)), place("bottom", a.Reference(slot=NEAR.name))

PLACE_WORD = "A position word is understood in a layout for which training did not use it."
COLOR_WORD = "A color word refers to the object, not to the object's training slot."
LOOK_ALIKE = "The policy distinguishes the red mug from another red object in its slot."
DONE = "The policy recognizes that the goal is already met and does not move."


@a.task
def morning_coffee() -> a.Task:
    """Put the instructed mug on the marked ring under the spout.

    "Near" and "far" are seen from the front camera: the far slot is at the top of the image, close to the robot. In the
    twins of L1 to L4, the instruction names the other mug of the same scene.

    Randomizations: each mug is within 15 mm and 9 degrees of its slot. The looks of mugs and machine vary.
    Success: the handle is clear of the spout. In T1, the red mug is already on the ring, and no object may be touched.
    """
    look_alike = (a.remove(BLUE_MUG), a.move(RED_MUG, FAR), a.add(RED_CAN, NEAR))
    done, still = (a.preplace(RED_MUG, MACHINE),), a.Expected.STAY_STILL
    return a.Task(
        version=5,
        title="Preparing Morning Coffee",
        template=a.CONSTRAINED_POSITIONING,
        slots=(NEAR, FAR, STAND),
        training=a.conditions([LAYOUT_1], [RED, BLUE]) + a.conditions([LAYOUT_2], [TOP, BOTTOM]),
        variations=(
            a.Variation("L1", (a.instruct(TOP),), "layout 1, top", PLACE_WORD),
            a.Variation("L2", (a.instruct(BOTTOM),), "layout 1, bottom", PLACE_WORD, "train2"),
            a.Variation("L3", (a.instruct(RED),), "layout 2, red", COLOR_WORD, "train4"),
            a.Variation("L4", (a.instruct(BLUE),), "layout 2, blue", COLOR_WORD, "train3"),
            a.Variation("O1", look_alike, "red can in the red mug's slot", LOOK_ALIKE),
            a.Variation("T1", done, "red mug already on the ring", DONE, expected=still, mid_task_look=True),
        ),
    )
