"""The gripper without its arm: where it is, and that it grips with the force of the robot's own."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from betterbench.errors import UnknownNameError
from betterbench.sim.robots import PANDA
from betterbench.sim.robots.gripper import CARRIER_JOINTS, PREFIX, TOOL_BODY, add_floating_gripper


def test_the_tool_is_where_the_slides_are_and_the_jaw_presses_with_its_own_force():
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.02], pos=[0.1, 0.0, 0.3])
    assert add_floating_gripper(spec) is PANDA
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, value in zip(CARRIER_JOINTS, (0.1, 0.0, 0.3), strict=True):
        data.joint(name).qpos[0] = data.ctrl[model.actuator(name).id] = value
    for finger in PANDA.finger_joints:
        data.joint(PREFIX + finger).qpos[0] = 0.04
    data.ctrl[model.actuator(PREFIX + PANDA.gripper_actuator).id] = -PANDA.gripper_lead_m
    mujoco.mj_step(model, data, nstep=500)
    assert np.allclose(data.body(TOOL_BODY).xpos, (0.1, 0.0, 0.3), atol=5e-4)
    width = sum(float(data.joint(PREFIX + finger).qpos[0]) for finger in PANDA.finger_joints)
    assert width == pytest.approx(0.04, abs=0.001)
    assert data.actuator(PREFIX + PANDA.gripper_actuator).force[0] == pytest.approx(-PANDA.gripper_force_n)


def test_an_unknown_robot_is_named():
    with pytest.raises(UnknownNameError, match="pandda"):
        add_floating_gripper(mujoco.MjSpec(), "pandda")
