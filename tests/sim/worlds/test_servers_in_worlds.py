"""Policy servers and Python policies in LIBERO and CALVIN, by the runner: what the simulator gets and they see."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.policies.test_starvla import Server, answer, array
from tests.sim.worlds.clients import CALVIN_CLIENTS, differences

from betterbench.episodes import Observer
from betterbench.errors import HandshakeError, InvalidInputError, UnknownNameError
from betterbench.evaluation import evaluate
from betterbench.evaluation.planning.world_plan import make_world_plan
from betterbench.interface import EpisodeStart, Observation, observation_spec
from betterbench.interface.actions import CALVIN_RELATIVE, PLAYED_IN
from betterbench.policies.clients.http_act import HttpActClient, HttpAnswer, HttpServer
from betterbench.policies.conventions.presets import PRESETS
from betterbench.policies.kinds import read_address
from betterbench.policies.protocols.json_wire import decode_body
from betterbench.sim.worlds import WorldProcesses, process
from betterbench.sim.worlds.installation import start_code
from betterbench.tasks.worlds.calvin import calvin_chains, start_of

POLICY = """
import numpy as np
from betterbench.interface import PolicyInfo

class Depth:
    info = PolicyInfo("depth", action_space={space!r})
    def reset(self, start):
        assert start.action_space == {space!r}
    def act(self, seen):
        assert seen.depth["front"].shape == (200, 200)
        assert seen.depth["wrist"].shape == (84, 84)
        assert seen.depth["front"].dtype == np.float32
        assert np.allclose(seen.depth["front"], 0.5 + 0.01 * seen.step)
        assert seen.images["front"].dtype == np.uint8
        return np.array([-1.0] * {size} + [1.0])
"""


@pytest.fixture(scope="module")
def calvin_command():
    folder = str(Path(__file__).parent)
    code = f"import sys; sys.path.append({folder!r})\n{start_code('fake_calvin')}"
    return (sys.executable, "-c", code, folder, "", "")


def opened(share):
    """Return a starVLA server whose chunk of two actions has this number for the gripper."""
    chunk = np.zeros((1, 2, 7))
    chunk[..., 0], chunk[..., 6] = -0.3, share
    return Server([lambda request: answer(request, actions=array(chunk))] * 1000)


SHORT = 5
"""Control steps of an instruction of CALVIN, in place of 360."""


@pytest.fixture
def given(monkeypatch):
    """The actions that the simulator's process is given."""
    monkeypatch.setattr("betterbench.sim.worlds.calvin.world.STEPS_PER_SUBTASK", SHORT)
    found = []
    step = process.WorldProcess.step

    def watched(self, action, *, look):
        found.append(np.array(action))
        return step(self, action, look=look)

    monkeypatch.setattr(process.WorldProcess, "step", watched)
    return found


@pytest.fixture(scope="module")
def first_seen(calvin_command):
    """The first observation of a chain of CALVIN."""
    settings = make_world_plan("noop", suite="calvin", trials=1, command=calvin_command).world
    processes = WorldProcesses(settings.command)
    scene = settings.open_scene(
        processes, task="calvin", condition="base", seed=0, action_space=CALVIN_RELATIVE, images=True
    )
    seen = Observer(observation_spec("calvin")).observe(scene, scene.reset())
    scene.close(well=False)
    processes.close()
    return seen


@pytest.mark.parametrize("name", CALVIN_CLIENTS)
def test_an_observation_of_calvin_is_what_the_clients_of_the_field_make_of_it(first_seen, name):
    seen = first_seen
    images = {"rgb_static": seen.images["front"], "rgb_gripper": seen.images["wrist"]}
    obs = {"rgb_obs": images, "robot_obs": start_of(calvin_chains()[0].start).robot}
    sent, built = PRESETS[name].request(seen), CALVIN_CLIENTS[name](obs, seen.instruction)
    if name == "x_vla_calvin":  # columns of a matrix that was made in another order of operations
        np.testing.assert_allclose(sent.pop("proprio"), built.pop("proprio"), atol=1e-12)
    assert list(differences(sent, built)) == []


def test_x_vla_is_shown_what_it_commanded_last(monkeypatch):
    chunk = np.random.default_rng(1).uniform(-0.5, 0.5, (30, 20))
    asked = []

    def post(self, body, timeout_s, **_):
        asked.append(np.array(decode_body(decode_body(body)["proprio"].encode())))
        return HttpAnswer(200, json.dumps({"action": chunk.tolist()}).encode())

    monkeypatch.setattr(HttpServer, "__init__", lambda *_, **__: None)
    monkeypatch.setattr(HttpServer, "post", post)
    client = HttpActClient(read_address("http://host/act?preset=x_vla", world="calvin"))
    client.reset(EpisodeStart("go", 0, "calvin_absolute_quaternion"))
    native = {"gripper_command_closed": np.array([1.0]), "ee_position": np.array([0.1, 0.2, 0.3])}
    images = {"front": np.zeros((200, 200, 3), np.uint8), "wrist": np.zeros((84, 84, 3), np.uint8)}
    for step in (0, 25, 27, 0):
        numbers = np.zeros(7), np.zeros(7), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        client.act(Observation("go", step, images, *numbers, 0.08, {}, {}, native))
    measured = [0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]
    np.testing.assert_allclose(asked[0], [*measured, *[0.0] * 10])
    np.testing.assert_array_equal(asked[1], [*chunk[24, :10], *[0.0] * 10])
    np.testing.assert_array_equal(asked[2], [*chunk[1, :10], *[0.0] * 10])
    np.testing.assert_allclose(asked[3], [*measured, *[0.0] * 10])  # another trial


