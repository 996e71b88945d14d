"""Each verb of a run takes the robot: the same laws for the second robot as for the first."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from tests.sim.robots.so101_table import TABLE

from betterbench.certification.refusal import require_certified
from betterbench.cli.main import main
from betterbench.demonstrations.export.actions import actions_in
from betterbench.demonstrations.export.episodes import Dataset
from betterbench.demonstrations.export.frames import frame_numbers
from betterbench.demonstrations.export.job import evaluation_command
from betterbench.demonstrations.export.layout import layout_of, robot_of_runs
from betterbench.demonstrations.export.lerobot import features, info_v30
from betterbench.episodes.observer import Observer
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.evaluation import evaluate, make_plan, open_server, run_preflight
from betterbench.evaluation.planning.plan import Plan
from betterbench.evaluation.running.replay import check_record
from betterbench.evaluation.serving.shadow import ShadowSimulation
from betterbench.interface import observation_spec
from betterbench.interface.actions import action_space
from betterbench.policies.conventions.presets import OWN_PRESETS
from betterbench.sim.robots import robot, robot_names
from betterbench.sim.scenes import Scene, quality_preset
from betterbench.tasks import TrialId
from betterbench.tasks.authoring.registry import registered_for_now
from betterbench.tasks.trial import Trial

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
    with pytest.raises(
        InvalidInputError, match="the client's robot has 7 joints, but the served SO-101 follower arm has 5"
    ):
        ShadowSimulation("expert", TRIAL, robot="so101").actions(0, 1, seen=observer.observe(scene, scene.reset()))
    observer.close()


@pytest.mark.parametrize(
    ("name", "layout", "text"),
    [
        (
            "so101",
            "openpi_libero",
            "uses the action space 'ee_delta', but the SO-101 follower arm is served with 'so101_degrees'",
        ),
        ("so100", None, "Did you mean 'so101'"),
    ],
)
def test_what_a_robot_cannot_answer_is_said_at_the_start(name, layout, text):
    with pytest.raises((InvalidInputError, UnknownNameError), match=text):
        open_server("expert", port=0, robot=name, layout=layout)


@pytest.mark.slow
def test_a_replayed_demonstration_proves_the_arms_own_units(tmp_path):
    layout = "lerobot_so101_normalized"
    file = tmp_path / "layout.json"
    file.write_text(json.dumps(dataclasses.replace(OWN_PRESETS[layout], views=()).to_json()), encoding="utf-8")
    with pytest.raises(InvalidInputError, match="'so101_normalized', but the SO-101 follower arm is served with"):
        open_server("expert", port=0, robot="so101", layout=layout)
    layout = "lerobot_so101_degrees"
    file.write_text(json.dumps(dataclasses.replace(OWN_PRESETS[layout], views=()).to_json()), encoding="utf-8")
    with open_server("expert", port=0, robot="so101", layout=layout, trial=TRIAL) as server:
        found = run_preflight(
            f"{server.address}?adapter={file}",
            TRIAL,
            observation="state_only",
            quality="fast",
            proof=True,
            robot="so101",
        )
    assert found.proof.is_proven
    assert {axis.name for axis in found.proof.axes} == {f"{joint}.pos" for joint in robot("so101").arm_joints}
    assert found.to_json()["robot"] == "so101"


def test_a_certificate_covers_one_robot():
    plan = make_plan("expert", tasks=["morning_coffee"], trials=1)
    require_certified(plan)
    require_certified(make_plan("expert", tasks=["fruit_basket"], trials=1))
    trial = Trial("so101_table", "train1", None, None, None, 0, "succeed")
    plan = Plan("expert", (trial,), "so101_degrees", "state_only", "fast", "so101")
    with pytest.raises(InvalidInputError, match=r"is for the robot panda, but the run uses so101.*--robot so101"):
        require_certified(plan)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of the expert with the second robot in its own units."""
    with registered_for_now(TABLE):
        trial = Trial("so101_table", "train1", None, None, None, 0, "succeed")
        plan = Plan("expert", (trial,), "so101_degrees", "state_only", "fast", "so101")
        return evaluate(plan, tmp_path_factory.mktemp("runs") / "run", workers=1)


def test_a_run_in_the_arms_own_units_succeeds_and_is_replayed_bit_for_bit(run):
    (entry,) = run.entries()
    assert (entry.status, run.outcome(entry).success) == ("done", True)
    assert run.context["policy"]["action_space"] == "so101_degrees"
    assert check_record(run.record_path(entry.task, entry.condition, entry.seed)).identical
    assert robot_of_runs([run]) == "so101"


