"""Short simulations for testing an asset during a review: a drop onto a table, and a lift with a grasp.

Each simulation returns the motion to display and a sentence that states the result.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from betterbench.geometry import Pose, angle_between, tilt_of
from betterbench.interface.actions import USUAL_ROBOT
from betterbench.sim.assets import Asset, Grasp
from betterbench.sim.robots.gripper import PREFIX, TOOL_BODY, add_floating_gripper
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.scenes.glb import body_files, surface_in_body
from betterbench.sim.scenes.gripper_bench import GripperBench, pose_of, table_model
from betterbench.sim.scenes.objects import add_asset, rest_pose

FRAME_S = 0.04
"""Time between two frames of a motion [s]."""
DROP_M = 0.03
"""Height from which an asset is dropped [m]."""
_WATCHED_S, _STILL_S = 2.0, 0.5
_STILL_M_S = 0.004
"""Surface speed below which an asset is considered to be at rest [m/s]."""
_TIPPED_DEGREES = 8.0
_APPROACH_M, _LIFT_M = 0.08, 0.12
_CLOSE_S, _HOLD_S = 0.9, 0.5
_SPEED_M_S = 0.15
_SLIP_M, _SWING_DEGREES = 0.010, 15.0


@dataclass(frozen=True, slots=True, eq=False)
class Tryout:
    """Result of a short simulation of an asset.

    Attributes:
        passed: Whether the asset passed.
        sentence: Result in one sentence.
        asset: Positions [m] and quaternions (w, x, y, z) of the asset, one row every :data:`FRAME_S`, (T, 7).
        gripper: Poses of each body of the gripper ("hand", "left_finger", "right_finger"), in the same format. Empty if
            there is no gripper.
    """

    passed: bool
    sentence: str
    asset: np.ndarray
    gripper: dict[str, np.ndarray]


class _Trial:
    """Simulation that records the poses of its bodies at regular intervals."""

    def __init__(self, spec: mujoco.MjSpec, bodies: tuple[str, ...]) -> None:
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._bodies = {name: self.model.body(name).id for name in ("asset", *bodies)}
        self._every = round(FRAME_S / PHYSICS.timestep_s)
        self._frames: dict[str, list[np.ndarray]] = {name: [] for name in self._bodies}
        self._steps = 0

    def step(self) -> None:
        """Execute one physics step."""
        mujoco.mj_step(self.model, self.data)
        if self._steps % self._every == 0:
            for name, body in self._bodies.items():
                self._frames[name].append(np.concatenate([self.data.xpos[body], self.data.xquat[body]]))
        self._steps += 1

    def wait(self, seconds: float) -> None:
        """Execute physics steps for the given time."""
        for _ in range(round(seconds / PHYSICS.timestep_s)):
            self.step()

    def pose(self, name: str) -> Pose:
        """Return the pose ``T_world_body`` of a body."""
        return _pose(self.data, name)

    def outcome(self, sentence: str, *, passed: bool) -> Tryout:
        """Return the given result together with the motion recorded so far."""
        frames = {name: np.array(rows) for name, rows in self._frames.items()}
        gripper = {name.removeprefix(PREFIX): rows for name, rows in frames.items() if name != "asset"}
        return Tryout(passed, sentence, frames["asset"], gripper)


def _pose(data: mujoco.MjData, name: str) -> Pose:
    body = data.body(name)
    return pose_of((*body.xpos, *body.xquat))


def try_drop(asset: Asset) -> Tryout:
    """Drop an asset upright onto a table, and report whether it stays upright and comes to rest."""
    spec = table_model()
    add_asset(spec, "asset", asset)
    trial = _Trial(spec, ())
    trial.data.qpos[2] = DROP_M
    reach = 0.5 * max(asset.size_m)
    rested_s = 0.0
    for k in range(round((_WATCHED_S + _STILL_S) / PHYSICS.timestep_s)):
        trial.step()
        velocity = trial.data.qvel
        if np.linalg.norm(velocity[:3]) + reach * np.linalg.norm(velocity[3:6]) > _STILL_M_S:
            rested_s = (k + 1) * PHYSICS.timestep_s
    end = trial.pose("asset")
    tilt = math.degrees(tilt_of(end.quaternion))
    away = math.hypot(*end.position[:2])
    if end.position[2] < -0.02:
        return trial.outcome(f"Falls through the table by {-100 * end.position[2]:.0f} cm.", passed=False)
    if tilt > _TIPPED_DEGREES:
        return trial.outcome(f"Tips over by {tilt:.0f}° after a drop of {100 * DROP_M:.0f} cm.", passed=False)
    if rested_s > _WATCHED_S:
        return trial.outcome(f"Still moves {_WATCHED_S:g} s after a drop of {100 * DROP_M:.0f} cm.", passed=False)
    moved = f"tilted by {tilt:.1f}°, {1000 * away:.0f} mm away"
    return trial.outcome(f"Comes to rest after {rested_s:.1f} s, {moved}.", passed=True)


def try_lift(asset: Asset, grasp: Grasp) -> Tryout:
    """Lift an asset from a table using one grasp of the default robot's gripper, and report whether it is held."""
    rest = rest_pose(asset)
    spec = table_model()
    add_asset(spec, "asset", asset)
    robot = add_floating_gripper(spec)
    trial = _Trial(spec, tuple(PREFIX + name for name in (robot.hand_body, *robot.finger_bodies)))
    bench = GripperBench(trial.model, trial.data, robot, trial.step, rest=rest, grasp=grasp, approach_m=_APPROACH_M)
    bench.move(bench.target, _SPEED_M_S)
    pushed = math.dist(trial.pose("asset").position, rest.position)
    bench.close(_CLOSE_S)
    held, low = trial.pose(TOOL_BODY).inverse() @ trial.pose("asset"), trial.pose("asset").position[2]
    bench.move(np.add(bench.at, (0.0, 0.0, _LIFT_M)), _SPEED_M_S)
    trial.wait(_HOLD_S)
    now, risen = trial.pose(TOOL_BODY).inverse() @ trial.pose("asset"), trial.pose("asset").position[2] - low
    by = f"grasp {grasp.name}"
    if pushed > 0.012:
        return trial.outcome(f"The open gripper pushes it {1000 * pushed:.0f} mm away ({by}).", passed=False)
    if risen < 0.5 * _LIFT_M:
        return trial.outcome(f"The gripper closes without lifting it ({by}).", passed=False)
    between = held.inverse().position  # the point between the pads, so that swinging does not count as slip
    slip = math.dist(held.apply(between), now.apply(between))
    swing = math.degrees(angle_between(held.quaternion, now.quaternion))
    result = f"slips {1000 * slip:.0f} mm and swings {swing:.0f}°"
    if slip > _SLIP_M or swing > _SWING_DEGREES:
        return trial.outcome(f"Lifted {100 * risen:.0f} cm, but {result} ({by}).", passed=False)
    return trial.outcome(f"Lifted {100 * risen:.0f} cm and held: {result} ({by}).", passed=True)


