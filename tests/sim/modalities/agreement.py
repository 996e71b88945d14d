"""Laws between the modalities of one row of one view, and with rays that are cast by MuJoCo without any drawing."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from betterbench.geometry import Pose
from betterbench.records import Record, RunFolder
from betterbench.records.modalities.header import ViewHeader
from betterbench.sim.modalities.poses import matrices
from betterbench.sim.scenes import load_model
from betterbench.sim.scenes.cameras import CameraMatrices, ViewPlacement

DEPTH_M = 0.002
"""Depth and what it is compared with may be so far apart."""

Values = dict[str, Any]


def camera_of(header: ViewHeader, values: Values) -> CameraMatrices:
    focal, view = header.focal_px, header.view
    K = np.array([[focal, 0, (view.width - 1) / 2], [0, focal, (view.height - 1) / 2], [0, 0, 1]])
    pose = Pose(tuple(values["camera_position"].tolist()), tuple(values["camera_quaternion"].tolist()))
    return CameraMatrices(K, pose, view.width, view.height)


def boxes_fit_the_masks(header: ViewHeader, values: Values) -> int:
    """Asserts that boxes are tight and fractions those of pixels; how many objects are seen."""
    shown = 0
    for i, thing in enumerate(header.objects):
        mask = values["instances"] == thing.instance
        assert np.count_nonzero(mask) == values["visible_pixels"][i] <= values["full_pixels"][i]
        if not mask.any():
            assert values["visible_box"][i].tolist() == [-1] * 4
            continue
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        tight = [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
        assert values["visible_box"][i].tolist() == tight
        left, top, right, bottom = values["full_box"][i]
        assert left <= tight[0] < tight[2] <= right
        assert top <= tight[1] < tight[3] <= bottom
        fraction = values["visible_pixels"][i] / values["full_pixels"][i]
        assert values["visible_fraction"][i] == pytest.approx(fraction)
        shown += 1
    return shown


def centers_lie_in_the_boxes(header: ViewHeader, values: Values) -> None:
    """Asserts that the projected center of each object whose outline the image holds whole lies in its box."""
    view = header.view
    pixels, _ = camera_of(header, values).project(values["box_center_world"])
    for (u, v), (left, top, right, bottom), full in zip(pixels, values["full_box"], values["full_pixels"], strict=True):
        if full and left > 0 and top > 0 and right < view.width and bottom < view.height:
            assert left - 1 <= u <= right
            assert top - 1 <= v <= bottom


def pixels_off_the_objects(header: ViewHeader, values: Values) -> tuple[int, int]:
    """How many pixels of objects, moved to their depth, lie outside the object's box in space; and of how many."""
    points = camera_of(header, values).unproject(values["depth"])
    camera = np.concatenate([values["camera_position"], values["camera_quaternion"]])
    off = count = 0
    for i, thing in enumerate(header.objects):
        seen = points[values["instances"] == thing.instance]
        if not len(seen):
            continue
        count += len(seen)
        within = (seen - camera[:3]) @ matrices(camera[None])[0][:3, :3]
        outside = np.zeros(len(seen), dtype=bool)
        for frame, places in (("world", seen), ("camera", within)):
            pose = np.concatenate([values[f"box_center_{frame}"][i], values[f"box_quaternion_{frame}"][i]])
            inside = (places - pose[:3]) @ matrices(pose[None])[0][:3, :3]
            outside |= (np.abs(inside) > np.array(thing.half_size_m) + DEPTH_M).any(axis=1)
        off += int(outside.sum())
    return off, count


class Rays:
    """A second computation of masks and depth: rays through the meshes of the stored scene at recorded states."""

    def __init__(self, run: RunFolder, record: Record) -> None:
        self._record = record
        self._model = load_model(run.load_scene(record.metadata.scene_hash))
        self._data = mujoco.MjData(self._model)

    def agreeing(self, header: ViewHeader, values: Values, draw: np.random.Generator, *, pixels: int) -> int:
        """At how many of so many random pixels of a row the ray meets what the mask says, at its depth."""
        model, data, view = self._model, self._data, header.view
        data.qpos[:] = self._record.qpos[values["row"]]
        mujoco.mj_kinematics(model, data)
        ViewPlacement(model, self._record.metadata.view_jitter).apply(data)
        shown, hit = np.array([1, 1, 1, 0, 0, 0], np.uint8), np.zeros(1, np.int32)
        names = {number: name for name, number in header.stage.items()}
        names |= {thing.instance: f"object{i}_" for i, thing in enumerate(header.objects)}
        camera = camera_of(header, values)
        origin = np.array(camera.T_world_camera.position)
        rays = camera.unproject(np.ones((view.height, view.width))) - origin
        near = float(model.vis.map.znear * model.stat.extent)  # what is nearer to the camera is not drawn
        agreed = 0
        for _ in range(pixels):
            v, u = int(draw.integers(view.height)), int(draw.integers(view.width))
            length = float(np.linalg.norm(rays[v, u]))
            begin = origin + near * rays[v, u]
            depth = near + mujoco.mj_ray(model, data, begin, rays[v, u] / length, shown, 1, -1, hit) / length
            name = names.get(int(values["instances"][v, u]), "nothing")
            if hit[0] < 0:
                agreed += name == "nothing"
            elif abs(depth - values["depth"][v, u]) <= DEPTH_M:
                body = model.body(model.geom_bodyid[hit[0]]).name
                body = "floor" if body == "world" else body.removeprefix("robot/")
                agreed += body.startswith(name) or (name == "arm" and body.startswith("link"))
        return agreed
