"""Filling the seasoning rack: salt, pepper and paprika go into their holes."""

from __future__ import annotations

from betterbench.tasks.axes import Axis
from betterbench.tasks.condition import Condition, ObjectSpec, Slot
from betterbench.tasks.registry import task
from betterbench.tasks.subgoal import Instruction, Reference, Subgoal
from betterbench.tasks.task import Task
from betterbench.tasks.templates import PRECISION_INSERTION
from betterbench.tasks.variation import Variation, do

SALT = ObjectSpec("salt", "white salt jar", "spice_jar", "white")
PEPPER = ObjectSpec("pepper", "black pepper jar", "spice_jar", "black")
PAPRIKA = ObjectSpec("paprika", "red paprika jar", "spice_jar", "red")
PLAIN_SALT = ObjectSpec("plain_salt", "white salt jar", "plain_jar", "white")
PLAIN_PEPPER = ObjectSpec("plain_pepper", "black pepper jar", "plain_jar", "black")
PLAIN_PAPRIKA = ObjectSpec("plain_paprika", "red paprika jar", "plain_jar", "red")
PILLS = ObjectSpec("pill_bottle", "pill bottle", "pill_bottle", role="distractor")
RACK = ObjectSpec("rack", "rack", "spice_rack", role="fixture", fixed=True)

LAYOUT = {SALT.name: "first", PEPPER.name: "second", PAPRIKA.name: "third", RACK.name: "stand"}
HOLES = {"hole_1": "left", "hole_2": "middle", "hole_3": "right"}
TRAINED = {SALT.kind: "hole_1", PEPPER.kind: "hole_2", PAPRIKA.kind: "hole_3"}


def insert(*steps: tuple[ObjectSpec, str]) -> Instruction:
    """Return the instruction to put jars into holes of the rack, in any order."""
    parts = [f"the {jar.kind} into the {HOLES[hole]} hole" for jar, hole in steps]
    text = ", ".join(parts[:-1]) + (" and " if len(parts) > 1 else "") + parts[-1]
    return Instruction(
        f"Put {text} of the rack.",
        tuple(
            Subgoal(f"{jar.kind.split()[1]}_{hole}", "in_hole", Reference(kind=jar.kind), RACK.name, word, region=hole)
            for jar, hole in steps
            for word in [jar.kind.split()[1]]
        ),
    )


def _trained(*jars: ObjectSpec) -> Instruction:
    return insert(*((jar, TRAINED[jar.kind]) for jar in jars))


def _training() -> tuple[Condition, ...]:
    asked = ((SALT,), (PEPPER,), (PAPRIKA,), (SALT, PEPPER), (PEPPER, PAPRIKA), (PAPRIKA, SALT))
    return tuple(
        Condition("seasoning_rack", f"train{i}", (SALT, PEPPER, PAPRIKA, RACK), LAYOUT, _trained(*jars))
        for i, jars in enumerate(asked, start=1)
    )


@task
def seasoning_rack() -> Task:
    """Put the named jars into the named holes of the rack; the clearance is 2.7 mm a side.

    Left, middle and right are those of the front camera; holes 1, 2 and 3 in this order.

    Randomizations: each jar within 15 mm and 9 degrees of its slot; the look of everything.
    Success: each named jar stands on the floor of its hole, upright, nothing else was put into a hole, at rest and
    released for 0.5 s.
    Premise: the named jars stand in their slots and their holes are free.
    """
    shift, recompose, perturb, extrapolate = Axis
    return Task(
        id="seasoning_rack",
        version=1,
        title="Filling the Seasoning Rack",
        template=PRECISION_INSERTION,
        description="Put the named jars into the named holes of the rack.",
        slots=(
            Slot("first", 0.42, -0.27),
            Slot("second", 0.60, -0.27),
            Slot("third", 0.50, -0.10),
            Slot("stand", 0.52, 0.20, jitter_m=0.0, yaw_jitter=0.0),
        ),
        training=_training(),
        variations=(
            Variation(
                "L1",
                shift,
                "train4",
                (do("swap", a=SALT.name, b=PEPPER.name),),
                "salt and pepper exchanged",
                "Jars are found by what they are and not by where they stood in training.",
                ("lexical_kinematic_shortcut", "visual_layout_bias"),
            ),
            Variation(
                "L2",
                shift,
                "train1",
                (
                    do("preplace", object=PEPPER.name, target=RACK.name, at="hole_2"),
                    do("preplace", object=PAPRIKA.name, target=RACK.name, at="hole_3"),
                ),
                "the other holes already filled",
                "A hole is found by its place in the rack, whatever the others hold.",
                ("visual_layout_bias", "phase_conflict"),
                mid_task_look=True,
            ),
            Variation(
                "R1",
                recompose,
                "train6",
                (do("instruct", instruction=insert((SALT, "hole_3"), (PAPRIKA, "hole_1"))),),
                "salt into the right hole, paprika into the left",
                "Jar and hole, each known, are put together in a new way.",
                ("behavioral_inertia", "lexical_kinematic_shortcut"),
            ),
            Variation(
                "O1",
                perturb,
                "train1",
                (
                    do("remove", object=PAPRIKA.name),
                    do("move", object=SALT.name, slot="third"),
                    do("add", object=PILLS, slot="first"),
                ),
                "pill bottle where the salt stood",
                "Salt is told from a pill bottle of its shape that stands in its place.",
                ("semantic_feature_collapse",),
            ),
            Variation(
                "O2",
                perturb,
                "train4",
                (
                    do("replace", object=SALT.name, by=PLAIN_SALT),
                    do("replace", object=PEPPER.name, by=PLAIN_PEPPER),
                    do("replace", object=PAPRIKA.name, by=PLAIN_PAPRIKA),
                    do("swap", a=PLAIN_SALT.name, b=PLAIN_PEPPER.name),
                ),
                "same cap and body on every jar, salt and pepper exchanged",
                "Jars are told apart by their labels alone.",
                ("semantic_feature_collapse", "lexical_kinematic_shortcut"),
            ),
            Variation(
                "T1",
                extrapolate,
                "train4",
                (do("chain", instruction=_trained(SALT, PEPPER, PAPRIKA)),),
                "three jars in a row",
                "A longer chain of known steps is carried to its end.",
                ("early_halt", "causal_confusion", "timeout"),
            ),
        ),
    )
