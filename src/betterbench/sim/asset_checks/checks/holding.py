"""Checks that a container can hold a ball, and that a block can stand on an object such as a plate."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from betterbench.geometry import Pose, tilt_of
from betterbench.interface.state import Region
from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.check import Finding, at_most, check, not_applicable
from betterbench.sim.asset_checks.subject import Subject
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.scenes import add_asset
from betterbench.sim.scenes.gripper_bench import pose_of, table_model

_SECONDS = 2.0


@check
def holds_ball(subject: Subject) -> Finding:
    """Check that a ball dropped into a container comes to rest near the floor of the container."""
    asset = subject.asset
    if not subject.holds:
        return not_applicable("it is not a container")
    opening, inside = asset.region("opening"), asset.region("inside")
    radius = min(limits.BALL_SHARE * min(opening.half_size[:2]), limits.BALL_MOST_M)
    floor = inside.position[2] - inside.half_size[2]
    depth = max(2.0 * inside.half_size[2], 1e-6)
    worst: Finding | None = None
    for share in (0.0, 0.5):
        x = opening.position[0] + share * (opening.half_size[0] - radius)
        above = opening.position[2] + radius + limits.BALL_FREE_M
        pose = _dropped(subject, ball=(x, opening.position[1], above), radius=radius)
        height = pose.position[2] - radius - floor
        aside = max(abs(pose.position[k] - inside.position[k]) - inside.half_size[k] for k in (0, 1))
        found = _judged(height, aside, radius, depth)
        worst = found if worst is None or found.fails else worst
    if worst is None:
        raise AssertionError("no ball was dropped")
    return worst


def _judged(height: float, aside: float, radius: float, depth: float) -> Finding:
    cure = "Check its collision parts: the floor may be open, or the opening closed"
    if aside > 0.0 or height < -limits.BALL_BELOW_M:
        where = "beside it" if aside > 0.0 else f"{-1000 * height:.2g} mm below its floor"
        return Finding(1000 * height, -1000 * limits.BALL_BELOW_M, "mm", True, f"a dropped ball lies {where}", cure)
    # In a shallow hollow, the depth would give too strict a limit for a large ball.
    limit = max(limits.BALL_DEPTH_SHARE * depth, 0.5 * radius)
    said = f"a dropped ball rests {1000 * height:.2g} mm above its floor, {1000 * depth:.3g} mm below the rim"
    return at_most(1000 * height, 1000 * limit, "mm", said, cure)


def _dropped(subject: Subject, *, ball: tuple[float, float, float], radius: float) -> Pose:
    """Drop a ball into the asset, which is fixed in the air. Return the final pose ``T_object_ball``."""
    spec = mujoco.MjSpec()
    PHYSICS.set_scene(spec)
    add_asset(spec, "asset", subject.asset, pose=subject.rest.pose)
    body = spec.worldbody.add_body(name="ball")
    body.add_freejoint()
    mass = limits.BALL_DENSITY * 4.0 / 3.0 * math.pi * radius**3
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], mass=mass, friction=[0.6, 0.01, 0.002])
    return _after(spec, [(subject.rest.pose @ Pose(ball))], subject.rest.pose)


def _after(spec: mujoco.MjSpec, free: list[Pose], held: Pose | None) -> Pose:
    """Simulate two seconds, and return the final pose of the last free body relative to the asset.

    Args:
        spec: The MuJoCo model.
        free: Initial world poses of the free bodies, in the order of the model.
        held: Pose of the asset if it is fixed. None if the asset is the first free body.
    """
    model = spec.compile()
    data = mujoco.MjData(model)
    for k, pose in enumerate(free):
        data.qpos[7 * k : 7 * k + 7] = (*pose.position, *pose.quaternion)
    mujoco.mj_step(model, data, nstep=round(_SECONDS / PHYSICS.timestep_s))
    if not np.isfinite(data.qpos).all():
        raise ValueError("the simulation diverged")
    first, last = (pose_of(q) for q in (data.qpos[:7], data.qpos[-7:]))
    return (held or first).inverse() @ last


@check
def carries_block(subject: Subject) -> Finding:
    """Check that a block placed on top of the asset stays there.

    The check only applies to assets that have a region named "top".
    """
    top = next((region for region in subject.asset.regions if region.name == "top"), None)
    if top is None:
        return not_applicable("it does not declare a top")
    half = min(limits.BLOCK_M, 0.7 * min(top.half_size[:2]))
    pose = _put(subject, top, half)
    x, y, z = pose.position
    moved = 1000.0 * math.dist((x, y, z), (top.position[0], top.position[1], top.position[2] + half))
    turned = math.degrees(tilt_of(pose.quaternion))
    cure = "Check that its top is level, and that its collision parts end at the visible top"
    if turned > limits.CARRY_TILT_DEGREES:
        said = f"a block on its top tips by {turned:.2g} degrees"
        return Finding(turned, limits.CARRY_TILT_DEGREES, "degrees", True, said, cure)
    return at_most(moved, limits.CARRY_DRIFT_MM, "mm", f"a block on its top moves {moved:.2g} mm", cure)


def _put(subject: Subject, top: Region, half: float) -> Pose:
    spec = table_model()
    add_asset(spec, "asset", subject.asset)
    body = spec.worldbody.add_body(name="block")
    body.add_freejoint()
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=[half] * 3, mass=limits.BLOCK_KG * (half / limits.BLOCK_M) ** 3, condim=4
    )
    start = Pose((top.position[0], top.position[1], top.position[2] + half + 0.002))
    return _after(spec, [subject.rest.pose, subject.rest.pose @ start], None)
