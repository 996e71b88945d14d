"""Reference policies: nothing, anything, and the same again."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.robots import ROBOTS, task_of

from betterbench.episodes import Observer
from betterbench.errors import InvalidInputError, RecordError
from betterbench.evaluation import evaluate, make_plan
from betterbench.interface import EpisodeStart, Observation, observation_spec
from betterbench.interface.actions import action_space
from betterbench.policies import Noop, Random, Replay
from betterbench.policies.factory import check_policy
from betterbench.records import RunFolder
from betterbench.sim.robots import robot
from betterbench.sim.scenes import Scene, quality_preset
from betterbench.tasks import get_task

SEEN = Observation("Do it.", 0, {}, np.zeros(7), np.zeros(7), np.zeros(3), np.zeros(4), 0.08, {}, {})


def walk(start: EpisodeStart, steps: int = 200, policy: Random | None = None) -> np.ndarray:
    policy = policy or Random()
    policy.reset(start)
    return np.array([policy.act(dataclasses.replace(SEEN, step=i)) for i in range(steps)])


def test_noop_holds_still_with_an_open_hand():
    policy = Noop()
    policy.reset(EpisodeStart("Do it.", 0, "ee_delta"))
    assert policy.act(SEEN).tolist() == [0.0] * 6 + [-1.0]
    assert not policy.info.needs_images


SPACES = [(name, space) for name in ROBOTS for space in robot(name).action_spaces]


def life(name: str, space: str, policy: Noop | Random, steps: int = 25) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run a policy in a task of a robot; return its actions, and the joints [rad] at the start and at the end."""
    task, declared = get_task(task_of(name)), action_space(space)
    scene = Scene(task, task.training[0], seed=0, action_space=declared, quality=quality_preset("fast"))
    observer = Observer(observation_spec("state_only"))
    policy.reset(EpisodeStart("Do it.", 0, space))
    state, actions = scene.reset(), []
    begun = np.array(state.joint_positions)
    for _ in range(steps):
        actions.append(policy.act(observer.observe(scene, state)))
        scene.step(actions[-1])
        state = scene.state()
    observer.close()
    return np.array(actions), begun, np.array(state.joint_positions)


@pytest.mark.physics
@pytest.mark.parametrize(("name", "space"), SPACES)
def test_noop_keeps_every_robot_still_in_every_space(name, space):
    actions, begun, ended = life(name, space, Noop())
    assert actions.shape == (25, action_space(space).dim)
    assert np.abs(ended - begun).max() < 0.01  # an arm without gravity compensation sags


@pytest.mark.physics
@pytest.mark.parametrize(("name", "space"), [case for case in SPACES if case[1] != "ee_pose"])
def test_random_moves_every_robot_within_the_bounds_and_repeats(name, space):
    declared = action_space(space)
    actions, begun, ended = life(name, space, Random())
    assert ((actions >= declared.low) & (actions <= declared.high)).all()
    assert np.abs(ended - begun).max() > 0.02
    assert np.array_equal(life(name, space, Random())[0], actions)


@pytest.mark.parametrize("policy", ["noop", "random"])
@pytest.mark.parametrize("name", ROBOTS)
def test_the_reference_policies_answer_in_the_usual_space_of_every_robot(policy, name):
    plan = make_plan(policy, tasks=(task_of(name),), trials=1)
    assert plan.action_space == robot(name).action_spaces[0]
    assert check_policy(policy, action_space=plan.action_space).action_space == plan.action_space


def test_random_says_where_it_does_not_walk():
    with pytest.raises(InvalidInputError, match="random returns actions in 'ee_delta', but the run uses 'ee_pose'"):
        check_policy("random", action_space="ee_pose")


def test_random_repeats_with_episode_and_instruction_and_with_nothing_else():
    start = EpisodeStart("Do it.", 3, "ee_delta")
    first = walk(start)
    assert np.array_equal(first, walk(start))
    used = Random()
    walk(EpisodeStart("Other.", 9, "ee_delta"), policy=used)
    assert np.array_equal(first, walk(start, policy=used)), "a reset forgets the last episode"
    assert not np.array_equal(first, walk(dataclasses.replace(start, episode=4)))
    assert not np.array_equal(first, walk(dataclasses.replace(start, instruction="Do that.")))


def test_random_stays_within_the_action_space_and_uses_it():
    actions = walk(EpisodeStart("Do it.", 0, "ee_delta"), 2000)
    assert np.abs(actions).max() <= 1.0
    assert set(actions[:, 6]) == {-1.0, 1.0}
    assert actions[:, :6].std(axis=0).min() > 0.1


def test_instances_share_no_random_state():
    start = EpisodeStart("Do it.", 1, "ee_delta")
    alone = walk(start, 20)
    one, two = Random(), Random()
    one.reset(start)
    two.reset(dataclasses.replace(start, episode=2))
    interleaved = []
    for _ in range(20):
        interleaved.append(one.act(SEEN))
        two.act(SEEN)
    assert np.array_equal(alone, np.array(interleaved))


# --------------------------------------------------------------------------------------------------------------- replay


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """Random walks over `morning_coffee/T1` and its training condition."""
    out = tmp_path_factory.mktemp("recorded") / "run"
    return evaluate(
        make_plan(
            "random",
            variations=["morning_coffee/T1"],
            tasks=["morning_coffee"],
            trials=1,
            observation="state_only",
            quality="fast",
        ),
        out,
    )


def replay(run: RunFolder, **changes: object) -> Replay:
    arguments = {"task": "morning_coffee", "condition": "T1", "base": "train1", "seed": 0}
    return Replay(str(run.path), **{**arguments, **changes})


@pytest.mark.physics
def test_replay_plays_the_record_of_the_same_condition_then_holds_still(recorded):
    record = recorded.read_record("morning_coffee", "T1", 0)
    policy = replay(recorded)
    policy.reset(EpisodeStart("anything", 0, "ee_delta"))
    played = np.array([policy.act(dataclasses.replace(SEEN, step=i)) for i in range(record.n_steps)])
    assert np.array_equal(played, record.applied[1:])
    after = policy.act(dataclasses.replace(SEEN, step=record.n_steps))
    assert after[:6].tolist() == [0.0] * 6
    assert after[6] == record.applied[-1, 6]


@pytest.mark.physics
def test_replay_falls_back_on_the_twin(recorded):
    twin = recorded.read_record("morning_coffee", "train1", 0)
    policy = replay(recorded, condition="L2")
    assert np.array_equal(policy.act(SEEN), twin.applied[1])
    assert policy.info.action_space == "ee_delta"


@pytest.mark.physics
def test_replay_hands_out_copies(recorded):
    policy = replay(recorded)
    policy.act(SEEN)[:] = 9.0
    assert np.abs(policy.act(SEEN)).max() <= 1.0


@pytest.mark.physics
def test_replay_refuses_a_missing_record_and_another_action_space(recorded):
    with pytest.raises(InvalidInputError, match=r"no record of morning_coffee with condition L2 or train2 and seed 0"):
        replay(recorded, condition="L2", base="train2")
    with pytest.raises(InvalidInputError, match="seed 5"):
        replay(recorded, seed=5)
    with pytest.raises(InvalidInputError, match="Use --action-space ee_delta"):
        replay(recorded).reset(EpisodeStart("x", 0, "ee_pose"))


def test_replay_needs_a_run(tmp_path):
    with pytest.raises(InvalidInputError, match="no run was given"):
        Replay("", task="t", condition="c", base="b", seed=0)
    with pytest.raises(RecordError, match="contains no run"):
        Replay(str(tmp_path), task="t", condition="c", base="b", seed=0)