def asset_glb(asset: Asset) -> bytes:
    """Return the visual parts of an asset as a GLB file, in the object frame with z up."""
    spec = mujoco.MjSpec()
    add_asset(spec, "asset", asset, pose=Pose())
    model = spec.compile()
    return body_files(model)[int(model.body("asset").id)]


def collision_surfaces(asset: Asset) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the vertices (n, 3) [m] and the faces (m, 3) of each collision part of an asset.

    Round primitives are shown as boxes.
    """
    spec = mujoco.MjSpec()
    add_asset(spec, "asset", asset, pose=Pose())
    model = spec.compile()
    found = []
    for k in range(len(asset.collision)):
        geom = model.geom(f"asset_collision{k}").id
        surface = surface_in_body(model, geom)
        found.append((surface.positions, surface.faces))
    return found


def gripper_glbs() -> dict[str, bytes]:
    """Return the visual meshes of the default robot's gripper as GLB files, one per body, in the body's frame."""
    from betterbench.sim.robots.spec import build_robot_spec, robot  # noqa: PLC0415 - only the page shows it

    known = robot(USUAL_ROBOT)
    model = build_robot_spec(USUAL_ROBOT, visuals=True).compile()
    files = body_files(model)
    return {name: files[int(model.body(name).id)] for name in (known.hand_body, *known.finger_bodies)}


def gripper_poses(width_m: float) -> dict[str, Pose]:
    """Return the poses ``T_tcp_body`` of the gripper's bodies when the gripper is open by the given width [m]."""
    spec = mujoco.MjSpec()
    PHYSICS.set_solver(spec)
    robot = add_floating_gripper(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    opened = robot.jaw.joints_at(min(width_m, robot.gripper_opening_m))
    for finger, position in zip(robot.finger_joints, opened, strict=True):
        data.qpos[model.joint(PREFIX + finger).qposadr[0]] = position
    mujoco.mj_kinematics(model, data)
    return {name: _pose(data, PREFIX + name) for name in (robot.hand_body, *robot.finger_bodies)}
