"""Observations: the input of a policy, with explicit conventions."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from betterbench.errors import UnknownNameError


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """Name of a camera in the scene and size of its images [pixels]."""

    name: str
    width: int = 256
    height: int = 256


@dataclass(frozen=True, slots=True)
class ObservationSpec:
    """Observation preset: its cameras, and whether observations include depth images and instance masks.

    Attributes:
        depth: Whether to include depth images [m].
        masks: Whether to include instance masks. Depth and masks are privileged, so policies get them only on request.
    """

    name: str
    cameras: tuple[CameraSpec, ...]
    depth: bool = False
    masks: bool = False

    def only(self, cameras: Collection[str] | None) -> ObservationSpec:
        """Return the preset with only the given cameras. If ``cameras`` is None, return it unchanged.

        Raises UnknownNameError if the preset does not have one of the cameras.
        """
        if cameras is None:
            return self
        known = {camera.name: camera for camera in self.cameras}
        for name in cameras:
            if name not in known:
                raise UnknownNameError(f"camera in the observation preset {self.name}", name, known)
        return replace(self, cameras=tuple(camera for camera in self.cameras if camera.name in cameras))

    def to_json(self) -> dict[str, Any]:
        """Return the preset in JSON form."""
        return asdict(self)


_PRESETS = {
    "default": ObservationSpec("default", (CameraSpec("front"), CameraSpec("wrist"))),
    "state_only": ObservationSpec("state_only", ()),
    "official": ObservationSpec(
        "official",
        (
            CameraSpec("front_official", 448, 448),
            CameraSpec("left_shoulder", 448, 448),
            CameraSpec("right_shoulder", 448, 448),
        ),
    ),
    "calvin": ObservationSpec("calvin", (CameraSpec("front", 200, 200), CameraSpec("wrist", 84, 84))),
    "calvin_depth": ObservationSpec(
        "calvin_depth", (CameraSpec("front", 200, 200), CameraSpec("wrist", 84, 84)), depth=True
    ),
    "droid": ObservationSpec("droid", (CameraSpec("left_shoulder", 320, 180), CameraSpec("wrist", 320, 180))),
}


def observation_spec(name: str) -> ObservationSpec:
    """Return the observation preset with the given name. Raises UnknownNameError if there is none.

    - "default": front and wrist views, 256 x 256.
    - "official": the three fixed views of the paper's release, 448 x 448.
    - "droid": side and wrist views, 320 x 180, for policies trained on DROID.
    - "calvin": front view, 200 x 200, and wrist view, 84 x 84, as in CALVIN.
    - "calvin_depth": the views of "calvin" with depth images.
    - "state_only": only proprioception and instruction.
    """
    try:
        return _PRESETS[name]
    except KeyError:
        raise UnknownNameError("observation preset", name, _PRESETS) from None


@dataclass(frozen=True, slots=True)
class Observation:
    """Input of a policy at one control step: instruction, images and proprioception.

    Attributes:
        instruction: Task instruction.
        step: Number of control steps since reset.
        images: Upright RGB image of each camera, (height, width, 3) uint8.
        joint_positions: Arm joint angles (n,) [rad].
        joint_velocities: Arm joint velocities (n,) [rad/s].
        ee_position: Tool center point in the robot base frame (3,) [m].
        ee_quaternion: Tool rotation in the robot base frame (4,), as (w, x, y, z) with w >= 0.
        gripper_width: Distance between the finger pads [m].
        depth: Distances along the optical axis for each camera, (height, width) float32 [m]. Empty unless requested.
        masks: Instance ids for each camera, (height, width) int32. Empty unless requested.
        native: State in the conventions of another world ("ee_position", ...). Empty in betterbench's own scenes.
    """

    instruction: str
    step: int
    images: Mapping[str, np.ndarray]
    joint_positions: np.ndarray
    joint_velocities: np.ndarray
    ee_position: np.ndarray
    ee_quaternion: np.ndarray
    gripper_width: float
    depth: Mapping[str, np.ndarray]
    masks: Mapping[str, np.ndarray]
    native: Mapping[str, np.ndarray] = field(default_factory=dict)
