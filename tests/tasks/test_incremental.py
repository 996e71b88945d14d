"""Predicates are asked again after a change of what they have read; verdicts are the same as if all were asked."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from tests.daily import part_of_today

from betterbench.geometry import from_yaw
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import Contact, WorldState
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import FAST
from betterbench.tasks import GoalTracker, get_task
from betterbench.tasks.judging.incremental import JudgingMemory
from betterbench.tasks.judging.targets import Targets, asked_by
from betterbench.tasks.relations import RELATIONS
from betterbench.tasks.relations.authoring import held_upon, rests_on

TASKS = {
    "inside": "fast_food",
    "layer": "cheeseburger",
    "beside": "desk_meeting",
    "on_plate": "dinner_plates",
    "on_ring": "morning_coffee",
    "in_hole": "seasoning_rack",
    "closed": "office_drawer",
}
"""A task for each relation of the suite."""


def test_every_relation_is_compared():
    assert set(TASKS) == set(RELATIONS)


@pytest.mark.parametrize("steps", [40, pytest.param(120, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["breakfast_table", *TASKS.values()])
def test_places_after_changes_are_those_of_the_whole_state(name: str, steps: int) -> None:
    task = get_task(name)
    scene = Scene(task, task.training[0], seed=3, action_space=EE_DELTA, quality=FAST)
    state, random = scene.reset(), np.random.default_rng(4)
    targets = Targets(asked_by(scene.condition), scene.info, placing=task.template.relation)
    tracker, memory, truths = _tracker(scene), JudgingMemory(targets), set()
    for step in range(steps):
        state = dataclasses.replace(_changed(state, targets, random), step=step)
        relations = tracker.update(state).relations
        assert memory.places(state) == targets.places(state), step
        assert relations == _tracker(scene).update(state).relations, step
        truths.add(relations)
    assert len(truths) > 3


def test_a_predicate_is_asked_again_only_after_a_change_of_what_it_has_read(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = _scene()
    asked: list[str] = []

    def where(state: WorldState, name: str, target: str) -> str | None:
        asked.append(name)
        return "" if state.position(name)[2] > state.pose(target).position[2] else None

    monkeypatch.setitem(RELATIONS, "inside", dataclasses.replace(RELATIONS["inside"], where=where))
    targets = Targets(asked_by(scene.condition), scene.info, placing="inside")
    state, memory = scene.reset(), JudgingMemory(targets)
    asked.clear()  # by the premise of the scene
    watch, others = targets.watches[0], [name for w in targets.watches[1:] for name in w.subjects]
    memory.places(state)
    assert asked == [*watch.subjects, *others]
    asked.clear()
    memory.places(dataclasses.replace(state, step=1))
    assert asked == []
    lifted = _lifted(state, watch.subjects[1])
    memory.places(lifted)
    assert set(asked) == {watch.subjects[1]}
    memory.places(_lifted(lifted, watch.target))
    assert set(asked) >= set(watch.subjects)


def _odd(*numbers: float) -> bool:
    """Tell something that another number changes every other time."""
    return int(1e6 * sum(numbers)) % 2 == 1


READERS: dict[str, Callable[[WorldState, str, str], object]] = {
    "the pose of another object": lambda s, _n, _t: _odd(*s.pose("burger_1").position),
    "all positions": lambda s, _n, _t: _odd(*(p[0] for p in s.positions)),
    "all rotations": lambda s, _n, _t: _odd(*(q[0] for q in s.quaternions)),
    "what is held": lambda s, n, _t: s.held == n,
    "a contact of others": lambda s, _n, _t: s.touching("left_finger", "burger_1"),
    "a contact with the table": lambda s, n, _t: s.touching("table", n),
    "the gripper": lambda s, n, _t: s.touched_by_gripper(n),
    "forces": lambda s, _n, _t: any(c.force_n > 0.5 for c in s.contacts),
    "time": lambda s, _n, _t: s.step % 2 == 0,
    "the hand": lambda s, _n, _t: _odd(*s.ee_pose.position),
    "speeds": lambda s, n, _t: s.linear_speeds[s.info.index(n)] > 0.5,
    "a state of its own": lambda s, n, t: dataclasses.replace(s, contacts=s.contacts[:1]).touching(n, t),
    "what carries it": lambda s, n, t: rests_on(s, n, t) or held_upon(s, n, t),
    "first one body, then another": lambda s, n, t: s.touching(n, "table") or s.touching(t, "left_finger"),
}


@pytest.mark.parametrize("steps", [75, pytest.param(150, marks=pytest.mark.slow)])
@pytest.mark.parametrize("what", list(READERS))
def test_a_predicate_may_read_anything_of_a_state(what: str, steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    read = READERS[what]
    scene = _scene()
    state = scene.reset()
    changed = Targets(asked_by(scene.condition), scene.info, placing="inside")
    plain = dataclasses.replace(RELATIONS["inside"], where=lambda s, n, t: "" if read(s, n, t) else None)
    monkeypatch.setitem(RELATIONS, "inside", plain)
    targets = Targets(asked_by(scene.condition), scene.info, placing="inside")
    tracker, memory, found = _tracker(scene), JudgingMemory(targets), set()
    random = np.random.default_rng(5)
    for step in range(steps):
        if random.random() < 0.6:
            state = _changed(state, changed, random)
        turned = int(random.integers(len(state.quaternions)))
        state = dataclasses.replace(
            state,
            step=step,
            quaternions=(*state.quaternions[:turned], from_yaw(random.random()), *state.quaternions[turned + 1 :]),
            contacts=tuple(Contact(a, b, float(random.random())) for a, b, _ in state.contacts),
            linear_speeds=tuple(random.random(len(state.positions)).tolist()),
            ee_pose=state.ee_pose.translated(*random.normal(size=3).tolist()),
        )
        places = memory.places(state)
        assert places == targets.places(state), step
        assert tracker.update(state).relations == targets.relations(places), step
        found.add(places)
    assert len(found) > 1, "nothing has changed"


@pytest.mark.parametrize("seeds", [part_of_today(range(4), 2), pytest.param(range(4), marks=pytest.mark.slow)], ids=len)
@pytest.mark.parametrize("name", ["fast_food", "breakfast_table", "fruit_lunch", "dinner_plates"])
def test_what_lasts_while_nothing_changes_is_what_is_found_again(name: str, seeds: Sequence[int]) -> None:
    """Things stay for a while, tremble, are let go and come to rest; each state is also judged in full."""
    task, seen, lasted = get_task(name), set(), 0
    for seed in seeds:
        scene = Scene(task, task.training[0], seed=seed, action_space=EE_DELTA, quality=FAST)
        state, random = scene.reset(), np.random.default_rng(seed)
        targets = Targets(asked_by(scene.condition), scene.info, placing=task.template.relation)
        tracker, in_full = _tracker(scene), _tracker(scene)
        step = 0
        for _ in range(25):
            state = _changed(state, targets, random)
            if random.random() < 0.6:  # let go
                kept = tuple(c for c in state.contacts if "left_finger" not in c[:2])
                state = dataclasses.replace(state, contacts=kept, held=None)
            for _ in range(int(random.integers(1, 14))):
                trembling = tuple(Contact(a, b, float(random.random())) for a, b, _ in state.contacts)
                state = dataclasses.replace(state, step=step, contacts=trembling)
                in_full._memory.truth = None
                lasted += tracker._memory.truth is not None
                truth = tracker.update(state)
                assert truth == in_full.update(state), step
                assert tracker.harm == in_full.harm
                seen.add((truth.subgoals, truth.goal))
                step += 1
    assert lasted > 50 * len(seeds)
    assert len(seen) > 1


def _scene() -> Scene:
    task = get_task("fast_food")
    return Scene(task, task.training[0], seed=3, action_space=EE_DELTA, quality=FAST)


def _lifted(state: WorldState, name: str) -> WorldState:
    i = state.info.index(name)
    x, y, z = state.positions[i]
    return dataclasses.replace(state, positions=(*state.positions[:i], (x, y, z + 0.3), *state.positions[i + 1 :]))


def _tracker(scene: Scene) -> GoalTracker:
    return GoalTracker(scene.condition, scene.info, template=scene.task.template, control_rate_hz=20.0)


def _changed(state: WorldState, targets: Targets, random: np.random.Generator) -> WorldState:
    """Return a state in which something has come to a target, or nearly, with other contacts."""
    watch = targets.watches[random.integers(len(targets.watches))]
    name, region = (str(random.choice(names)) for names in (watch.subjects, watch.places))
    if watch.relation.carried:
        goals = [g.pose for g in watch.relation.place_goals(state, name, watch.target, region)]
    else:  # a drawer on its rail
        goals = [state.pose(watch.target) @ state.info.object(watch.target).region(region).pose]
    if not goals:
        return state
    goal = goals[0].translated(*(0.01 * random.normal(size=3) * random.integers(2)).tolist())
    i = state.info.index(name)
    positions = (*state.positions[:i], goal.position, *state.positions[i + 1 :])
    quaternions = (*state.quaternions[:i], goal.quaternion, *state.quaternions[i + 1 :])
    contacts = tuple(c for c in state.contacts if random.random() < 0.9)
    contacts += (Contact(name, str(random.choice([watch.target, "table", "left_finger"])), 1.0),)
    held = name if random.random() < 0.2 else None
    return dataclasses.replace(state, positions=positions, quaternions=quaternions, contacts=contacts, held=held)
