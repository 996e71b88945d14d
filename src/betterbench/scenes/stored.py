"""Scenes on disk: the compiled model as MuJoCo writes it, and images of recorded states of it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from betterbench.errors import RecordError
from betterbench.scenes.cameras import CameraMatrices, ViewPlacement, camera_matrices
from betterbench.scenes.rendering import Images, Renderer
from betterbench.scenes.stage import Quality
from betterbench.state import NO_JITTER, ViewJitter

MODEL_FILE, INDEX_FILE = "model.mjb", "scene.json"


def scene_files(model: mujoco.MjModel, content_hash: str) -> dict[str, bytes]:
    """Return the files of a compiled scene: the model in MuJoCo's binary form, and an index with MuJoCo's version."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    index = {"mujoco": mujoco.__version__, "hash": content_hash, "bodies": int(model.nbody), "geoms": int(model.ngeom)}
    return {MODEL_FILE: buffer.tobytes(), INDEX_FILE: json.dumps(index, sort_keys=True).encode()}


def load_model(files: Mapping[str, bytes]) -> mujoco.MjModel:
    """Return the model of a stored scene, from what :func:`scene_files` returned.

    Raises RecordError if a file is missing or malformed, or another version of MuJoCo wrote it.
    """
    try:
        index = json.loads(files[INDEX_FILE])
        binary = files[MODEL_FILE]
        wrote = index["mujoco"]
    except (KeyError, TypeError, ValueError) as error:
        raise RecordError(
            f"stored scene: {error!r} is missing or malformed. Run the trial again to store it."
        ) from error
    if wrote != mujoco.__version__:
        raise RecordError(
            f"stored scene: MuJoCo {wrote} wrote it, {mujoco.__version__} is installed. "
            f"Install mujoco=={wrote} to look at it."
        )
    try:
        return mujoco.MjModel.from_binary_path("scene.mjb", {"scene.mjb": binary})
    except ValueError as error:
        raise RecordError(f"stored scene: MuJoCo cannot read it ({error}). Run the trial again to store it.") from error


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """One view of a scene with what it shows of some groups of bodies.

    Attributes:
        rgb: (height, width, 3) uint8 colors.
        groups: (height, width) int16 number of the group that each pixel shows, -1 for none.
        alone: Number of pixels that each group has with everything else taken away.
        camera: The camera.
    """

    rgb: np.ndarray
    groups: np.ndarray
    alone: tuple[int, ...]
    camera: CameraMatrices


class StoredView:
    """Draws recorded states of one stored scene."""

    def __init__(self, model: mujoco.MjModel, quality: Quality, *, width: int, height: int) -> None:
        """Prepare a renderer for a model; sizes in pixels."""
        self._model = model
        self._data = mujoco.MjData(model)
        self._jitter, self._placement = NO_JITTER, ViewPlacement(model, NO_JITTER)
        self._renderer = Renderer(model, width=width, height=height, quality=quality)

    def draw(
        self, qpos: np.ndarray, camera: str, *, jitter: ViewJitter, depth: bool = False, masks: bool = False
    ) -> Images:
        """Return the view of one recorded state, (nq,), with the record's jitter of cameras and light.

        Raises RecordError if the record belongs to another model.
        """
        if qpos.shape != (self._model.nq,):
            raise RecordError(
                f"record: {qpos.shape[0]} positions do not fit a scene of {self._model.nq}; the scene is another one."
            )
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        if jitter != self._jitter:
            self._jitter, self._placement = jitter, ViewPlacement(self._model, jitter)
        self._placement.apply(self._data)
        return self._renderer.render(self._data, camera, depth=depth, masks=masks)

    def see(self, qpos: np.ndarray, camera: str, groups: Sequence[Sequence[str]], *, jitter: ViewJitter) -> Sight:
        """Return the view of one recorded state with what it shows of each group of bodies, by their names.

        Raises RecordError if the record belongs to another model, or the model lacks a body.
        """
        numbers = [[self._body(name) for name in group] for group in groups]
        images = self.draw(qpos, camera, jitter=jitter, masks=True)
        if images.rgb is None or images.masks is None:
            raise AssertionError("colors and masks were asked for")
        group_of = np.full(self._model.nbody + 1, -1, np.int16)  # the last entry is that of the sky, whose number is -1
        for number, bodies in enumerate(numbers):
            group_of[bodies] = number
        groups_seen = group_of[images.masks]
        alone = tuple(self._alone(bodies, camera) if bodies else 0 for bodies in numbers)
        size = {"width": self._renderer.width, "height": self._renderer.height}
        return Sight(images.rgb, groups_seen, alone, camera_matrices(self._model, self._data, camera, **size))

    def _body(self, name: str) -> int:
        number = int(mujoco.mj_name2id(self._model, int(mujoco.mjtObj.mjOBJ_BODY), name))
        if number < 0:
            raise RecordError(f"stored scene: it has no body {name!r}; record and scene are of different trials.")
        return number

    def _alone(self, bodies: Sequence[int], camera: str) -> int:
        """Return the number of pixels of some bodies in the state drawn last, with everything else invisible."""
        model, others = self._model, ~np.isin(self._model.geom_bodyid, bodies)
        kept = model.geom_rgba[others].copy()
        try:
            model.geom_rgba[others] = (0.0, 0.0, 0.0, 0.0)
            shown = self._renderer.render(self._data, camera, rgb=False, masks=True).masks
        finally:
            model.geom_rgba[others] = kept
        if shown is None:
            raise AssertionError("masks were asked for")
        return int(np.isin(shown, bodies).sum())

    def project(self, points: np.ndarray, camera: str) -> np.ndarray:
        """Return the pixels (n, 2) of world points (n, 3) [m] in the view drawn last; NaN behind the camera."""
        size = {"width": self._renderer.width, "height": self._renderer.height}
        return camera_matrices(self._model, self._data, camera, **size).project(points)[0]

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()