@pytest.mark.parametrize(("space", "units"), [("so101_degrees", 1.0), ("so101_normalized", 100.0 / 110.0)])
def test_an_export_has_lerobots_motors_in_its_units(run, space, units):
    layout = dataclasses.replace(layout_of(f"lerobot_{space}", robot="so101"), images=())
    record = run.read_record("so101_table", "train1", 0)
    motors = tuple(f"{m}.pos" for m in (*robot("so101").arm_joints, "gripper"))
    assert layout.action.components == layout.states[0].components == motors
    numbers = frame_numbers(record, layout).vectors
    degrees = np.degrees(record.joint_positions[:-1])
    np.testing.assert_allclose(numbers["observation.state"][:, 0], units * degrees[:, 0], atol=0.01)
    share = robot("so101").jaw.share_at(record.finger_width[0])
    assert numbers["observation.state"][0, 5] == pytest.approx(100.0 * share, abs=1e-3)
    assert 50.0 < 100.0 * share < 100.0  # an arm opens as far as it needs to
    dataset = Dataset((), layout, "png", 20, 0)
    assert info_v30(dataset)["robot_type"] == "so101_follower"
    assert features(dataset)["action"]["shape"] == [6]
    if space == "so101_degrees":
        np.testing.assert_allclose(numbers["action"], record.applied[1:], atol=1e-3)


@pytest.mark.parametrize(
    ("preset", "words"),
    [
        ("lerobot_so101_degrees", '"lerobot:CHECKPOINT?preset=lerobot_so101_degrees" --robot so101 --tasks'),
        ("native", "python:FILE.py:CLASS --robot so101 --action-space ee_delta --tasks"),
    ],
)
def test_a_data_set_names_the_command_with_its_robot(preset, words):
    told = evaluation_command(layout_of(preset, robot="so101"), "standard", ["so101_table"])
    assert told.startswith(f"better eval --policy {words}")


def test_another_action_space_is_computed_from_the_commands(run):
    record, space = run.read_record("so101_table", "train1", 0), action_space("so101_normalized")
    converted = actions_in(record, space) * space.scale
    scale = np.array(action_space("so101_degrees").scale)
    # the controller bounds the speed, so its references follow the actions
    assert np.abs(converted - record.applied[1:] * scale)[:, :5].max() < 0.16
    assert converted[:, 5].min() >= 0.0


@pytest.mark.parametrize("name", robot_names())
def test_the_native_layout_has_the_joints_of_the_robot(name):
    states = {column.name: column.size for column in layout_of("native", robot=name).states}
    assert states["better.joint_positions"] == states["better.joint_velocities"] == len(robot(name).arm_joints)


def test_the_packaged_certificate_is_not_replaced_by_one_of_another_robot(capsys, tmp_path):
    assert main(["certify", "--tasks", "fruit_basket", "--write-package", "--out", str(tmp_path / "made")]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "for robot 'panda', but these tasks are for 'so101'" in said


def test_a_layout_of_another_robots_actions_is_refused():
    with pytest.raises(UnknownNameError, match="action space for the SO-101 follower arm 'joint_delta'"):
        layout_of("openpi_droid", robot="so101")


@pytest.mark.parametrize("verb", ["eval", "certify", "place", "show", "collect", "serve", "doctor"])
def test_the_help_of_each_verb_names_every_robot(verb, capsys):
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    said = " ".join(capsys.readouterr().out.replace("\u2502", " ").split())
    assert f"Robot in the scenes: {' or '.join(robot_names())}; default" in said


@pytest.mark.parametrize(
    "arguments",
    [
        ["eval", "--policy", "expert", "--tasks", "fast_food"],
        ["certify", "--tasks", "fast_food"],
        ["show", "fast_food"],
        ["collect", "--tasks", "fast_food"],
        ["doctor", "--policy", "expert"],
    ],
    ids=lambda given: given[0],
)
def test_a_mistyped_robot_is_answered_with_the_closest(arguments, tmp_path, capsys):
    out = ["--out", str(tmp_path / "out.png")]
    assert main([*arguments, "--robot", "so100", *out]) == 2
    assert "Did you mean 'so101'" in capsys.readouterr().err
    assert not (tmp_path / "out.png").exists()
