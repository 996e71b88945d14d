"""Relations that read a pair alone are asked again only where it has changed; verdicts are the same as if all were."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import Contact, WorldState
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import FAST
from betterbench.tasks import GoalTracker, get_task
from betterbench.tasks.judging.targets import Targets, asked_by


@pytest.mark.parametrize("name", ["fast_food", "breakfast_table", "desk_meeting"])
def test_places_after_changes_are_those_of_the_whole_state(name: str) -> None:
    task = get_task(name)
    scene = Scene(task, task.training[0], seed=3, action_space=EE_DELTA, quality=FAST)
    state, random = scene.reset(), np.random.default_rng(4)
    targets = Targets(asked_by(scene.condition), scene.info, placing=task.template.relation)
    tracker, truths = _tracker(scene), set()
    for step in range(80):
        state = dataclasses.replace(_changed(state, targets, random), step=step)
        relations = tracker.update(state).relations
        assert relations == _tracker(scene).update(state).relations, step
        truths.add(relations)
    assert len(truths) > 3


@pytest.mark.parametrize("name", ["fast_food", "breakfast_table", "fruit_lunch", "dinner_plates"])
def test_what_lasts_while_nothing_changes_is_what_is_found_again(name: str) -> None:
    """Things stay for a while, tremble, are let go and come to rest; each state is also judged in full."""
    task, seen, lasted = get_task(name), set(), 0
    for seed in range(4):
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
                in_full._lasting = None
                lasted += tracker._lasting is not None
                truth = tracker.update(state)
                assert truth == in_full.update(state), step
                assert tracker.harm == in_full.harm
                seen.add((truth.subgoals, truth.goal))
                step += 1
    assert lasted > 200
    assert len(seen) > 1


def _tracker(scene: Scene) -> GoalTracker:
    return GoalTracker(scene.condition, scene.info, template=scene.task.template, control_rate_hz=20.0)


def _changed(state: WorldState, targets: Targets, random: np.random.Generator) -> WorldState:
    """Return a state in which something has come to a target, or nearly, with other contacts."""
    watch = targets.watches[random.integers(len(targets.watches))]
    name, region = (str(random.choice(names)) for names in (watch.subjects, watch.places))
    goals = watch.relation.place_goals(state, name, watch.target, region)
    if not goals:
        return state
    goal = goals[0].pose.translated(*(0.01 * random.normal(size=3) * random.integers(2)).tolist())
    i = state.info.index(name)
    positions = (*state.positions[:i], goal.position, *state.positions[i + 1 :])
    quaternions = (*state.quaternions[:i], goal.quaternion, *state.quaternions[i + 1 :])
    contacts = tuple(c for c in state.contacts if random.random() < 0.9)
    contacts += (Contact(name, str(random.choice([watch.target, "table", "left_finger"])), 1.0),)
    held = name if random.random() < 0.2 else None
    return dataclasses.replace(state, positions=positions, quaternions=quaternions, contacts=contacts, held=held)
