"""An honest policy that puts things far from the middle of a side, or short of it, is not accused of its place."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.daily import TODAY, others_slow

from betterbench.diagnosis import diagnose_record
from betterbench.episodes import TrialContext, run_episode
from betterbench.geometry import Pose
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.experts import make_expert
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import GoalTracker
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.relations import RELATIONS

WITHIN = {
    "laptop": {"right": (0.04, 0.06), "left": (0.04, -0.06), "behind": (-0.04, 0.0)},
    "plate": {"left": (-0.05, -0.01), "right": (0.05, 0.01), "upper_right": (0.01, -0.01)},
}
"""Displacements in the frame of the anchor [m] to where a person still accepts things, outside the small places."""
BEYOND = {
    "laptop": {"right": (0.12, 0.12), "left": (0.14, -0.06), "behind": (-0.15, 0.0)},
    "plate": {"left": (0.0, -0.045), "right": (0.0, 0.045), "upper_right": (-0.12, 0.0)},
}
"""Displacements to where it is free and no longer beside the anchor."""
CASES = (("desk_meeting", "train1"), ("desk_meeting", "R1"), ("breakfast_table", "train2"), ("breakfast_table", "R1"))


def _shifted(ways):
    beside = RELATIONS["beside"]

    def goals(state, name, anchor, side):
        dx, dy = ways[anchor][side]
        frame = state.pose(anchor)
        way = np.subtract(frame.apply((dx, dy, 0.0)), frame.position)
        return tuple(
            dataclasses.replace(goal, pose=Pose(tuple(np.add(goal.pose.position, way).tolist()), goal.pose.quaternion))
            for goal in beside.goals(state, name, anchor, side)
        )

    return dataclasses.replace(beside, goals=goals)


def _record(task, name):
    found = resolve_condition(task, name)
    scene = Scene(found.task, found.condition, seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
    policy = make_expert("expert", scene)
    return run_episode(scene, policy, context=TrialContext(policy="expert")).record, found


@pytest.mark.parametrize(("task", "name"), others_slow(CASES, 4))
def test_near_the_edge_of_a_side_is_a_success_live_and_offline(monkeypatch, task, name):
    monkeypatch.setitem(RELATIONS, "beside", _shifted(WITHIN))
    record, found = _record(task, name)
    assert diagnose_record(record).success
    told, rate_hz = record.metadata.scene, record.metadata.control_rate_hz
    tracker = GoalTracker(found.condition, told, template=found.task.template, control_rate_hz=rate_hz)
    truths = [tracker.update(state) for state in record.states()]
    assert truths[-1].success


@pytest.mark.parametrize(("task", "name"), others_slow(CASES, 4, day=TODAY + 1))
def test_beyond_the_side_is_execution_and_no_habit(monkeypatch, task, name):
    monkeypatch.setitem(RELATIONS, "beside", _shifted(BEYOND))
    record, _ = _record(task, name)
    found = diagnose_record(record)
    assert not found.success
    assert (found.label.value, found.evidence.rule) == ("execution_failure", "placed_outside_the_goal"), found.evidence
