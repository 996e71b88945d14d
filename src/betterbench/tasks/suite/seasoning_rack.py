"""Filling the seasoning rack: salt, pepper and paprika go into their holes."""

from betterbench.tasks import authoring as a

JARS = {"salt": "white", "pepper": "black", "paprika": "red"}
SALT, PEPPER, PAPRIKA = (a.item(name, f"{name} jar", "spice_jar", color) for name, color in JARS.items())
PLAIN_SALT, PLAIN_PEPPER, PLAIN_PAPRIKA = (
    a.item(f"plain_{name}", f"{name} jar", f"plain_{name}_jar", "gray") for name in JARS
)
PILLS = a.distractor("pill_bottle")
RACK = a.fixture("rack", category="spice_rack", fixed=True)

FIRST, SECOND, THIRD = a.Slot("first", 0.42, -0.22), a.Slot("second", 0.60, -0.20), a.Slot("third", 0.51, -0.09)
STAND = a.Slot("stand", 0.52, 0.13, jitter_m=0.0, yaw_jitter=0.0)
LAYOUT = {SALT: FIRST, PEPPER: SECOND, PAPRIKA: THIRD, RACK: STAND}
HOLES = {"hole_1": "left", "hole_2": "middle", "hole_3": "right"}


def insert(*steps: tuple[a.ObjectSpec, str]) -> a.Instruction:
    """Return the instruction to put jars into holes of the rack, in any order."""
    parts = [f"the {jar.kind} into the {HOLES[hole]} hole" for jar, hole in steps]
    text = ", ".join(parts[:-1]) + (" and " if len(parts) > 1 else "") + parts[-1]
    words = [jar.kind.split()[0] for jar, _ in steps]
    goals = (
        a.subgoal(f"{word}_{hole}", a.IN_HOLE, jar, RACK, hole, word=word)
        for word, (jar, hole) in zip(words, steps, strict=True)
    )
    return a.Instruction(f"Put {text} of the rack.", tuple(goals))


S, P, R = (SALT, "hole_1"), (PEPPER, "hole_2"), (PAPRIKA, "hole_3")

BY_KIND = "Jars are found by their appearance, not by their training slots."
BY_HOLE = "A hole is found by its position in the rack, regardless of the content of the other holes."
NEW_PAIR = "A known jar and a known hole are combined in a new way."
LOOK_ALIKE = "The policy distinguishes salt from a pill bottle of the same shape in its slot."
LABELS = "Jars are distinguished by their labels alone."
LONGER = "The policy completes a sequence of known steps that is longer than any in training."


@a.task
def seasoning_rack() -> a.Task:
    """Put the named jars into the named holes of the rack; the clearance is 2.7 mm on each side.

    Left, middle and right are from the front camera's view: holes 1, 2 and 3.

    Randomizations: each jar is within 15 mm and 9 degrees of its slot. The looks of all objects vary.
    """
    filled = (a.preplace(PEPPER, RACK, "hole_2"), a.preplace(PAPRIKA, RACK, "hole_3"), a.move(SALT, SECOND))
    crossed = a.instruct(insert((SALT, "hole_3"), (PAPRIKA, "hole_1")))
    look_alike = (a.remove(PAPRIKA), a.move(SALT, THIRD), a.add(PILLS, FIRST))
    plain = (a.replace(SALT, PLAIN_SALT), a.replace(PEPPER, PLAIN_PEPPER), a.replace(PAPRIKA, PLAIN_PAPRIKA))
    exchanged = (*plain, a.swap(PLAIN_SALT, PLAIN_PEPPER))
    row = "three jars in a row, pepper and paprika exchanged"
    alike = "same cap and body on every jar, salt and pepper exchanged"
    return a.Task(
        version=5,
        title="Filling the Seasoning Rack",
        template=a.PRECISION_INSERTION,
        slots=(FIRST, SECOND, THIRD, STAND),
        training=a.conditions([LAYOUT], (insert(*jars) for jars in ((S,), (P,), (R,), (S, P), (P, R), (R, S)))),
        variations=(
            a.Variation("L1", (a.swap(SALT, PEPPER),), "salt and pepper exchanged", BY_KIND, "train4"),
            a.Variation("L2", filled, "the other holes filled, salt in the pepper's slot", BY_HOLE, mid_task_look=True),
            a.Variation("R1", (crossed,), "salt into the right hole, paprika into the left", NEW_PAIR, "train6"),
            a.Variation("O1", look_alike, "pill bottle in the salt's slot", LOOK_ALIKE, "train4"),
            a.Variation("O2", exchanged, alike, LABELS, "train4"),
            a.Variation("T1", (a.swap(PEPPER, PAPRIKA), a.chain(insert(S, P, R))), row, LONGER, "train4"),
        ),
    )
