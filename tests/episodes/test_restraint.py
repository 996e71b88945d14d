"""Where something is to be left alone, with the real arm: what a gripper does there, live and from the record."""

from __future__ import annotations

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.diagnosis import diagnose_record
from betterbench.diagnosis.trial import offline_truth
from betterbench.episodes import TrialContext, run_episode
from betterbench.geometry import distance
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task
from betterbench.tasks.interventions import vary

pytestmark = pytest.mark.physics


class Guided:
    """Goes above a thing, down to a height above its top [m], does something there, and goes home."""

    name = "guided"

    def __init__(self, scene: Scene, thing: str, *, height_m: float, close: bool, stay_s: float) -> None:
        start = scene.reset(check_premise=False)
        x, y, z = start.pose(thing).position
        low = (x, y, z + start.info.object(thing).size_m[2] + height_m)
        home = start.info.home_position
        high = (x, y, 0.30)
        wait = round(stay_s * scene.control_rate_hz)
        self.legs = [
            (high, -1.0, 0),
            (low, -1.0, 0),
            (low, 1.0 if close else -1.0, wait),
            (high, -1.0, 5),
            (home, -1.0, 0),
        ]
        self.waited = 0

    def act_on_state(self, state):
        goal, grip, wait = self.legs[0]
        near = distance(state.ee_pose.position, goal) < 0.008
        self.waited += near
        if near and self.waited >= wait and len(self.legs) > 1:
            self.legs.pop(0)
            self.waited = 0
        step = np.clip((np.array(goal) - np.array(state.commanded_pose.position)) / 0.05, -0.5, 0.5)
        return np.array([*step, 0.0, 0.0, 0.0, grip])


def record_of(setting: str, thing: str, *, height_m: float, close: bool, stay_s: float):
    task_id, _, name = setting.partition("/")
    task = get_task(task_id)
    condition = vary(task, task.variation(name))[0]
    scene = Scene(task, condition, seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
    policy = Guided(scene, thing, height_m=height_m, close=close, stay_s=stay_s)
    record = run_episode(scene, policy, context=TrialContext("guided")).record
    truths = offline_truth(record)
    assert [t.forbidden for t in truths] == record.forbidden.tolist()
    assert truths[-1].success == record.outcome.success
    return record


@pytest.mark.parametrize(
    ("setting", "thing", "course", "right"),
    [
        *others_slow(
            [
                ("fruit_lunch/O1", "red_block", {"height_m": 0.025, "close": True, "stay_s": 0.6}, False),
                ("fruit_lunch/O1", "red_block", {"height_m": 0.025, "close": False, "stay_s": 1.5}, False),
                ("morning_coffee/T1", "blue_mug", {"height_m": 0.04, "close": False, "stay_s": 1.5}, False),
            ],
            3,
        ),
        *others_slow(
            [
                ("fruit_lunch/O1", "red_block", {"height_m": 0.12, "close": False, "stay_s": 1.5}, True),
                ("morning_coffee/T1", "blue_mug", {"height_m": 0.12, "close": False, "stay_s": 1.0}, True),
            ],
            2,
        ),
    ],
)
def test_a_grasp_that_misses_and_a_stay_are_attempts_and_a_look_from_above_is_none(setting, thing, course, right):
    record = record_of(setting, thing, **course)
    assert record.outcome.success is right
    found = diagnose_record(record)
    assert (found.kind.value == "none") is right
    assert not record.contacts.bodies.size or not any(
        {record.bodies[a], record.bodies[b]} == {thing, finger}
        for a, b in record.contacts.bodies.tolist()
        for finger in ("left_finger", "right_finger", "hand")
    ), "nothing was touched"
    assert len(found.attempts) == course["close"]
    if not right:
        assert record.forbidden.any()
        assert found.kind.value == "reasoning"


class Sweeping(Guided):
    """Comes down beside a thing, 1 cm above its top, and shuts the gripper while it moves across to the other side."""

    def __init__(self, scene: Scene, thing: str, *, aside_m: float) -> None:
        super().__init__(scene, thing, height_m=0.01, close=True, stay_s=0.0)
        (x, y, z), home = self.legs[1][0], self.legs[-1][0]
        self.legs = [
            ((x - aside_m, y, 0.30), -1.0, 0),
            ((x - aside_m, y, z), -1.0, 0),
            ((x + aside_m, y, z), 1.0, 0),
            ((x + aside_m, y, 0.30), -1.0, 5),
            (home, -1.0, 0),
        ]


@pytest.mark.parametrize("aside_m", others_slow([0.03, 0.05, 0.08], 3))
def test_a_gripper_that_closes_on_its_way_over_the_block_does_not_refuse_it(aside_m):
    task = get_task("fruit_lunch")
    condition = vary(task, task.variation("O1"))[0]
    scene = Scene(task, condition, seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
    policy = Sweeping(scene, "red_block", aside_m=aside_m)
    record = run_episode(scene, policy, context=TrialContext("sweeping")).record
    assert record.forbidden.any()
    assert not record.outcome.success
    assert [t.forbidden for t in offline_truth(record)] == record.forbidden.tolist()
    found = diagnose_record(record)
    assert (found.kind.value, found.attempts) == ("reasoning", ())
    assert "on its way over the red block" in found.evidence.text
