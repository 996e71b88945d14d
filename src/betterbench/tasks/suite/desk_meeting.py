"""Preparing a desk meeting: mouse, mug and speaker go to their sides of the laptop."""

import itertools

from betterbench.tasks import authoring as a

MOUSE, MUG, SPEAKER = a.item("mouse", category="computer_mouse"), a.item("mug", color="blue"), a.item("speaker")
LAPTOP = a.fixture("laptop")
SOAP = a.distractor("soap_bar", color="gray")

FRONT_1, FRONT_2, FRONT_3 = (a.Slot(f"front_{i}", 0.68, y) for i, y in ((1, -0.202), (2, -0.012), (3, 0.178)))
FRONT_4, FRONT_5, FRONT_6 = (a.Slot(f"front_{i}", 0.68, y) for i, y in ((4, -0.178), (5, 0.012), (6, 0.202)))
DESK_RIGHT = a.Slot("desk_right", 0.49, 0.023, jitter_m=0.010, yaw_jitter=0.05)
DESK_LEFT = a.Slot("desk_left", 0.49, -0.023, jitter_m=0.010, yaw_jitter=0.05)
LAYOUTS = (
    {MOUSE: FRONT_1, MUG: FRONT_2, SPEAKER: FRONT_3, LAPTOP: DESK_RIGHT},
    {MOUSE: FRONT_5, MUG: FRONT_6, SPEAKER: FRONT_4, LAPTOP: DESK_LEFT},
)
TRAINED = {MOUSE: "right", MUG: "left", SPEAKER: "behind"}


def put(*steps: tuple[a.ObjectSpec, str]) -> a.Instruction:
    """Return the instruction to put objects at sides of the laptop."""
    return a.arranged(LAPTOP, *steps)


BY_KIND = "Objects are found by their appearance, not by their training slots."
BY_ANCHOR = "A side is relative to the laptop, not a fixed position on the table."
NEW_PAIR = "A known object and a known side are combined in a new way."
LOOK_ALIKE = "The policy distinguishes the mouse from a soap bar of the same shape in its slot."
LONGER = "The policy completes a sequence of known steps that is longer than any in training."


@a.task
def desk_meeting() -> a.Task:
    """Put the named objects to the named sides of the laptop.

    Sides are from the view of a person in front of the laptop and of the front camera.

    Randomizations: each object is within 15 mm and 9 degrees of its slot, the laptop within 10 mm.
    The looks of all objects vary.
    Success: each object stands at its side of the laptop, at any position and rotation.
    """
    pairs = itertools.permutations(TRAINED.items(), 2)
    look_alike = (a.remove(SPEAKER), a.move(MOUSE, FRONT_3), a.add(SOAP, FRONT_1))
    mug_right, speaker_left = put((MUG, "right"), (MOUSE, "left")), put((SPEAKER, "left"), (MUG, "right"))
    return a.Task(
        version=7,
        title="Preparing a Desk Meeting",
        template=a.PATTERNED_ARRANGEMENT,
        slots=(FRONT_1, FRONT_2, FRONT_3, FRONT_4, FRONT_5, FRONT_6, DESK_RIGHT, DESK_LEFT),
        training=a.conditions(LAYOUTS, (put(*pair) for pair in pairs)),
        variations=(
            a.Variation("L1", (a.swap(MOUSE, MUG),), "mouse and mug exchange their slots", BY_KIND),
            a.Variation("L2", (a.move(LAPTOP, DESK_LEFT),), "laptop at its other position", BY_ANCHOR, "train4"),
            a.Variation("R1", (a.instruct(mug_right),), "mug right, mouse left", NEW_PAIR),
            a.Variation("R2", (a.instruct(speaker_left),), "speaker left, mug right", NEW_PAIR, "train6"),
            a.Variation("O1", look_alike, "gray soap bar in the mouse's slot", LOOK_ALIKE),
            a.Variation("T1", (a.chain(put(*TRAINED.items())),), "all three in one instruction", LONGER),
        ),
    )
