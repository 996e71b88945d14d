"""Trial of one grasp: the robot's own gripper without its arm closes, lifts, holds and carries the asset."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from betterbench.geometry import Pose, angle_between
from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.rest import pose_of, table_model
from betterbench.sim.assets import Asset, Grasp
from betterbench.sim.robots.gripper import CARRIER_JOINTS, PREFIX, TOOL_BODY, add_floating_gripper
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.scenes import add_asset

_CLOSE_S = 0.9
"""Time to close from fully open at 0.1 m/s onto the thinnest object, plus a moment to press [s]."""
_APPROACH_M = 0.10
"""Travel of the open jaw along its approach before it closes [m]; reveals a grasp that the object obstructs."""
_APPROACH_SPEED = 0.12
_TIPS_ABOVE_M = 0.001
_PUSHED_M = 0.012
"""Largest displacement of the object while the open jaw approaches [m]."""


@dataclass(frozen=True, slots=True)
class LiftTrial:
    """Outcome of one grasp.

    Attributes:
        succeeded: Whether the object was lifted, held and carried.
        slip_mm: Displacement of the object relative to the gripper after the jaw closed.
        swing_degrees: Rotation of the object relative to the gripper after the jaw closed.
        reason: Why the trial failed, empty if it succeeded.
    """

    succeeded: bool
    slip_mm: float
    swing_degrees: float
    reason: str = ""


class _Bench:
    """A table, the asset at rest on it and the gripper above it."""

    def __init__(self, asset: Asset, rest: Pose, grasp: Grasp) -> None:
        spec = table_model()
        add_asset(spec, "asset", asset)
        robot = add_floating_gripper(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._opening = robot.gripper_opening_m
        target = rest @ grasp.pose
        self.model.body(TOOL_BODY).quat[:] = target.quaternion
        self._carrier = [self.model.actuator(name).id for name in CARRIER_JOINTS]
        self._gripper = self.model.actuator(PREFIX + robot.gripper_actuator).id
        self._closed = float(self.model.actuator_ctrlrange[self._gripper, 0])
        self._speed = robot.gripper_speed_m_s
        self._asset = self.model.joint("asset_joint").qposadr[0]
        self.data.qpos[self._asset : self._asset + 7] = (*rest.position, *rest.quaternion)
        approach = Pose((0.0, 0.0, 0.0), target.quaternion).apply((0.0, 0.0, -_APPROACH_M))
        self.target = np.array(target.position)
        # Planners keep the fingertips off the table.
        self.target[2] = max(self.target[2], robot.tip_below_tcp_m + _TIPS_ABOVE_M)
        self.at = np.add(self.target, approach)
        for name, value in zip(CARRIER_JOINTS, self.at, strict=True):
            self.data.qpos[self.model.joint(name).qposadr[0]] = value
        opened = min(self._opening, grasp.width_m + 2.0 * grasp.clearance_m)
        for finger in robot.finger_joints:
            self.data.qpos[self.model.joint(PREFIX + finger).qposadr[0]] = 0.5 * opened
        self.width = opened
        self._command()

    def _command(self) -> None:
        self.data.ctrl[self._carrier] = self.at
        self.data.ctrl[self._gripper] = self.width

    def move(self, to: np.ndarray, speed: float) -> None:
        """Move the gripper straight to a point [m] with a smooth start and end, at a mean ``speed`` [m/s]."""
        start = self.at.copy()
        steps = max(1, round(float(np.linalg.norm(to - start)) / speed / PHYSICS.timestep_s))
        for k in range(1, steps + 1):
            share = k / steps
            self.at = start + (3.0 - 2.0 * share) * share**2 * (to - start)
            self._command()
            mujoco.mj_step(self.model, self.data)

    def close(self) -> None:
        """Close the jaw at its own speed and press."""
        for _ in range(round(_CLOSE_S / PHYSICS.timestep_s)):
            self.width = max(self._closed, self.width - self._speed * PHYSICS.timestep_s)
            self._command()
            mujoco.mj_step(self.model, self.data)

    def wait(self, seconds: float) -> None:
        """Advance the simulation."""
        mujoco.mj_step(self.model, self.data, nstep=round(seconds / PHYSICS.timestep_s))

    def asset_pose(self) -> Pose:
        """Return ``T_world_object``."""
        q = self.data.qpos[self._asset : self._asset + 7]
        return pose_of(q)

    def asset_in_tool(self) -> Pose:
        """Return ``T_tool_object``."""
        tool = self.data.body(TOOL_BODY)
        return pose_of((*tool.xpos, *tool.xquat)).inverse() @ self.asset_pose()


def try_grasp(asset: Asset, grasp: Grasp, rest: Pose) -> LiftTrial:
    """Try one grasp of an asset that rests on a table.

    Args:
        asset: The asset.
        grasp: The grasp.
        rest: Pose ``T_table_object`` at rest.
    """
    bench = _Bench(asset, rest, grasp)
    before = bench.asset_pose()
    bench.move(bench.target, _APPROACH_SPEED)
    bench.wait(0.1)
    pushed = math.dist(before.position, bench.asset_pose().position)
    if not pushed <= _PUSHED_M:
        return LiftTrial(False, 1000.0 * pushed, 0.0, "the open jaw pushes it away")
    bench.close()
    held, low = bench.asset_in_tool(), bench.asset_pose().position[2]
    bench.move(np.add(bench.at, (0.0, 0.0, limits.LIFT_M)), limits.LIFT_SPEED)
    bench.wait(limits.HOLD_S)
    risen = bench.asset_pose().position[2] - low
    if not risen > 0.5 * limits.LIFT_M:
        return LiftTrial(False, 1000.0 * (limits.LIFT_M - risen), 0.0, "the jaw closes without lifting it")
    bench.move(np.add(bench.at, (limits.CARRY_M, 0.0, 0.0)), limits.CARRY_SPEED)
    bench.wait(0.3)
    now = bench.asset_in_tool()
    slip = 1000.0 * _slip(held, now)
    swing = math.degrees(angle_between(held.quaternion, now.quaternion))
    if not slip <= limits.SLIP_MM:
        return LiftTrial(False, slip, swing, f"it slips by {slip:.2g} mm")
    if not swing <= limits.SWING_DEGREES:
        return LiftTrial(False, slip, swing, f"it swings by {swing:.2g} degrees")
    return LiftTrial(True, slip, swing)


def _slip(before: Pose, after: Pose) -> float:
    """Return the displacement [m] of the point of the asset between the pads, which excludes swinging."""
    between = before.inverse().position
    return math.dist(before.apply(between), after.apply(between))
