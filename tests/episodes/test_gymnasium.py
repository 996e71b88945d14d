"""Every task as a Gymnasium environment that passes Gymnasium's own checker, without a warning."""

from __future__ import annotations

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from tests.daily import others_slow
from tests.robots import ROBOTS, moves_in, still_in, task_of, usual_space

import betterbench
from betterbench.errors import InvalidActionError, InvalidInputError, UnknownNameError
from betterbench.interface import EpisodeStart
from betterbench.policies import Noop
from betterbench.tasks import all_tasks, environment_id

pytestmark = pytest.mark.physics

betterbench.register_environments()  # another test may have imported betterbench before Gymnasium

TASKS = [t.id for t in all_tasks()]
STILL = np.array([0.0] * 6 + [-1.0], dtype=np.float32)


@pytest.fixture
def make():
    made = []

    def build(task_id: str = "morning_coffee", **arguments: object) -> gymnasium.Env:
        arguments = {"observation": "state_only", "quality": "fast", **arguments}
        made.append(gymnasium.make(environment_id(task_id), **arguments))
        return made[-1]

    yield build
    for env in made:
        env.close()


def test_ids_are_the_tasks_in_camel_case():
    assert environment_id("fast_food") == "BeTTER/FastFood-v0"
    assert all(environment_id(t) in gymnasium.registry for t in TASKS)


LOOP = """
import gymnasium
env = gymnasium.make("betterbench:BeTTER/FastFood-v0", variation="T1", observation="state_only", quality="fast")
observation, info = env.reset(seed=0)
env.step(env.action_space.sample() * 0)
print(env.spec.id, info["condition"])
"""
KNOWN = "assert gymnasium.spec('BeTTER/FastFood-v0').entry_point == 'betterbench.episodes.gymnasium_env:TaskEnv'"


