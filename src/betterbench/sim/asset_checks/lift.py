"""Simulated grasp trial: the robot's gripper, without the arm, grasps, lifts, holds and carries an asset."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from betterbench.geometry import Pose, angle_between
from betterbench.sim.asset_checks import limits
from betterbench.sim.assets import Asset, Grasp
from betterbench.sim.robots.gripper import add_floating_gripper
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.scenes import add_asset
from betterbench.sim.scenes.gripper_bench import GripperBench, table_model

_CLOSE_S = 0.9
"""Time for the gripper to close at 0.1 m/s from fully open onto the thinnest object, and to build up force [s]."""
_APPROACH_M = 0.10
"""Distance that the open jaw moves toward the object before it closes [m]. This motion reveals obstructed grasps."""
_APPROACH_SPEED = 0.12
_TIPS_ABOVE_M = 0.001
_PUSHED_M = 0.012
"""Maximum displacement of the object while the open jaw approaches [m]."""


@dataclass(frozen=True, slots=True)
class LiftTrial:
    """Outcome of a grasp trial.

    Attributes:
        succeeded: Whether the object was lifted, held and carried.
        slip_mm: How far the object moved relative to the gripper after the jaw had closed.
        swing_degrees: How far the object rotated relative to the gripper after the jaw had closed.
        reason: Why the trial failed. Empty if it succeeded.
    """

    succeeded: bool
    slip_mm: float
    swing_degrees: float
    reason: str = ""


def try_grasp(asset: Asset, grasp: Grasp, rest: Pose) -> LiftTrial:
    """Simulate one grasp of an asset that rests on a table.

    Args:
        asset: The asset.
        grasp: The grasp.
        rest: Pose ``T_table_object`` of the asset at rest.
    """
    spec = table_model()
    add_asset(spec, "asset", asset)
    robot = add_floating_gripper(spec)
    model = spec.compile()
    data = mujoco.MjData(model)

    def wait(seconds: float) -> None:
        mujoco.mj_step(model, data, nstep=round(seconds / PHYSICS.timestep_s))

    bench = GripperBench(
        model,
        data,
        robot,
        lambda: mujoco.mj_step(model, data),
        rest=rest,
        grasp=grasp,
        approach_m=_APPROACH_M,
        lowest_m=robot.tip_below_tcp_m + _TIPS_ABOVE_M,  # as in planning, keep the fingertips off the table
    )
    before = bench.asset_pose()
    bench.move(bench.target, _APPROACH_SPEED)
    wait(0.1)
    pushed = math.dist(before.position, bench.asset_pose().position)
    if not pushed <= _PUSHED_M:
        return LiftTrial(False, 1000.0 * pushed, 0.0, "the open jaw pushes it away")
    bench.close(_CLOSE_S)
    held, low = bench.asset_in_tool(), bench.asset_pose().position[2]
    bench.move(np.add(bench.at, (0.0, 0.0, limits.LIFT_M)), limits.LIFT_SPEED)
    wait(limits.HOLD_S)
    risen = bench.asset_pose().position[2] - low
    if not risen > 0.5 * limits.LIFT_M:
        return LiftTrial(False, 1000.0 * (limits.LIFT_M - risen), 0.0, "the jaw closes without lifting it")
    bench.move(np.add(bench.at, (limits.CARRY_M, 0.0, 0.0)), limits.CARRY_SPEED)
    wait(0.3)
    now = bench.asset_in_tool()
    slip = 1000.0 * _slip(held, now)
    swing = math.degrees(angle_between(held.quaternion, now.quaternion))
    if not slip <= limits.SLIP_MM:
        return LiftTrial(False, slip, swing, f"it slips by {slip:.2g} mm")
    if not swing <= limits.SWING_DEGREES:
        return LiftTrial(False, slip, swing, f"it swings by {swing:.2g} degrees")
    return LiftTrial(True, slip, swing)


def _slip(before: Pose, after: Pose) -> float:
    """Return how far the point of the asset between the gripper pads has moved [m].

    Rotations of the asset about this point are ignored.
    """
    between = before.inverse().position
    return math.dist(before.apply(between), after.apply(between))