@pytest.mark.parametrize(("said", "closes"), [(1.0, -1.0), (0.0, 1.0)])
def test_libero_opens_the_gripper_when_starvla_says_so(fake_command, tmp_path, given, said, closes):
    with opened(said) as server:
        policy = f"starvla://127.0.0.1:{server.port}?preset=starvla"
        plan = make_world_plan(policy, suite="libero_object", tasks=["0"], trials=1, command=fake_command)
        protocol = replace(plan.world.protocol, steps={"libero_object": 12})
        evaluate(replace(plan, world=replace(plan.world, protocol=protocol)), tmp_path / "run", workers=1, envs=1)
    assert plan.action_space == "ee_delta"
    assert {float(action[-1]) for action in given} == {closes}
    assert {float(action[0]) for action in given} == {float(np.float32(-0.3))}


@pytest.mark.parametrize(("said", "opens"), [(1.0, 1.0), (0.0, 0.0), pytest.param(-1.0, -1.0, marks=pytest.mark.slow)])
def test_calvin_opens_the_gripper_when_starvla_says_so(calvin_command, tmp_path, given, said, opens):
    with opened(said) as server:
        plan = make_world_plan(f"starvla://127.0.0.1:{server.port}", suite="calvin", trials=1, command=calvin_command)
        run = evaluate(plan, tmp_path / "run", workers=1, envs=1)
        example = server.requests[0]["payload"]["examples"][0]
        assert [image[b"shape"] if isinstance(image, dict) else list(image.shape) for image in example["image"]] == [
            [224, 224, 3]
        ] * 2
    assert plan.action_space == "calvin_relative"
    assert {float(action[-1]) for action in given} == {opens}  # more than 0 opens
    record = next(run.records())
    assert record.gripper_command[-1] == (-1.0 if opens > 0.0 else 1.0)
    assert run.context["policy"]["metadata"]["adapter"]["name"] == "starvla_calvin"


@pytest.mark.usefixtures("policies_here")
@pytest.mark.parametrize(("space", "size"), [("calvin_absolute", 6), ("calvin_absolute_quaternion", 7)])
def test_a_python_policy_answers_absolute_actions_and_sees_depth(calvin_command, tmp_path, given, space, size):
    file = tmp_path / "mine.py"
    file.write_text(POLICY.format(space=space, size=size))
    plan = make_world_plan(
        f"python:{file}:Depth",
        suite="calvin",
        trials=1,
        command=calvin_command,
        action_space=space,
        observation="calvin_depth",
    )
    record = next(evaluate(plan, tmp_path / "run", workers=1, envs=1).records())
    assert record.outcome.error is None
    assert record.n_steps == SHORT
    assert {action.shape for action in given} == {(size + 1,)}


def test_an_action_space_that_a_world_does_not_play_is_refused(fake_command, calvin_command):
    with pytest.raises(UnknownNameError, match="calvin_relative"):
        make_world_plan("noop", suite="calvin", command=calvin_command, action_space="ee_delta")
    with pytest.raises(UnknownNameError, match="libero_absolute"):
        make_world_plan("noop", suite="libero_object", command=fake_command, action_space="joint_delta")
    with pytest.raises(
        InvalidInputError, match=r"openpi_droid returns actions in joint_delta, which LIBERO does not support"
    ):
        make_world_plan("openpi://host?preset=openpi_droid", suite="libero_object", command=fake_command)
    assert PLAYED_IN["calvin"][0] == "calvin_relative"


def test_an_adapter_with_depth_is_refused_before_a_run_that_draws_none(calvin_command, tmp_path):
    file = tmp_path / "deep.json"
    form = PRESETS["starvla_calvin"].to_json() | {"depths": [{"key": "depth", "camera": "front"}], "name": "deep"}
    file.write_text(json.dumps(form), encoding="utf-8")
    with opened(1.0) as server:
        policy = f"starvla://127.0.0.1:{server.port}?adapter={file}"
        plan = make_world_plan(policy, suite="calvin", trials=1, command=calvin_command)
        with pytest.raises(HandshakeError, match=r"depth: adapter deep .* --observation calvin_depth"):
            evaluate(plan, tmp_path / "run", workers=1, envs=1)
    assert not (tmp_path / "run" / "run.json").exists()
