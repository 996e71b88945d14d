"""LeRobot's environment hook keeps LeRobot's contract, and shows what ``better eval`` shows."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
from tests.daily import others_slow
from tests.robots import ROBOTS, task_of

from betterbench.episodes import Observer, TrialContext, run_episode
from betterbench.episodes import envhub as hub
from betterbench.episodes.lerobot_env import ENVIRONMENT_ID, make_env
from betterbench.episodes.lerobot_task import STATES, LeRobotTaskEnv
from betterbench.episodes.selection import select_conditions
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.interface import observation_spec
from betterbench.interface.actions import EE_DELTA, action_space
from betterbench.policies.conventions.presets import OPENPI_LIBERO
from betterbench.policies.experts import make_expert
from betterbench.sim.robots import robot
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import FAST
from betterbench.tasks import get_task, suite_tasks

pytestmark = pytest.mark.physics

STILL = np.array([0.0] * 6 + [-1.0], dtype=np.float32)
BLIND = {"observation": "state_only", "quality": "fast"}


@pytest.fixture
def make():
    made = []

    def build(n_envs: int = 1, use_async_envs: bool = False, cfg: object | None = None, **settings: object):
        envs = make_env(n_envs, use_async_envs, cfg, **{"quality": "fast", **settings})
        made.extend(group[0] for group in envs.values())
        return envs

    yield build
    for env in made:
        env.close()


@pytest.mark.render
@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space")  # motors have units
@pytest.mark.parametrize("name", others_slow(ROBOTS, 2))
def test_a_single_environment_passes_gymnasium_s_checker(name):
    env = gymnasium.make(ENVIRONMENT_ID, task=task_of(name), variation="L1", quality="fast")
    check_env(env.unwrapped)
    env.close()


STATE_CASES = [(name, "ee", 8) for name in ROBOTS] + [
    (name, "joints", len(robot(name).arm_joints) + 1) for name in ROBOTS
]


@pytest.mark.parametrize(("name", "state", "size"), [*STATE_CASES, ("so101", "motors", 6)])
def test_a_state_has_the_numbers_of_its_robot(name, state, size):
    env = LeRobotTaskEnv(task_of(name), state=state, **BLIND)
    try:
        seen, _ = env.reset(seed=0)
        assert env.action_space.shape == (action_space(robot(name).action_spaces[0]).dim,)
        assert seen["agent_pos"].shape == env.observation_space["agent_pos"].shape == (size,)
        assert env.observation_space["agent_pos"].contains(seen["agent_pos"])
        if state == "motors":
            degrees = np.degrees(env._scene.state().joint_positions)
            assert seen["agent_pos"][:-1] == pytest.approx(degrees, abs=1e-3)
            assert 50.0 < seen["agent_pos"][-1] <= 100.0
    finally:
        env.close()


def test_motors_need_the_action_space_of_a_robots_own_motors():
    with pytest.raises(InvalidInputError, match="'motors' needs an action space in motor units, but the action"):
        LeRobotTaskEnv("fast_food", state="motors", **BLIND)


@pytest.mark.render
def test_it_shows_what_better_eval_shows():
    env = LeRobotTaskEnv("fast_food", variation="train2", quality="fast")
    seen, info = env.reset(seed=4)
    assert info["is_success"] is False
    task = get_task("fast_food")
    scene = Scene(task, task.train("train2"), seed=4, action_space=EE_DELTA, quality=FAST)
    scene.reset()
    observer = Observer(observation_spec("default"))
    for step in range(3):
        shown = observer.observe(scene, scene.state())
        assert list(seen["pixels"]) == ["front", "wrist"]
        for camera, image in seen["pixels"].items():
            assert np.array_equal(image, shown.images[camera])
        assert np.array_equal(seen["agent_pos"], OPENPI_LIBERO.request(shown)["observation/state"])
        assert np.array_equal(
            STATES["joints"].read(shown, EE_DELTA), np.float32([*shown.joint_positions, shown.gripper_width])
        )
        action = np.sin(step + np.arange(7)).astype(np.float32)
        seen, *_, info = env.step(action)
        scene.step(action.astype(np.float64))
        assert info["is_success"] is False
    env.close()
    observer.close()


def test_the_state_does_not_jump_where_the_tool_points_down():
    task = get_task("morning_coffee")
    scene = Scene(task, task.training[0], seed=0, action_space=EE_DELTA, quality=FAST)
    record = run_episode(scene, make_expert("expert", scene), context=TrialContext("expert")).record
    observer = Observer(observation_spec("state_only"))
    seen = observer.observe(scene, scene.state())
    turns = []
    for quaternion in record.ee_quaternion:
        seen.ee_quaternion[:] = quaternion
        turns.append(STATES["ee"].read(seen, EE_DELTA)[3:6])
    steps = np.abs(np.diff(turns, axis=0)).max(axis=1)
    assert record.outcome.success
    assert steps.max() < 0.3, "a step of the arm turns it by little"


def test_lerobot_finds_what_it_looks_for(make):
    envs = make(2, conditions="morning_coffee/T1, fast_food/train1", **BLIND)
    assert list(envs) == ["morning_coffee-T1", "fast_food-train1"]
    (vector,) = envs["morning_coffee-T1"].values()
    assert vector.num_envs == 2
    _, info = vector.reset(seed=[3, 7])
    assert info["is_success"].tolist() == [False, False]
    assert info["seed"].tolist() == [3, 7]
    # An attribute behind a wrapper is not found by hasattr, and the policy would be told nothing.
    for env in vector.envs:
        assert isinstance(env, LeRobotTaskEnv)
        assert env.task == "morning_coffee/T1"
        assert hasattr(env, "task_description")
    assert (
        vector.call("task_description")
        == ("Put the red mug inside the ring of the coffee machine, its handle not facing the machine.",) * 2
    )
    assert vector.call("_max_episode_steps") == (200, 200)
    assert vector.unwrapped.metadata["render_fps"] == 20


def test_success_is_in_the_final_info(make):
    (group,) = make(1, conditions="morning_coffee/T1", **BLIND).values()
    vector = group[0]
    vector.reset(seed=[0])
    for _ in range(vector.call("_max_episode_steps")[0]):
        _, reward, terminated, truncated, info = vector.step(STILL[None])
        if "final_info" in info:
            break
    assert terminated.tolist() == [True]
    assert truncated.tolist() == [False]
    assert reward.tolist() == [1.0]
    assert info["final_info"]["is_success"].tolist() == [True]
    assert info["is_success"].tolist() == [False], "the next episode has begun"


def test_one_condition_is_awake_at_a_time(make):
    envs = make(1, conditions="morning_coffee/T1, morning_coffee/L1", **BLIND)
    first, second = (group[0] for group in envs.values())
    first.reset(seed=[0])
    begun = first.envs[0]
    second.reset(seed=[0])
    assert begun._scene is None, "its scene is freed"
    seen, _ = first.reset(seed=[0])
    assert first.envs[0] is not begun
    assert seen["agent_pos"].shape == (1, 8)


@pytest.mark.slow
def test_environments_of_their_own_processes_agree(make):
    here, there = (next(iter(make(2, own, conditions="fast_food/T1", **BLIND).values()))[0] for own in (False, True))
    assert isinstance(here, SyncVectorEnv)
    assert isinstance(there, AsyncVectorEnv)
    for vector in (here, there):
        vector.reset(seed=[1, 2])
    action = np.tile(STILL, (2, 1)) + 0.3
    assert np.array_equal(here.step(action)[0]["agent_pos"], there.step(action)[0]["agent_pos"])
    assert there.call("task_description") == here.call("task_description")
    assert there.envs[0].task_description == here.envs[0].task_description
    there.close()
    there.close()


def test_cameras_and_state_can_be_named_as_a_checkpoint_wants_them(make):
    cfg = SimpleNamespace(task="fast_food/T1", cameras={"front": "image", "wrist": "image2"}, state="joints")
    (group,) = make(1, False, cfg).values()
    env = group[0]._make[0]()
    assert list(env.observation_space["pixels"]) == ["image", "image2"]
    assert env.task == "fast_food/T1"


def test_conditions_are_selected_by_task_and_by_name():
    assert select_conditions("fast_food/T1, fast_food/T1") == (("fast_food", "T1"),)
    every = select_conditions(None)
    assert {task for task, _ in every} == set(suite_tasks("better60"))
    assert len(every) == sum(len(get_task(t).training) + len(get_task(t).variations) for t in suite_tasks("better60"))
    assert ("fast_food", "train1") in select_conditions(["fast_food"])


def test_bad_settings_are_named_before_the_first_episode(make):
    with pytest.raises(UnknownNameError, match=r"condition of fast_food 'T11'. Did you mean 'T1'"):
        make(conditions="fast_food/T11")
    with pytest.raises(UnknownNameError, match="task 'fastfood'"):
        make(conditions="fastfood")
    with pytest.raises(UnknownNameError, match="state layout"):
        make(conditions="fast_food/T1", state="eef")
    with pytest.raises(UnknownNameError, match="camera"):
        make(conditions="fast_food/T1", cameras={"top": "image"})
    with pytest.raises(InvalidInputError, match="same name"):
        make(conditions="fast_food/T1", cameras={"front": "wrist"})
    with pytest.raises(InvalidInputError, match="n_envs"):
        make(0)
    with pytest.raises(InvalidInputError, match="max_parallel_tasks"):
        make(1, False, SimpleNamespace(task=None, max_parallel_tasks=2))


def test_the_hub_package_is_one_file():
    file = Path(hub.__path__[0]) / "env.py"
    spec = importlib.util.spec_from_file_location("hub_env_you_better", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.make_env is make_env


def test_gymnasium_makes_it_without_a_wrapper():
    env = gymnasium.make(ENVIRONMENT_ID, disable_env_checker=True, task="fast_food", variation="T1", **BLIND)
    assert type(env) is LeRobotTaskEnv
