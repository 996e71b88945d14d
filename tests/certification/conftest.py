"""Certificates and states made by hand, and what the tests of certification share."""

from __future__ import annotations

import dataclasses

import pytest
from tests.certification.made import make_trial

from betterbench.certification import Certificate, TrialCertificate
from betterbench.certification.runner import versions_in_use
from betterbench.geometry import Pose
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import Contact
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task


def make_certificate(*trials: TrialCertificate, **versions) -> Certificate:
    """Returns a certificate of some trials; keywords change its versions."""
    used = dataclasses.replace(versions_in_use([t.task for t in trials]), **versions)
    return Certificate(used, "Linux-test", trials, 12.5, 2)


def pose(state, poses, *, contacts=(), **fields):
    """Returns the state with some objects posed anew, which touch only what a contact says."""
    positions, quaternions = list(state.positions), list(state.quaternions)
    for name, T_world_object in poses.items():
        i = state.info.index(name)
        positions[i], quaternions[i] = T_world_object.position, T_world_object.quaternion
    kept = tuple(c for c in state.contacts if not {c.a, c.b} & set(poses))
    return dataclasses.replace(
        state,
        positions=tuple(positions),
        quaternions=tuple(quaternions),
        contacts=kept + tuple(Contact(a, b, 1.0) for a, b in contacts),
        **fields,
    )


@pytest.fixture
def trial():
    return make_trial


@pytest.fixture
def certificate():
    return make_certificate


@pytest.fixture
def posed():
    return pose


@pytest.fixture(scope="session")
def start():
    """A training condition of a task and its state at reset, seed 0."""

    def make(task_id, name="train1"):
        task = get_task(task_id)
        scene = Scene(task, task.train(name), seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
        return task, task.train(name), scene.reset(check_premise=False)

    return make


@pytest.fixture
def in_bag():
    """A pose on the floor of the bag of `fast_food`."""

    def make(state):
        floor = state.info.object("box").region("inside")
        return Pose(
            state.pose("box").apply((0.0, -0.05, floor.position[2] - floor.half_size[2])),
            state.pose("box").quaternion,
        )

    return make
