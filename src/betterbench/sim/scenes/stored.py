"""Stored scenes, i.e. compiled models in MuJoCo's binary format, and images of recorded states."""

from __future__ import annotations

import json
from collections.abc import Mapping

import mujoco
import numpy as np

from betterbench.errors import RecordError, one_line
from betterbench.interface.state import NO_JITTER, ViewJitter
from betterbench.json_form import parse_json
from betterbench.sim.scenes.cameras import ViewPlacement, camera_matrices
from betterbench.sim.scenes.rendering import Images, Renderer
from betterbench.sim.scenes.stage import Quality

MODEL_FILE, INDEX_FILE = "model.mjb", "scene.json"


def scene_files(model: mujoco.MjModel, content_hash: str) -> dict[str, bytes]:
    """Return the files of a compiled scene: the model in MuJoCo's binary format, and an index with MuJoCo's version."""
    buffer = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    index = {"mujoco": mujoco.__version__, "hash": content_hash, "bodies": int(model.nbody), "geoms": int(model.ngeom)}
    return {MODEL_FILE: buffer.tobytes(), INDEX_FILE: json.dumps(index, sort_keys=True).encode()}


def load_model(files: Mapping[str, bytes]) -> mujoco.MjModel:
    """Return the model of a stored scene, given the files that :func:`scene_files` has returned.

    Raises RecordError if a file is missing or malformed, or was written by a different version of MuJoCo.
    """
    if INDEX_FILE in files and MODEL_FILE not in files:
        raise RecordError(
            "stored scene: it contains no MuJoCo model. Commands that simulate or render a record again serve "
            "betterbench's own scenes only. If the record is one of these, run the trial again to store its scene."
        )
    try:
        index = parse_json(files[INDEX_FILE])
        binary = files[MODEL_FILE]
        wrote = one_line(index["mujoco"], most=20)
    except (KeyError, TypeError, ValueError) as error:
        raise RecordError(
            f"stored scene: {one_line(repr(error))} is missing or malformed. Run the trial again to store it."
        ) from error
    if wrote != mujoco.__version__:
        raise RecordError(
            f"stored scene: it was written by MuJoCo {wrote}, but {mujoco.__version__} is installed. "
            "Install that version to open the scene."
        )
    try:
        return mujoco.MjModel.from_binary_path("scene.mjb", {"scene.mjb": binary})
    except ValueError as error:
        raise RecordError(
            f"stored scene: MuJoCo cannot read it ({one_line(error)}). Run the trial again to store it."
        ) from error


class StoredState:
    """Recorded state of a stored scene: the poses of its bodies, cameras and lights."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        self._jitter, self._placement = NO_JITTER, ViewPlacement(model, NO_JITTER)

    def take(self, qpos: np.ndarray, jitter: ViewJitter) -> None:
        """Load a recorded state (nq,). ``jitter`` is the jitter of the cameras and the light in the record.

        Raises RecordError if the record belongs to a different model.
        """
        if qpos.shape != (self.model.nq,):
            raise RecordError(f"record: expected {self.model.nq} joint positions for this scene, got {qpos.shape[0]}.")
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        if jitter != self._jitter:
            self._jitter, self._placement = jitter, ViewPlacement(self.model, jitter)
        self._placement.apply(self.data)


class StoredView:
    """Renderer of recorded states of one stored scene."""

    def __init__(self, model: mujoco.MjModel, quality: Quality, *, width: int, height: int) -> None:
        """Create a renderer for a model. ``width`` and ``height`` are in pixels."""
        self._state = StoredState(model)
        self._renderer = Renderer(model, width=width, height=height, quality=quality)

    def draw(
        self, qpos: np.ndarray, camera: str, *, jitter: ViewJitter, depth: bool = False, masks: bool = False
    ) -> Images:
        """Render a recorded state (nq,). ``jitter`` is the jitter of the cameras and the light in the record.

        Raises RecordError if the record belongs to a different model.
        """
        self._state.take(qpos, jitter)
        return self._renderer.render(self._state.data, camera, depth=depth, masks=masks)

    def project(self, points: np.ndarray, camera: str) -> np.ndarray:
        """Project points of the world frame (n, 3) [m] to pixels (n, 2) of the view that was rendered last.

        Points behind the camera become NaN.
        """
        size = {"width": self._renderer.width, "height": self._renderer.height}
        return camera_matrices(self._state.model, self._state.data, camera, **size).project(points)[0]

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()
