"""Culling: removal of geometry outside a camera's view before rendering.

MuJoCo passes every visible geom and the sky to OpenGL, which discards geometry that is outside the view or behind other
geometry. By then, a software renderer has already transformed the vertices and painted the pixels. For a wrist camera,
which has most of the robot behind it, a third of the rendering time is spent on geoms outside its view. A geom can be
removed if its bounding sphere lies completely outside one side of the view. The sky can be removed if the floor fills
the view. Neither changes any pixel.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

_NOTHING = int(mujoco.mjtGeom.mjGEOM_NONE)
_PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
_GEOM = int(mujoco.mjtObj.mjOBJ_GEOM)
_MARGIN_M = 0.002
_WORTH_FACES = 160
"""Minimum number of faces of a mesh that is tested for visibility. Smaller meshes cost less than the test."""

_Vector = tuple[float, float, float]


class Culling:
    """Visibility test for a perspective camera. The optical axis must go through the center of the image.

    ``scene`` must be the MuJoCo scene (``MjvScene``) that the renderer fills again for each image.
    """

    def __init__(self, model: mujoco.MjModel, scene: mujoco.MjvScene) -> None:
        """Find the meshes that have so many faces that testing their visibility saves time."""
        self._model, self._scene = model, scene
        self._geoms = list(scene.geoms)
        self._far_m = float(model.vis.map.zfar) * float(model.stat.extent)
        self._riding = (model.cam_bodyid != 0).tolist()
        meshes = np.flatnonzero(model.geom_type == _MESH)
        self._worthwhile = frozenset(meshes[model.mesh_facenum[model.geom_dataid[meshes]] >= _WORTH_FACES].tolist())
        self._angles: dict[tuple[float, float], tuple[float, float]] = {}
        self._learn()

    def cull(self, data: mujoco.MjData, camera: int, aspect: float, *, geoms: bool) -> bool:
        """Remove geoms outside a camera's view from the scene, and return whether the sky may be visible.

        Only meshes with many faces are tested, and only for cameras that are attached to a moving body, because a
        static camera sees the whole table. ``aspect`` is the width of the image divided by its height. If ``geoms`` is
        False, no geom is removed. This is necessary for images with shadows, because a geom outside the view may cast a
        shadow into the view.
        """
        if self._scene.ngeom != self._filled:
            self._learn()
        fovy_deg = float(self._model.cam_fovy[camera])
        angles = self._angles.get((fovy_deg, aspect))
        if angles is None:
            up = 0.5 * math.radians(fovy_deg)
            angles = self._angles[fovy_deg, aspect] = (math.atan(math.tan(up) * aspect), up)
        # The test uses plain Python numbers, because NumPy's code is evicted from the CPU caches between two images.
        # Multiplying two small arrays would then take longer than this whole test.
        axes = data.cam_xmat[camera].tolist()
        position = data.cam_xpos[camera].tolist()
        if geoms and self._riding[camera]:
            self._hide(data, axes, position, *angles)
        return not self._floor_fills(axes, position, *angles)

    def _hide(self, data: mujoco.MjData, axes: list[float], position: list[float], across: float, up: float) -> None:
        xx, yx, zx, xy, yy, zy, xz, yz, zz = axes
        cx, cy, cz = position
        cos_x, sin_x, cos_y, sin_y = math.cos(across), math.sin(across), math.cos(up), math.sin(up)
        centers = data.geom_xpos.take(self._numbers, 0).tolist()
        for (x, y, z), (geom, number, reach) in zip(centers, self._candidates, strict=True):
            x, y, z = x - cx, y - cy, z - cz  # noqa: PLW2901 - relative to the camera from here on
            behind = zx * x + zy * y + zz * z
            if (
                behind > reach
                or cos_x * abs(xx * x + xy * y + xz * z) + sin_x * behind > reach
                or cos_y * abs(yx * x + yy * y + yz * z) + sin_y * behind > reach
            ):
                if geom.objid != number:
                    # The number of geoms is the same as for the last image, but the geoms differ. The stored indices
                    # are therefore invalid.
                    self._learn()
                    self._hide(data, axes, position, across, up)
                    return
                geom.type = _NOTHING

    def _floor_fills(self, axes: list[float], position: list[float], across: float, up: float) -> bool:
        """Return whether the floor fills the view, i.e. whether the rays through all four corners hit the floor."""
        if self._floor is None:
            return False
        geom, number, (fx, fy, fz), (half_x, half_y) = self._floor
        if geom.objid != number:
            self._learn()
            return False
        xx, yx, zx, xy, yy, zy, xz, yz, zz = axes
        cx, cy, height = position[0] - fx, position[1] - fy, position[2] - fz
        right, top = math.tan(across), math.tan(up)
        for a in (-right, right):
            for b in (-top, top):
                fall = zz - a * xz - b * yz
                # The distance along the optical axis at which the ray reaches the floor, limited by the far plane.
                if fall <= 0.0 or height <= 0.0 or height >= self._far_m * fall:
                    return False
                t = height / fall
                if abs(cx + t * (a * xx + b * yx - zx)) > half_x or abs(cy + t * (a * xy + b * yy - zy)) > half_y:
                    return False
        return float(geom.rgba[3]) == 1.0

    def _learn(self) -> None:
        """Find the floor and the geoms that are worth testing in the MuJoCo scene, and store their indices."""
        self._filled = int(self._scene.ngeom)
        drawn = [g for g in self._geoms[: self._filled] if int(g.objtype) == _GEOM]
        self._candidates = [
            (geom, int(geom.objid), float(self._model.geom_rbound[geom.objid]) + _MARGIN_M)
            for geom in drawn
            if int(geom.objid) in self._worthwhile
        ]
        self._numbers = np.array([number for _, number, _ in self._candidates], int)
        self._floor: tuple[mujoco.MjvGeom, int, _Vector, tuple[float, float]] | None = None
        for geom in drawn:
            number = int(geom.objid)
            # Planes without a size are excluded because MuJoCo chooses the size in which it draws them. Planes on
            # other bodies than the world are excluded because they move.
            half_x, half_y, _ = self._model.geom_size[number].tolist()
            if (
                int(self._model.geom_type[number]) == _PLANE
                and min(half_x, half_y) > _MARGIN_M
                and int(self._model.geom_bodyid[number]) == 0
                and np.array_equal(self._model.geom_quat[number], (1.0, 0.0, 0.0, 0.0))
            ):
                x, y, z = self._model.geom_pos[number].tolist()
                self._floor = geom, number, (x, y, z), (half_x - _MARGIN_M, half_y - _MARGIN_M)
                break
