"""The loop: a pure function of trial and policy, and a boundary that no policy can break."""

from __future__ import annotations

import dataclasses
import gc
import re
import sys
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from tests.daily import others_slow
from tests.looping import each

from betterbench.episodes import Observer, TrialContext, heap, run_episode, settled_heap
from betterbench.evaluation import check_record
from betterbench.interface import EpisodeStart, Observation, PolicyInfo, episode_number, observation_spec
from betterbench.interface.actions import action_space
from betterbench.policies import Noop, Random
from betterbench.policies.experts import make_expert
from betterbench.records import read_record, write_record
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import GoalTracker, Task, get_task
from betterbench.tasks.interventions import vary

pytestmark = pytest.mark.physics

STATE_ONLY = observation_spec("state_only")
STILL = np.array([0.0] * 6 + [-1.0])


def short(task: Task, steps: int = 40) -> Task:
    """Returns the task with a short step limit."""
    template = dataclasses.replace(task.template, base_steps=steps, steps_per_subgoal=0, still_steps=steps)
    return dataclasses.replace(task, template=template)


def make_scene(
    name: str = "train1",
    *,
    task_id: str = "morning_coffee",
    seed: int = 0,
    steps: int | None = 40,
    space: str = "ee_delta",
) -> Scene:
    task = get_task(task_id) if steps is None else short(get_task(task_id), steps)
    condition = task.train(name) if name.startswith("train") else vary(task, task.variation(name))[0]
    return Scene(task, condition, seed=seed, action_space=action_space(space), quality=quality_preset("fast"))


class Scripted:
    """A policy that answers what a function says."""

    info = PolicyInfo("scripted", needs_images=False)

    def __init__(self, answer: Callable[[Observation], object]) -> None:
        self.answer = answer
        self.seen: list[int] = []
        self.started: list[EpisodeStart] = []

    def reset(self, start: EpisodeStart) -> None:
        self.started.append(start)

    def act(self, observation: Observation) -> object:
        self.seen.append(observation.step)
        return self.answer(observation)


def run(policy, scene=None, **context):
    return run_episode(
        scene or make_scene(), policy, context=TrialContext("scripted", **context), observer=Observer(STATE_ONLY)
    ).record


# --------------------------------------------------------------------------------------------------------------- purity


