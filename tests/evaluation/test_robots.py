"""Each verb of a run takes the robot: the same laws for the second robot as for the first."""

from __future__ import annotations

import numpy as np
import pytest
from tests.sim.robots.so101_table import TABLE

from betterbench.certification.examine import examine_condition
from betterbench.cli.main import main
from betterbench.episodes.observer import Observer
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.evaluation import evaluate, make_plan, open_server
from betterbench.evaluation.figures import show
from betterbench.evaluation.running.replay import check_record
from betterbench.evaluation.serving.shadow import ShadowSimulation
from betterbench.interface import observation_spec
from betterbench.interface.actions import action_space
from betterbench.records import read_record
from betterbench.sim.robots import robot, robot_names
from betterbench.sim.scenes import Scene, quality_preset
from betterbench.tasks import TrialId
from betterbench.tasks.authoring.registry import registered_for_now

pytestmark = pytest.mark.physics

TRIAL = TrialId("so101_table", "train1", 0)


@pytest.fixture(autouse=True)
def task():
    with registered_for_now(TABLE):
        yield TABLE


def client(name, space):
    """Return a client's scene of the trial in a robot's action space, and its observer."""
    scene = Scene(
        TABLE,
        TABLE.training[0],
        seed=0,
        action_space=action_space(space),
        quality=quality_preset("fast"),
        robot_name=name,
    )
    return scene, Observer(observation_spec("state_only"))


@pytest.mark.parametrize("name", robot_names())
def test_a_served_expert_answers_in_the_robots_usual_action_space(name):
    scene, observer = client(name, robot(name).action_spaces[0])
    shadow, state = ShadowSimulation("expert", TRIAL, robot=name), scene.reset()
    for step in range(0, 12, 4):
        for action in shadow.actions(step, 4, seen=observer.observe(scene, state)):
            scene.step(action)
        state = scene.state()
        np.testing.assert_array_equal(shadow.observation(step + 4).joint_positions, state.joint_positions)
    observer.close()


def test_a_client_with_another_robot_is_told_both():
    scene, observer = client("panda", "ee_delta")
    with pytest.raises(InvalidInputError, match="the client's robot has 7 joints, the served SO-101 follower arm has 5"):
        ShadowSimulation("expert", TRIAL, robot="so101").actions(0, 1, seen=observer.observe(scene, scene.reset()))
    observer.close()


@pytest.mark.parametrize(
    ("name", "layout", "text"),
    [
        ("so101", "openpi_libero", "answers in 'ee_delta', and the SO-101 follower arm is served in 'so101_degrees'"),
        ("so100", None, "Did you mean 'so101'"),
    ],
)
def test_what_a_robot_cannot_answer_is_said_at_the_start(name, layout, text):
    with pytest.raises((InvalidInputError, UnknownNameError), match=text):
        open_server("expert", port=0, robot=name, layout=layout)


@pytest.mark.parametrize("space", robot("so101").action_spaces[:2])
def test_a_run_of_the_second_robot_has_records_in_its_own_units(tmp_path, space):
    plan = make_plan("zoo:halt", tasks=["so101_table"], trials=1, robot="so101", action_space=space, observation="state_only") if TABLE.variations else None
    assert plan is None or plan.robot == "so101"
