"""The direction of cutlery at a plate: said by the instruction, and part of the goal exactly where it is said."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from betterbench.geometry import Pose, from_yaw
from betterbench.tasks import authoring as a
from betterbench.tasks import get_task
from betterbench.tasks.interventions import vary
from betterbench.tasks.relations import relation
from betterbench.tasks.relations.beside import is_cutlery

PLATE = a.fixture("plate", category="place_plate")
FORK, SPOON, CUP, SOAP = a.item("fork"), a.item("spoon"), a.item("cup"), a.item("soap", "soap bar")
DESSERT = a.item("small", "dessert fork", "silver_fork")


@pytest.mark.parametrize(
    ("steps", "text"),
    [
        (
            [(FORK, "left"), (CUP, "upper_right")],
            (
                "Put the fork next to the plate on the left and the cup next to the plate at the upper right, with the "
                "handle of the fork pointing to the front, not to a side."
            ),
        ),
        (
            [(SPOON, "right"), (FORK, "left")],
            (
                "Put the spoon next to the plate on the right and the fork next to the plate on the left, with the "
                "handles of the cutlery pointing to the front, not to a side."
            ),
        ),
        (
            [(DESSERT, "left")],
            (
                "Put the dessert fork next to the plate on the left, with the handle of the dessert fork pointing "
                "to the front, not to a side."
            ),
        ),
        (
            [(CUP, "left"), (SOAP, "right")],
            "Put the cup next to the plate on the left and the soap bar next to the plate on the right.",
        ),
    ],
)
def test_an_instruction_says_the_direction_of_cutlery_next_to_a_plate(steps, text):
    assert a.arranged(PLATE, *steps, close=True).text == text


def test_an_instruction_that_does_not_say_next_to_says_no_direction():
    text = a.arranged(PLATE, (FORK, "left"), (CUP, "right")).text
    assert text == "Put the fork to the left of the plate and the cup to the right of the plate."


def test_the_words_of_the_steps_are_the_nouns_alone():
    steps = a.arranged(PLATE, (FORK, "left"), (SPOON, "right"), close=True).subgoals
    assert [goal.word for goal in steps] == ["fork", "spoon"]


def test_the_suite_says_the_direction_wherever_cutlery_is_requested():
    task = get_task("breakfast_table")
    conditions = (*task.training, *(vary(task, v)[0] for v in task.variations))
    for condition in conditions:
        kinds = [str(goal.reference.kind) for goal in condition.instruction.subgoals]
        count = sum(kind in ("fork", "spoon") for kind in kinds)
        said = condition.instruction.text.partition(", with the ")[2]
        assert count in (1, 2)
        assert said.startswith("handles of the cutlery" if count == 2 else "handle of the "), condition.name
        assert said.endswith("pointing to the front, not to a side.")


@pytest.mark.parametrize(
    ("kind", "category", "expected"),
    [
        ("fork", "fork", True),
        ("dessert spoon", "mesh_7", True),
        ("utensil", "silver_knife", True),
        ("fork rest", "fork_rest", False),
        ("stapler", "stapler", False),
    ],
)
def test_cutlery_is_known_by_its_noun_or_category(kind, category, expected):
    assert is_cutlery(kind, category) is expected


@pytest.mark.parametrize("turn", [0.0, math.pi / 2, math.pi])
def test_other_long_objects_at_a_plate_have_no_direction(at_reset, posed, turn):
    """No instruction states a direction for them, so the goal has none."""
    state = at_reset("breakfast_table", "train1")
    plate = state.pose("plate")
    side = (plate @ state.info.object("plate").region("left").pose).position
    there = posed(state, poses={"fork": Pose(side, from_yaw(turn))}, contacts=(("fork", "table"),))
    assert (relation("beside").where(there, "fork", "plate") == "left") is (turn == 0.0)
    objects = tuple(replace(o, kind="rod", category="rod") if o.name == "fork" else o for o in there.info.objects)
    rod = replace(there, info=replace(there.info, objects=objects))
    assert relation("beside").where(rod, "fork", "plate") == "left"