@pytest.mark.parametrize("policy", [Noop, Random])
def test_two_runs_of_a_trial_give_the_same_bytes(tmp_path, policy):
    for name in ("a", "b"):
        write_record(run(policy(), make_scene("L2")), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_used_scene_and_a_used_policy_make_no_difference():
    scene, policy = make_scene("L2"), Random()
    first = run(policy, scene)
    scene.step(np.ones(7))
    assert run(policy, scene).same_bits(first)


def test_the_expert_s_episode_is_pure_too():
    records = []
    for _ in range(2):
        scene = make_scene("train1", steps=60)
        records.append(run_episode(scene, make_expert("expert", scene), context=TrialContext("expert")).record)
    assert records[0].same_bits(records[1])


def test_wall_clock_figures_stay_out_of_the_record():
    scene = make_scene()
    result = run_episode(scene, Noop(), context=TrialContext("noop"), observer=Observer(STATE_ONLY))
    assert set(result.wall) == {
        "duration_s",
        "policy_s",
        "policy_latency_p50_s",
        "policy_latency_max_s",
        "policy_answers",
        "observe_s",
        "simulation_s",
    }
    assert all(v >= 0.0 for v in result.wall.values())
    parts = sum(result.wall[name] for name in ("policy_s", "observe_s", "simulation_s"))
    assert 0.0 < parts <= result.wall["duration_s"] + 1e-5


# ------------------------------------------------------------------------------------------------------------- the loop


def test_the_record_begins_at_reset_and_ends_at_the_limit():
    record = run(Noop())
    assert len(record) == 41
    assert record.n_steps == 40
    assert np.isnan(record.action[0]).all()
    assert record.outcome.termination == "step_limit"
    assert not record.outcome.success
    assert record.outcome.error is None
    assert record.time[-1] == pytest.approx(2.0)


def test_the_record_says_which_trial_it_is_of():
    scene = make_scene("O1", seed=3)
    meta = run(
        Noop(),
        scene,
        variation="O1",
        axis="adversarial_object_perturbation",
        base_condition="train1",
        interventions=("do(x)",),
    ).metadata
    assert (meta.task, meta.condition, meta.variation, meta.seed) == ("morning_coffee", "O1", "O1", 3)
    assert meta.base_condition == "train1"
    assert meta.interventions == ("do(x)",)
    assert meta.instruction == scene.condition.instruction.text
    assert meta.expected == "succeed"
    assert meta.action_components == scene.action_space.components
    assert meta.scene == scene.info
    assert meta.scene_hash == scene.compiled.content_hash
    assert meta.camera_preset is None
    assert meta.render_quality is None
    assert meta.engine["simulator"] == "mujoco"


def test_a_policy_is_told_the_instruction_a_number_and_the_action_space_once():
    policy = Scripted(lambda _: STILL)
    scene = make_scene(seed=5)
    run(policy, scene)
    assert policy.started == [EpisodeStart(scene.condition.instruction.text, episode_number(5), "ee_delta")]
    assert policy.seen == list(range(40))


def test_observations_show_what_is_there_and_nothing_privileged():
    seen: list[Observation] = []

    def answer(observation):
        seen.append(observation)
        return STILL

    record = run(Scripted(answer))
    assert np.array_equal([o.ee_position for o in seen], record.ee_position[:-1])
    assert np.array_equal([o.joint_positions for o in seen], record.joint_positions[:-1])
    assert [o.gripper_width for o in seen] == record.finger_width[:-1].tolist()
    assert seen[0].images == seen[0].depth == seen[0].masks == seen[0].native == {}
    assert {f.name for f in dataclasses.fields(Observation)} == {
        "instruction",
        "step",
        "images",
        "joint_positions",
        "joint_velocities",
        "ee_position",
        "ee_quaternion",
        "gripper_width",
        "native",
        "depth",
        "masks",
    }


@pytest.mark.parametrize("horizon", [1, 3, 7, 100])
def test_chunks_are_played_out_before_the_policy_is_asked_again(horizon):
    draw = np.random.default_rng(0)
    chunks = [np.hstack([draw.uniform(-1, 1, (horizon, 6)), -np.ones((horizon, 1))]) for _ in range(41)]
    policy = Scripted(lambda o: chunks[o.step // horizon])
    record = run(policy)
    assert policy.seen == list(range(0, 40, horizon))
    assert np.array_equal(record.action[1:], np.concatenate(chunks)[:40])


@pytest.mark.parametrize(
    "answer",
    [
        STILL,
        STILL[None, :],
        STILL.tolist(),
        [STILL.tolist()],
        STILL.astype(np.float32),
        tuple(STILL),
        np.array([0, 0, 0, 0, 0, 0, -1]),
    ],
)
def test_one_action_may_come_in_any_array_form(answer):
    record = run(Scripted(lambda _: answer), make_scene(steps=5))
    assert record.outcome.termination == "step_limit"
    assert np.array_equal(record.applied[1:], np.tile(STILL, (5, 1)))


def test_what_is_out_of_range_is_clipped_and_counted():
    def answer(observation):
        return np.array([3.0, 0, 0, 0, 0, 0, -1.0]) if observation.step % 2 else STILL

    record = run(Scripted(answer))
    assert record.outcome.clipped_actions == 20
    assert record.outcome.termination == "step_limit"
    assert record.action[2, 0] == 3.0
    assert record.applied[2, 0] == 1.0
    assert run(Scripted(lambda _: STILL)).outcome.clipped_actions == 0


def test_a_policy_that_answers_in_one_array_again_and_again_is_recorded_as_it_answered():
    array = STILL.copy()

    def answer(observation):
        array[0] = 2.0 if observation.step == 3 else 0.25
        return array

    record = run(Scripted(answer), make_scene(steps=6))
    assert record.action[1:, 0].tolist() == [0.25, 0.25, 0.25, 2.0, 0.25, 0.25]
    assert record.applied[1:, 0].tolist() == [0.25, 0.25, 0.25, 1.0, 0.25, 0.25]
    assert record.outcome.clipped_actions == 1


# ----------------------------------------------------------------------------------------------------- hostile policies


def nan_at_five(observation):
    return np.where(np.arange(7) == 2, np.nan, STILL) if observation.step == 5 else STILL


def raise_at_five(observation):
    if observation.step == 5:
        raise RuntimeError("out of memory")
    return STILL


HOSTILE = {
    "nan": (nan_at_five, 5, "z = nan"),
    "inf": (lambda _: np.full(7, np.inf), 0, "x = inf"),
    "minus inf in a chunk": (
        lambda _: np.vstack([STILL, STILL, np.full(7, -np.inf)]),
        0,
        "-inf.* action 3 of a chunk of 3",
    ),
    "too short": (lambda _: np.zeros(6), 0, r"shape \(6,\)"),
    "too long": (lambda _: np.zeros(8), 0, r"shape \(8,\)"),
    "three axes": (lambda _: np.zeros((2, 3, 7)), 0, r"shape \(2, 3, 7\)"),
    "empty chunk": (lambda _: np.zeros((0, 7)), 0, "at least one action"),
    "empty list": (lambda _: [], 0, "shape"),
    "nothing": (lambda _: None, 0, "InvalidActionError: expected an array of numbers from the policy"),
    "text": (lambda _: "left", 0, "InvalidActionError: expected an array of numbers from the policy"),
    "texts": (lambda _: ["0"] * 7, 0, "expected real numbers"),
    "complex": (lambda _: np.zeros(7, complex), 0, "expected real numbers"),
    "booleans": (lambda _: np.zeros(7, bool), 0, "expected real numbers"),
    "objects": (lambda _: np.array([None] * 7), 0, "expected real numbers"),
    "ragged": (lambda _: [[0.0], [0.0, 1.0]], 0, "Error"),
    "a dictionary": (lambda _: {"action": STILL}, 0, r"an array of numbers.* Return an array of shape \(7,\)"),
    "a number": (lambda _: 0.5, 0, r"shape \(\)"),
    "an exception": (raise_at_five, 5, "RuntimeError: out of memory"),
    "an exit": (lambda _: sys.exit("enough"), 0, "SystemExit: enough"),
    "division": (lambda _: 1 / 0, 0, "ZeroDivisionError"),
}


@each("answer, steps, reason", HOSTILE.values())
def test_whatever_a_policy_does_the_trial_ends_as_policy_error_with_its_reason(answer, steps, reason):
    record = run(Scripted(answer))
    assert record.outcome.termination == "policy_error"
    assert not record.outcome.success
    assert record.outcome.error is not None
    assert re.search(reason, record.outcome.error), record.outcome.error
    assert record.n_steps == steps
    assert record.outcome.invalid_actions == int(record.outcome.error.startswith("InvalidActionError"))
    assert np.isfinite(record.qpos).all(), "the world stays as it was"


@pytest.mark.parametrize("name", ["nan", "too short", "an exception", "nothing"])
def test_a_record_of_a_policy_error_is_stored_and_read_back(tmp_path, name):
    record = run(Scripted(HOSTILE[name][0]))
    write_record(record, tmp_path / "r.parquet")
    assert read_record(tmp_path / "r.parquet").same_bits(record)


def test_a_policy_that_breaks_at_reset_is_a_policy_error_without_a_step():
    class Broken(Scripted):
        def reset(self, start):
            raise ConnectionError(f"server is gone in {start.action_space}")

    record = run(Broken(lambda _: STILL))
    assert record.outcome.termination == "policy_error"
    assert str(record.outcome.error).startswith("ConnectionError: server is gone in ee_delta (")
    assert record.n_steps == 0


def test_the_next_trial_after_a_crash_is_untouched_by_it():
    scene = make_scene()
    clean = run(Noop(), scene)
    run(Scripted(nan_at_five), scene)
    assert run(Noop(), scene).same_bits(clean)


def test_garbage_is_looked_for_seldom_in_an_episode_and_as_before_after_it():
    """What an episode makes is kept to its end, so a search among it takes time and finds nothing."""
    before, within = gc.get_threshold(), []

    def look(_):
        within.append(gc.get_threshold())
        return STILL

    run(Scripted(look))
    assert all(young > 10_000 for young, *_ in within)
    assert gc.get_threshold() == before
    with pytest.raises(KeyboardInterrupt):
        run(Scripted(interrupt))
    assert gc.get_threshold() == before


def test_whoever_goes_on_with_the_states_of_an_episode_keeps_the_heap_settled():
    before, frozen = gc.get_threshold(), gc.get_freeze_count()
    with settled_heap():
        run(Noop())
        assert gc.get_threshold()[0] > 10_000, "the episode inside left, and somebody else is there still"
        with pytest.raises(KeyboardInterrupt):
            run(Scripted(interrupt))
        assert gc.get_threshold()[0] > 10_000
    assert gc.get_threshold() == before
    assert (gc.get_freeze_count() == 0) == (frozen == 0)


@pytest.mark.parametrize("frozen", [0, 5])
def test_a_heap_that_others_froze_stays_frozen_and_is_counted_once(frozen, monkeypatch):
    calls = []

    def count():
        calls.append("count")
        return frozen

    noted = {name: (lambda name=name: calls.append(name)) for name in ("freeze", "unfreeze")}
    settings = {"get_threshold": gc.get_threshold, "set_threshold": gc.set_threshold}
    monkeypatch.setattr(heap, "gc", SimpleNamespace(get_freeze_count=count, **noted, **settings))
    monkeypatch.setattr(heap, "_HEAP", heap._Heap())
    for _ in range(3):
        with heap.settled_heap():
            pass
    assert calls == (["count"] if frozen else 3 * ["count", "freeze", "unfreeze"])


def interrupt(_):
    raise KeyboardInterrupt


# -------------------------------------------------------------------------------------------------- judging in blocks


@pytest.mark.parametrize(
    ("task_id", "name", "policy", "shorter"),
    [
        ("morning_coffee", "T1", "expert", 3),
        ("morning_coffee", "T1", "zoo:inertia", 1),
        *others_slow(
            [
                ("fast_food", "train1", "expert", 1),
                ("fast_food", "L1", "zoo:lexical", 3),
                ("cheeseburger", "train1", "expert", 1),
            ],
            3,
        ),
    ],
)
def test_an_episode_that_judges_in_blocks_is_one_that_judges_every_state_at_once(
    task_id, name, policy, shorter, monkeypatch
):
    records = []
    for longest in (20, shorter):
        monkeypatch.setattr("betterbench.episodes.episode._LONGEST_BLOCK", longest)
        scene = make_scene(name, task_id=task_id, steps=None)
        records.append(run_episode(scene, make_expert(policy, scene), context=TrialContext(policy)).record)
    assert records[0].same_bits(records[1])


@pytest.mark.parametrize("steps", range(5))
def test_what_was_done_before_a_crash_is_judged_wherever_it_comes(steps):
    def answers(observation):
        return STILL if observation.step < steps else 1 / 0

    record = run(Scripted(answers))
    assert record.outcome.termination == "policy_error"
    assert len(record) == len(record.predicates) == steps + 1


class Chunking:
    """A privileged policy that answers several actions at once."""

    name = "chunking"

    def __init__(self) -> None:
        self.asked: list[int] = []

    def act_on_state(self, state):
        self.asked.append(state.step)
        return np.tile(0.01 * (1 + state.step) * np.ones(7), (3, 1))


def test_a_privileged_policy_may_answer_a_chunk():
    policy = Chunking()
    result = run_episode(make_scene(steps=8), policy, context=TrialContext("chunking"))
    assert policy.asked == [0, 3, 6]
    assert result.record.action[1:, 0].tolist() == pytest.approx([0.01] * 3 + [0.04] * 3 + [0.07] * 2)
    wall = result.wall
    assert wall["policy_s"] + wall["simulation_s"] == pytest.approx(wall["duration_s"], abs=2e-3)


def test_a_keyboard_interrupt_stops_the_run():
    with pytest.raises(KeyboardInterrupt):
        run(Scripted(interrupt))


def test_a_policy_cannot_change_the_world_through_what_it_sees():
    def vandal(observation):
        for array in (observation.joint_positions, observation.ee_position, observation.joint_velocities):
            array[:] = 99.0
        return STILL

    assert run(Scripted(vandal)).same_bits(run(Scripted(lambda _: STILL)))


def test_a_policy_cannot_change_the_record_through_what_it_gave():
    kept = STILL.copy()

    def answer(observation):
        kept[:] = STILL
        kept[0] = 0.01 * observation.step
        return kept

    record = run(Scripted(answer))
    assert np.allclose(record.action[1:, 0], 0.01 * np.arange(40))


# ----------------------------------------------------------------------------------------------------- judging it again


@pytest.mark.parametrize(
    ("task_id", "name"), [("morning_coffee", "train1"), ("morning_coffee", "T1"), ("fast_food", "L1")]
)
def test_offline_truth_is_live_truth(task_id, name):
    scene = make_scene(name, task_id=task_id, steps=200)
    record = run_episode(scene, make_expert("expert", scene), context=TrialContext("expert")).record
    tracker = GoalTracker(
        scene.condition,
        record.metadata.scene,
        template=scene.task.template,
        control_rate_hz=record.metadata.control_rate_hz,
    )
    assert tracker.relation_names == record.metadata.predicate_names
    assert tracker.subgoal_names == record.metadata.subgoal_names
    truth = None
    for row, state in enumerate(record.states()):
        truth = tracker.update(state)
        assert truth.relations == tuple(record.predicates[row].tolist())
        assert truth.subgoals == tuple(record.subgoals[row].tolist())
        assert truth.goal == bool(record.goal[row])
        assert truth.forbidden == bool(record.forbidden[row])
    assert truth is not None
    assert truth.success == record.outcome.success


def context_of(name):
    """Returns what a run knows of a variation, without the policy."""
    found = get_task("morning_coffee").variation(name)
    operations = tuple(str(i) for i in found.interventions)
    return {"variation": name, "axis": found.axis.value, "base_condition": found.base, "interventions": operations}


@pytest.fixture
def replayed_as_short(monkeypatch):
    """Replays records in episodes that are as short as those of this page."""
    from betterbench.evaluation.running import replay

    ordinary = replay.resolve_condition

    def resolve(task, condition):
        found = ordinary(task, condition)
        return dataclasses.replace(found, task=short(found.task, replayed[0]))

    replayed = [40]
    monkeypatch.setattr(replay, "resolve_condition", resolve)
    return replayed


@pytest.mark.usefixtures("replayed_as_short")
@pytest.mark.parametrize("name", ["train3", "O1"])
def test_replaying_recorded_actions_reproduces_every_state(tmp_path, name):
    variation = None if name.startswith("train") else name
    of = {} if variation is None else context_of(name)
    record = run(Random(), make_scene(name, seed=2), **of)
    write_record(record, tmp_path / "r.parquet")
    check = check_record(tmp_path / "r.parquet")
    assert check.identical
    assert check.rows == 41
    assert check.largest_difference == 0.0
    assert check.notes == ()


@pytest.mark.usefixtures("replayed_as_short")
def test_replay_check_notices_a_changed_action(tmp_path):
    record = run(Random(), make_scene("train3", seed=2))
    actions = record.applied.copy()
    actions[20, 0] = -np.sign(actions[20, 0])
    write_record(dataclasses.replace(record, action=actions, applied=actions.copy()), tmp_path / "r.parquet")
    check = check_record(tmp_path / "r.parquet")
    assert not check.identical
    assert check.first_difference == 20
    assert check.largest_difference > 0.0


@pytest.mark.parametrize("space", ["ee_delta_measured", "joint_delta"])
def test_other_action_spaces_are_replayed_in_their_own_terms(tmp_path, space, replayed_as_short):
    replayed_as_short[0] = 20
    scene = make_scene("train1", space=space, steps=20)
    policy = Scripted(lambda o: 0.2 * np.sin(0.3 * o.step) * np.ones(scene.action_space.dim))
    record = run(policy, scene)
    assert record.outcome.termination == "step_limit"
    assert record.metadata.action_space == space
    write_record(record, tmp_path / "r.parquet")
    assert check_record(tmp_path / "r.parquet").identical
