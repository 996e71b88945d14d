"""Test bench for grasps without an arm: an asset at rest on a table, and the robot's gripper floating above it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from betterbench.geometry import Pose, normalize
from betterbench.sim.assets import Grasp
from betterbench.sim.robots.gripper import CARRIER_JOINTS, PREFIX, TOOL_BODY
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.robots.spec import RobotSpec


def pose_of(numbers: Sequence[float] | np.ndarray) -> Pose:
    """Convert the seven numbers of a free joint, position [m] and quaternion, to a pose."""
    x, y, z, *quaternion = (float(v) for v in numbers)
    return Pose((x, y, z), normalize(quaternion))


def table_model(*, friction: float = 1.0) -> mujoco.MjSpec:
    """Return a model with a table top at z = 0 and the physics options of betterbench's scenes.

    The only difference is that MuJoCo does not put resting objects to sleep.
    """
    spec = mujoco.MjSpec()
    PHYSICS.set_scene(spec)
    # If objects could sleep, an object that never comes to rest would not be noticed.
    spec.option.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    spec.worldbody.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[2, 2, 0.05],
        pos=[0, 0, -0.05],
        friction=[friction, 0.005, 1e-4],
    )
    return spec


class GripperBench:
    """Floating gripper that starts open, at a distance from the grasp to try. The asset (body "asset") is at rest."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: RobotSpec,
        step: Callable[[], None],
        *,
        rest: Pose,
        grasp: Grasp,
        approach_m: float,
        lowest_m: float = -np.inf,
    ) -> None:
        """Place the asset and the gripper.

        Args:
            model: Model with a table, the asset, and the gripper that :func:`add_floating_gripper` adds.
            data: State of the model, which is changed.
            robot: Description of the robot.
            step: Function that executes one physics step.
            rest: Pose ``T_world_object`` of the asset at rest.
            grasp: The grasp to try.
            approach_m: Distance between the start of the gripper and the grasp, opposite to the approach direction [m].
            lowest_m: Minimum height of the tool center point at the grasp [m].
        """
        self._model, self._data, self._step = model, data, step
        target = rest @ grasp.pose
        model.body(TOOL_BODY).quat[:] = target.quaternion
        self._carrier = [model.actuator(name).id for name in CARRIER_JOINTS]
        self._gripper = model.actuator(PREFIX + robot.gripper_actuator).id
        self._jaw, self._closed = robot.jaw, -robot.gripper_lead_m
        self._speed = robot.gripper_speed_m_s
        self._asset = model.joint("asset_joint").qposadr[0]
        data.qpos[self._asset : self._asset + 7] = (*rest.position, *rest.quaternion)
        self.target = np.array(target.position)
        self.target[2] = max(self.target[2], lowest_m)
        self.at = np.add(self.target, Pose((0.0, 0.0, 0.0), target.quaternion).apply((0.0, 0.0, -approach_m)))
        for name, value in zip(CARRIER_JOINTS, self.at, strict=True):
            data.qpos[model.joint(name).qposadr[0]] = value
        self.width = min(robot.gripper_opening_m, grasp.width_m + 2.0 * grasp.clearance_m)
        for finger, position in zip(robot.finger_joints, self._jaw.joints_at(self.width), strict=True):
            data.qpos[model.joint(PREFIX + finger).qposadr[0]] = position
        self._command()

    def _command(self) -> None:
        self._data.ctrl[self._carrier] = self.at
        self._data.ctrl[self._gripper] = self._jaw.control_at(self.width)

    def move(self, to: np.ndarray, speed: float) -> None:
        """Move the gripper straight to a point [m] at the mean ``speed`` [m/s], with a smooth start and end."""
        start = self.at.copy()
        steps = max(1, round(float(np.linalg.norm(to - start)) / speed / PHYSICS.timestep_s))
        for k in range(1, steps + 1):
            share = k / steps
            self.at = start + (3.0 - 2.0 * share) * share**2 * (to - start)
            self._command()
            self._step()

    def close(self, seconds: float) -> None:
        """Close the jaws at the speed of the gripper and keep pressing, for the given time in total [s]."""
        for _ in range(round(seconds / PHYSICS.timestep_s)):
            self.width = max(self._closed, self.width - self._speed * PHYSICS.timestep_s)
            self._command()
            self._step()

    def asset_pose(self) -> Pose:
        """Return the current pose ``T_world_object`` of the asset."""
        return pose_of(self._data.qpos[self._asset : self._asset + 7])

    def asset_in_tool(self) -> Pose:
        """Return the current pose ``T_tool_object`` of the asset."""
        tool = self._data.body(TOOL_BODY)
        return pose_of((*tool.xpos, *tool.xquat)).inverse() @ self.asset_pose()