def run(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def test_the_prefix_of_the_id_makes_gymnasium_import_the_package():
    assert run(LOOP) == "BeTTER/FastFood-v0 fast_food/T1"


@pytest.mark.parametrize(
    "imports",
    others_slow(
        [
            "import gymnasium, betterbench",
            "import gymnasium; import betterbench.errors",
            "import betterbench, gymnasium; betterbench.register_environments()",
        ],
        3,
    ),
)
def test_the_tasks_are_registered_when_the_package_is_imported_after_gymnasium_or_on_request(imports):
    run(f"{imports}; {KNOWN}")


def test_importing_the_package_leaves_the_import_system_alone_and_imports_no_gymnasium():
    before = "import sys; path, hooks = list(sys.meta_path), list(sys.path_hooks)"
    after = "assert (sys.meta_path, sys.path_hooks) == (path, hooks); assert 'gymnasium' not in sys.modules"
    run(f"{before}; import betterbench; {after}")


OF_ROBOTS = [task_of(name) for name in ROBOTS]


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space")  # motors have units
@pytest.mark.parametrize(
    "task_id", [*OF_ROBOTS, *(pytest.param(t, marks=pytest.mark.slow) for t in TASKS if t not in OF_ROBOTS)]
)
def test_every_task_passes_gymnasium_s_checker(make, task_id):
    check_env(make(task_id).unwrapped, skip_render_check=True)


@pytest.mark.render
@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space")
@pytest.mark.parametrize("task_id", others_slow(TASKS, len(TASKS)))
def test_every_task_passes_the_checker_with_images(make, task_id):
    env = make(task_id, observation="default", render_mode="rgb_array")
    check_env(env.unwrapped)
    seen, _ = env.reset(seed=0)
    for camera in ("front", "wrist"):
        assert seen[camera].shape == (256, 256, 3)
        assert seen[camera].std() > 5.0, "the image shows something"
    assert env.render().shape == (256, 256, 3)


def test_the_sentence_and_the_truth_are_in_info_and_not_in_the_observation(make):
    env = make("fast_food", variation="T1")
    seen, info = env.reset(seed=4)
    assert info["instruction"] == "Put a burger into the takeaway box, then the fries."
    assert info["condition"] == "fast_food/T1"
    assert info["seed"] == 4
    assert info["subgoals"] == {"pack_burger": False, "pack_fries": False}
    assert set(seen) == {"joint_positions", "joint_velocities", "ee_position", "ee_quaternion", "gripper_width"}


@pytest.mark.parametrize("task_id", OF_ROBOTS)
def test_same_seed_same_life_and_other_seed_other_life(make, task_id):
    def life(seed):
        env = make(task_id, variation="L1")
        seen = env.reset(seed=seed)[0]
        rows = [np.concatenate([np.ravel(v) for v in seen.values()])]
        still = still_in(task_id, seen["joint_positions"], seen["gripper_width"].item())
        for action in moves_in(usual_space(task_id), still, 0, 15):
            seen = env.step(action)[0]
            rows.append(np.concatenate([np.ravel(v) for v in seen.values()]))
        return np.array(rows), env.unwrapped._scene.data.qpos.tobytes()

    first, world = life(3)
    again, same_world = life(3)
    assert np.array_equal(first, again)
    assert world == same_world
    assert life(4)[1] != world


def test_resets_without_a_seed_go_on_from_the_seeded_one(make):
    def seeds():
        env = make()
        env.reset(seed=11)
        return [env.reset()[1]["seed"] for _ in range(3)]

    assert seeds() == seeds()
    assert len(set(seeds())) == 3


@pytest.mark.parametrize("task_id", OF_ROBOTS)
def test_a_seed_is_the_trial_of_that_seed(make, task_id):
    from betterbench.episodes import Observer, TrialContext, run_episode
    from betterbench.interface import observation_spec
    from betterbench.sim.scenes import Scene
    from betterbench.sim.scenes.stage import quality_preset
    from betterbench.tasks import get_task

    env, space = make(task_id, variation="train2"), usual_space(task_id)
    seen, _ = env.reset(seed=6)
    still = still_in(task_id, seen["joint_positions"], seen["gripper_width"].item())
    task = get_task(task_id)
    scene = Scene(task, task.train("train2"), seed=6, action_space=space, quality=quality_preset("fast"))
    scene.reset()
    assert env.unwrapped._scene.data.qpos.tobytes() == scene.data.qpos.tobytes()
    policy = Noop()
    policy.reset(EpisodeStart("", 0, space.name))
    record = run_episode(
        scene, policy, context=TrialContext("noop"), observer=Observer(observation_spec("state_only"))
    ).record
    for _ in range(20):
        seen, *_ = env.step(still)
    assert np.allclose(seen["joint_positions"], record.joint_positions[20], rtol=0.0, atol=1e-6)  # float32 actions
    if space.is_delta:
        assert np.array_equal(seen["joint_positions"], record.joint_positions[20])


def test_an_episode_is_truncated_at_the_step_limit(make):
    env = make(variation="train1")
    env.reset(seed=0)
    limit = env.unwrapped._task.step_limit(env.unwrapped._condition)
    for step in range(1, limit + 1):
        _, reward, terminated, truncated, info = env.step(STILL)
        assert reward == 0.0
        assert not terminated
        assert truncated is (step == limit)
    assert info["step"] == limit


@pytest.mark.parametrize("task_id", OF_ROBOTS)
def test_staying_still_where_nothing_is_to_be_done_is_rewarded_at_the_end(make, task_id):
    env = make(task_id, variation="T1")
    seen, _ = env.reset(seed=0)
    still = still_in(task_id, seen["joint_positions"], seen["gripper_width"].item())
    rewards = []
    terminated = truncated = False
    while not (terminated or truncated):
        _, reward, terminated, truncated, _ = env.step(still)
        rewards.append(reward)
    assert terminated
    assert not truncated
    assert rewards == [0.0] * (len(rewards) - 1) + [1.0]


def test_bad_arguments_are_named(make):
    with pytest.raises(UnknownNameError, match="condition of morning_coffee 'Q1'"):
        make(variation="Q1")
    with pytest.raises(UnknownNameError, match="condition of morning_coffee 'train9'"):
        make(variation="train9")
    with pytest.raises(UnknownNameError, match="observation preset"):
        make(observation="defualt")
    with pytest.raises(InvalidInputError, match="render_mode"):
        gymnasium.make(environment_id("fast_food"), disable_env_checker=True).unwrapped.__class__(
            "fast_food", render_mode="human"
        )


def test_a_step_before_reset_and_an_impossible_action_are_refused(make):
    env = make().unwrapped
    with pytest.raises(InvalidInputError, match="Call reset first"):
        env.step(STILL)
    env.reset(seed=0)
    with pytest.raises(InvalidActionError, match="nan"):
        env.step(np.full(7, np.nan))
