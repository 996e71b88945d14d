"""The arm over a table, compiled once for all tests of the package."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import pytest
from tests.sim.robots.bench import Bench

from betterbench.interface.actions import EE_DELTA, ActionSpace
from betterbench.sim.robots import PANDA, ArmIK, build_robot_spec


@pytest.fixture(scope="session")
def arm_model() -> mujoco.MjModel:
    return build_robot_spec("panda", visuals=False).compile()


@pytest.fixture(scope="session")
def block_model() -> mujoco.MjModel:
    """The arm, a table top at z = 0 and a block of 5 cm and 0.3 kg at (0.45, 0)."""
    spec = build_robot_spec("panda", visuals=False)
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, pos=(0.55, 0.0, -0.02), size=(0.4, 0.6, 0.02))
    block = spec.worldbody.add_body(name="block", pos=(0.45, 0.0, 0.025))
    block.add_freejoint()
    block.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=(0.025,) * 3, mass=0.3, friction=(0.8, 0.005, 0.0001), condim=4)
    return spec.compile()


@pytest.fixture
def bench(arm_model: mujoco.MjModel) -> Callable[[ActionSpace], Bench]:
    def make(space: ActionSpace = EE_DELTA) -> Bench:
        return Bench(arm_model, space)

    return make


@pytest.fixture(scope="session")
def ik() -> ArmIK:
    return ArmIK(PANDA)
