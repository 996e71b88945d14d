"""Assets in MuJoCo: functions that add an asset to a model and compute its resting pose on a flat surface."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import mujoco
import numpy as np

from betterbench.geometry import Pose, normalize, vector_of
from betterbench.sim.assets import Asset, CollisionPart
from betterbench.sim.robots.physics import PHYSICS

VISUAL_GROUP, COLLISION_GROUP = 2, 3

ROLLING_DAMPING = 3e-4
"""Angular damping of a free object [N m s/rad], which replaces rolling friction.

Without any damping, a pushed orange rocks for a minute. The rolling resistance of fruit on wood is a torque of about
2 % of weight times radius. For an orange at 4 rad/s, this damping gives the same torque. MuJoCo uses the same number as
linear damping [N s/m], which reduces the speed by less than 1 % per second.
"""

_TYPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "hull": mujoco.mjtGeom.mjGEOM_MESH,
}


@dataclass(frozen=True, slots=True)
class DrawerRail:
    """Rail of a drawer along its x axis: distance between the stops [m], friction [N] and damping [N s/m]."""

    travel_m: float
    friction_n: float
    damping: float


def rail_of(asset: Asset) -> DrawerRail:
    """Return the rail of a drawer, given the parameters of its asset."""
    p = asset.parameters
    return DrawerRail(float(p["travel_m"]), float(p["friction_n"]), float(p["damping_n_s_m"]))


def add_asset(
    spec: mujoco.MjSpec,
    name: str,
    asset: Asset,
    *,
    pose: Pose | None = None,
    slide: DrawerRail | None = None,
    visuals: bool = True,
) -> mujoco.MjsBody:
    """Add an asset to a model and return the new body.

    The names of its meshes, materials and geoms start with the name of the body.

    ``pose`` is the fixed pose ``T_world_object``, or None for an object that moves freely. ``slide`` is the rail along
    which an object slides, starting at ``pose``. If ``visuals`` is False, the object is invisible, but its physics is
    the same.
    """
    body = spec.worldbody.add_body(name=name)
    if pose is None:
        body.add_joint(name=f"{name}_joint", type=mujoco.mjtJoint.mjJNT_FREE, damping=ROLLING_DAMPING)
    else:
        body.pos, body.quat = pose.position, pose.quaternion
        if slide is not None:
            body.add_joint(
                name=f"{name}_joint",
                type=mujoco.mjtJoint.mjJNT_SLIDE,
                axis=[1.0, 0.0, 0.0],
                limited=True,
                range=[0.0, slide.travel_m],
                frictionloss=slide.friction_n,
                damping=slide.damping,
            )
    body.mass = asset.mass_kg
    body.ipos = asset.center_of_mass
    body.fullinertia = asset.inertia
    body.explicitinertial = True
    if visuals:
        _add_visuals(spec, body, name, asset)
    for i, part in enumerate(asset.collision):
        _add_collision(spec, body, f"{name}_collision{i}", part)
    return body


def _add_visuals(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, asset: Asset) -> None:
    for part in asset.visual:
        full = f"{name}_{part.name}"
        material = spec.add_material(
            name=full, rgba=part.rgba, specular=part.specular, shininess=part.shininess, reflectance=0.0
        )
        mesh = spec.add_mesh(
            name=full,
            uservert=np.asarray(part.vertices, dtype=np.float64).ravel(),
            userface=np.asarray(part.faces, dtype=np.int32).ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            smoothnormal=part.smooth,
        )
        if part.texture is not None:
            mesh.usertexcoord = np.asarray(part.texture.uv, dtype=np.float64).ravel()
            if part.texture.corners is not None:
                mesh.userfacetexcoord = part.texture.corners.ravel()
            height, width, _ = part.texture.pixels.shape
            texture = spec.add_texture(
                name=full, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=3
            )
            # MuJoCo's first row of data is at v = 0, the bottom, whereas the image of an asset starts at the top.
            texture.data = np.ascontiguousarray(part.texture.pixels[::-1]).tobytes()
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture.name
        body.add_geom(
            name=full,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=full,
            material=full,
            contype=0,
            conaffinity=0,
            mass=0.0,
            group=VISUAL_GROUP,
        )


def _add_collision(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, part: CollisionPart) -> None:
    geom = body.add_geom(
        name=name,
        type=_TYPES[part.shape],
        size=part.size,
        pos=part.position,
        quat=part.quaternion,
        friction=part.friction,
        condim=PHYSICS.condim,
        mass=0.0,
        group=COLLISION_GROUP,
    )
    if part.shape == "hull":
        if part.vertices is None:
            msg = f"collision hull {name} has no vertices"
            raise ValueError(msg)
        spec.add_mesh(name=name, uservert=np.asarray(part.vertices, dtype=np.float64).ravel())
        geom.meshname = name


@functools.lru_cache(maxsize=512)
def rest_pose(asset: Asset) -> Pose:
    """Return the pose ``T_surface_object`` of an asset at rest on a flat surface (z = 0 in the surface frame).

    The asset settles alone, starting from its nominal pose. It sinks in by less than a millimeter and tilts by less
    than a tenth of a degree. The result depends only on the asset, not on neighboring objects.
    """
    spec = mujoco.MjSpec()
    PHYSICS.set_scene(spec)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[1, 1, 0.02], pos=[0, 0, -0.02])
    add_asset(spec, "asset", asset, visuals=False)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=1000)
    return Pose(vector_of(data.qpos[:3]), normalize(data.qpos[3:7]))
