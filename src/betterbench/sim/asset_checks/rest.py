"""Simulate how one asset settles on a table, to find its pose at rest and how much it still moves there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from betterbench.geometry import Pose, tilt_of
from betterbench.sim.asset_checks import limits
from betterbench.sim.assets import Asset
from betterbench.sim.assets.importing.measures import corners_of, visual_surface
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.scenes import add_asset
from betterbench.sim.scenes.gripper_bench import pose_of, table_model


@dataclass(frozen=True, slots=True)
class Rest:
    """Pose of an asset at rest on a table, and how much the asset still moves.

    Attributes:
        pose: Final pose ``T_table_object``.
        drift_mm: How far the center of mass moved during the observation time.
        tilt_degrees: Angle between the asset's vertical axis at the start and at the end.
        jitter_mm_s: Root mean square speed of the surface during the observation time.
        lowest_mm: Height of the lowest visible point above the table at the end. It is negative if the point is below
            the table surface.
    """

    pose: Pose
    drift_mm: float
    tilt_degrees: float
    jitter_mm_s: float
    lowest_mm: float


def settled(asset: Asset) -> Rest:
    """Release an asset just above a table in simulation, let it settle, and measure how much it still moves."""
    spec = table_model()
    add_asset(spec, "asset", asset)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[2] = limits.DROP_M - min(float(corners_of(part)[:, 2].min()) for part in asset.collision)
    steps = round(1.0 / PHYSICS.timestep_s)
    mujoco.mj_step(model, data, nstep=round(limits.SETTLE_S * steps))
    start = data.body("asset").xipos.copy()
    reach = 0.5 * max(asset.size_m)
    speeds = []
    every = 5
    for _ in range(round(limits.WATCH_S * steps / every)):
        mujoco.mj_step(model, data, nstep=every)
        speeds.append(float(np.linalg.norm(data.qvel[:3])) + reach * float(np.linalg.norm(data.qvel[3:6])))
    pose = pose_of(data.qpos[:7])
    vertices, faces = visual_surface(asset)
    turned = np.array([pose.apply(v) for v in vertices[np.unique(faces)].tolist()])
    return Rest(
        pose=pose,
        drift_mm=1000.0 * float(np.linalg.norm(data.body("asset").xipos - start)),
        tilt_degrees=math.degrees(tilt_of(pose.quaternion)),
        jitter_mm_s=1000.0 * float(np.sqrt(np.mean(np.square(speeds)))),
        lowest_mm=1000.0 * float(turned[:, 2].min()),
    )
