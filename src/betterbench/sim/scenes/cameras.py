"""Camera poses and projections. The cameras of a model are converted to pinhole cameras in OpenCV's conventions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.geometry import Pose, Quaternion, from_axis_angle, normalize, vector_of
from betterbench.interface.state import CameraOffset, ViewJitter
from betterbench.records.modalities.spec import MAX_SIDE_PX
from betterbench.sim.scenes.stage import KEY_LIGHT


@dataclass(frozen=True, slots=True, eq=False)
class CameraMatrices:
    """Pinhole camera in OpenCV's conventions: (3, 3) intrinsic matrix ``K`` [pixel], pose, and image size [pixel].

    In the camera frame, x points to the right of the image, y down and z forward along the optical axis. In pixel (u,
    v), u is the column from the left and v the row from the top, with integers at pixel centers. The image therefore
    spans u from -0.5 to width - 0.5.
    """

    K: np.ndarray
    T_world_camera: Pose
    width: int
    height: int

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project points (n, 3) [m] of the world frame into the image.

        Raises InvalidInputError if the points have another shape.

        Returns:
            The pixels (u, v) as an (n, 2) float64 array, which may lie outside the image, and the depths along the
            optical axis (n,) [m]. A point that is not in front of the camera has a depth of at most 0 and the pixel
            (nan, nan).
        """
        array = np.asarray(points, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != 3:
            raise InvalidInputError("points", f"the array has the shape {array.shape}", "Pass an array of shape (n, 3)")
        R_world_camera = _rotation_matrix(self.T_world_camera.quaternion)
        local = (array - np.asarray(self.T_world_camera.position)) @ R_world_camera
        depth = local[:, 2]
        pixels = np.full((len(array), 2), np.nan)
        seen = depth > 0.0
        scaled = local[seen] @ self.K.T
        pixels[seen] = scaled[:, :2] / scaled[:, 2:]
        return pixels, depth

    def unproject(self, depth: np.ndarray) -> np.ndarray:
        """Convert a depth image [m] to points in the world frame [m], as a (height, width, 3) float64 array.

        Pixels with infinite depth give points that are not finite. Raises InvalidInputError if the depth image does not
        have the camera's size.
        """
        if depth.shape != (self.height, self.width):
            raise InvalidInputError(
                "depth", f"has the shape {depth.shape}", f"Pass an array of shape {(self.height, self.width)}"
            )
        v, u = np.mgrid[0 : self.height, 0 : self.width].astype(np.float64)
        x, y = (u - self.K[0, 2]) / self.K[0, 0], (v - self.K[1, 2]) / self.K[1, 1]
        rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ _rotation_matrix(self.T_world_camera.quaternion).T
        seen = np.isfinite(depth)[..., None]
        origin = np.asarray(self.T_world_camera.position)
        return np.where(seen, rays * np.where(seen, depth[..., None], 1.0) + origin, np.inf)


class ViewPlacement:
    """Poses of a model's cameras and key light in a trial, i.e. the nominal poses with the trial's jitter applied."""

    def __init__(self, model: mujoco.MjModel, jitter: ViewJitter) -> None:
        """Store the poses after applying the jitter. Jitter of cameras that the model does not have is ignored."""
        self._model = model
        self._bodies = model.cam_bodyid
        # Camera poses in the frames of their bodies. The jitter is never added to the camera poses in ``data``, because
        # the engine does not update cameras on static bodies at every step.
        self._positions = np.zeros((model.ncam, 3, 1))
        self._axes = np.zeros((model.ncam, 3, 3))
        for number in range(model.ncam):
            axes = _rotation_matrix(model.cam_quat[number])
            offset = jitter.cameras.get(model.camera(number).name, _STILL)
            self._positions[number, :, 0] = model.cam_pos[number] + axes @ np.asarray(offset.shift_m)
            self._axes[number] = axes @ _rotation_matrix(from_axis_angle(offset.turn_rad))
        self._key = int(mujoco.mj_name2id(model, int(mujoco.mjtObj.mjOBJ_LIGHT), KEY_LIGHT))
        if self._key >= 0:
            turn = _rotation_matrix(from_axis_angle(jitter.key_light_turn_rad))
            self._key_direction = turn @ model.light_dir[self._key]

    def apply(self, data: mujoco.MjData) -> None:
        """Place the cameras and lights for the current poses of the bodies, which must be up to date.

        Live images and images of recorded states both use this method, so that they agree bit for bit.
        """
        mujoco.mj_camlight(self._model, data)
        frames = data.xmat.take(self._bodies, 0).reshape(-1, 3, 3)
        data.cam_xpos[:] = data.xpos.take(self._bodies, 0) + np.matmul(frames, self._positions)[:, :, 0]
        data.cam_xmat[:] = np.matmul(frames, self._axes).reshape(-1, 9)
        if self._key >= 0:
            data.light_xdir[self._key] = self._key_direction


_STILL = CameraOffset((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def camera_matrices(
    model: mujoco.MjModel, data: mujoco.MjData, camera: str, *, width: int = 256, height: int = 256
) -> CameraMatrices:
    """Return the intrinsics and the pose of a model's camera in a state with up-to-date positions.

    Raises UnknownNameError if the model does not have the camera, and InvalidInputError if the image size is out of
    range.
    """
    check_size(width, height)
    number = camera_number(model, camera)
    focal = focal_length_px(float(model.cam_fovy[number]), height)
    K = np.array([[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    # MuJoCo's camera looks along -z with y up, OpenCV's along z with y down. The two differ by half a turn about x.
    R_world_camera = data.cam_xmat[number].reshape(3, 3) * np.array([1.0, -1.0, -1.0])
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R_world_camera).ravel())
    return CameraMatrices(K, Pose(vector_of(data.cam_xpos[number]), normalize(quaternion.tolist())), width, height)


def camera_number(model: mujoco.MjModel, camera: str) -> int:
    """Return the index of a camera. Raises UnknownNameError if the model does not have the camera."""
    number = int(mujoco.mj_name2id(model, int(mujoco.mjtObj.mjOBJ_CAMERA), camera))
    if number < 0:
        raise UnknownNameError("camera", camera, (model.camera(other).name for other in range(model.ncam)))
    return number


def focal_length_px(fovy_deg: float, height: int) -> float:
    """Return the focal length [pixel] for an image height [pixel] and a vertical field of view [degree]."""
    return 0.5 * height / math.tan(0.5 * math.radians(fovy_deg))


def check_size(width: int, height: int) -> None:
    """Raise InvalidInputError unless the width and the height [pixel] are in range."""
    if not (1 <= width <= MAX_SIDE_PX and 1 <= height <= MAX_SIDE_PX):
        raise InvalidInputError(
            "image size", f"{width} x {height} pixels is out of range", f"Use 1 to {MAX_SIDE_PX} pixels per side"
        )


def _rotation_matrix(quaternion: Quaternion | Sequence[float]) -> np.ndarray:
    """Return the (3, 3) rotation matrix of a unit quaternion (w, x, y, z)."""
    matrix: np.ndarray[Any, np.dtype[np.float64]] = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quaternion, dtype=np.float64))
    return matrix.reshape(3, 3)
