"""Questions about cutlery at a plate state its direction, or do not depend on it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from tests.tasks.conftest import change, initial

from betterbench.geometry import Pose, from_yaw
from betterbench.tasks import get_task
from betterbench.vqa.moment import Moment
from betterbench.vqa.types.execution import step_words
from betterbench.vqa.types.relation import _beside


def moment_of(name: str, yaw: float, beyond_m: float = 0.0) -> Moment:
    """Return a moment in which the fork lies on the left of the plate."""
    state = initial("breakfast_table", name)
    condition = get_task("breakfast_table").train(name)
    goals = condition.instruction.subgoals
    plate, region = state.pose("plate"), state.info.object("plate").region("left").pose
    x, y, z = region.position
    side = plate.apply((x, y - beyond_m, z))
    there = change(state, poses={"fork": Pose(side, from_yaw(yaw))}, contacts=(("fork", "table"),))
    index = state.info.index
    trace = SimpleNamespace(
        targets=[index("plate")] * len(goals), meant=[[index(str(goal.reference.kind))] for goal in goals]
    )
    episode = SimpleNamespace(trace=trace, resolved=SimpleNamespace(condition=condition))
    moment = Moment(episode, 0, SimpleNamespace())
    moment.__dict__["state"] = there
    return moment


def test_steps_state_the_direction_of_cutlery():
    moment = moment_of("train1", 0.0)
    assert [step_words(moment, goal) for goal in moment.condition.instruction.subgoals] == [
        "put the fork next to the plate on the left, with the handle of the fork pointing to the front, not to a side",
        "put the cup at the upper right of the plate",
    ]


@pytest.mark.parametrize(
    ("yaw", "beyond_m", "answers"),
    [
        (0.0, 0.0, {"left": "Yes", "right": "No", "upper_right": "No"}),
        (math.pi, 0.0, {}),
        (math.pi, 0.025, {}),  # outside the outlined place
        (1.0, 0.025, {}),
        (math.pi, 0.3, {"left": "No", "right": "No", "upper_right": "No"}),
    ],
)
def test_the_side_of_cutlery_in_another_direction_is_not_asked(yaw, beyond_m, answers):
    drafts = _beside(moment_of("train1", yaw, beyond_m), ("fork", "fork"), ("plate", "plate"))
    assert {draft.group[0]: draft.answer for draft in drafts} == answers
