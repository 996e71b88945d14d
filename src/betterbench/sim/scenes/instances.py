"""Instance ids of the bodies in a scene model, and bounding boxes of its objects."""

from __future__ import annotations

import re

import mujoco
import numpy as np

from betterbench.records.modalities.labels import FIRST_OBJECT, STAGE
from betterbench.sim.robots import RobotSpec, robot, robot_names

ROBOT_PREFIX = "robot/"
"""Prefix of the names of all robot parts in a scene model."""

_OBJECT = re.compile(r"object(\d+)_")
_VISIBLE_GROUPS = 3
_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)


def object_bodies(model: mujoco.MjModel) -> np.ndarray:
    """Return the body ids of the objects in a scene model (n,), in scene order."""
    found = {}
    for body in range(model.nbody):
        match = _OBJECT.match(model.body(body).name)
        if match:
            found[int(match[1])] = body
    return np.array([found[i] for i in sorted(found)], dtype=np.int64)


def robot_in(model: mujoco.MjModel) -> RobotSpec | None:
    """Return the robot in a scene model, recognized by its gripper, or None if the model has no robot."""
    bodies = {model.body(body).name.removeprefix(ROBOT_PREFIX) for body in range(model.nbody)}
    for name in robot_names():
        known = robot(name)
        if bodies.issuperset((known.hand_body, *known.finger_bodies)):
            return known
    return None


def instances_of_bodies(model: mujoco.MjModel) -> np.ndarray:
    """Return the instance id of each body as a (nbody,) uint16 array. All links of the arm are one instance."""
    description = robot_in(model)
    instances = np.full(model.nbody, 1 + STAGE.index("other"), dtype=np.uint16)
    for body in range(model.nbody):
        name = "floor" if body == 0 else model.body(body).name
        if name.startswith(ROBOT_PREFIX) and description is not None:
            name = description.contact_name(name.removeprefix(ROBOT_PREFIX)) or "arm"
        if name in STAGE:
            instances[body] = 1 + STAGE.index(name)
    bodies = object_bodies(model)
    instances[bodies] = FIRST_OBJECT + np.arange(len(bodies))
    return instances


def visible_boxes(model: mujoco.MjModel, bodies: np.ndarray) -> np.ndarray:
    """Return the bounding boxes of the visible shapes of bodies, each in its body frame [m].

    The result is an (n, 2, 3) float64 array with the center and the half extents of each box. Boxes are tight around
    meshes and boxes. Round shapes are represented by the bounding boxes of their geoms.
    """
    boxes = np.zeros((len(bodies), 2, 3))
    for i, body in enumerate(bodies):
        points = [
            _points(model, int(geom))
            for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_group < _VISIBLE_GROUPS))
        ]
        if points:
            corners = np.concatenate(points)
            low, high = corners.min(axis=0), corners.max(axis=0)
            boxes[i] = 0.5 * (low + high), 0.5 * (high - low)
    return boxes


def _points(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return points (n, 3) such that their bounding box contains the geom, in the frame of the geom's body [m]."""
    if int(model.geom_type[geom]) == _MESH:
        mesh = int(model.geom_dataid[geom])
        start = int(model.mesh_vertadr[mesh])
        local = model.mesh_vert[start : start + int(model.mesh_vertnum[mesh])].astype(np.float64)
    else:
        center, half = model.geom_aabb[geom].reshape(2, 3)
        signs = np.stack(np.meshgrid((-1, 1), (-1, 1), (-1, 1), indexing="ij"), axis=-1).reshape(-1, 3)
        local = center + signs * half
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    return np.asarray(local @ rotation.reshape(3, 3).T + model.geom_pos[geom])
