"""View jitter: small offsets of a trial's cameras and key light from their nominal poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from betterbench.geometry import Vector
from betterbench.json_form import strict_form


@strict_form
@dataclass(frozen=True, slots=True)
class CameraOffset:
    """Offset of a camera, given in its nominal frame: x to the right of the image, y up, z toward the viewer.

    Attributes:
        shift_m: Shift of the camera [m].
        turn_rad: Rotation of the camera as an axis-angle vector [rad].
    """

    shift_m: Vector
    turn_rad: Vector


@strict_form
@dataclass(frozen=True, slots=True)
class ViewJitter:
    """Jitter of the cameras and the key light. The model, the state and the jitter together determine the images.

    Attributes:
        cameras: Offset of each camera. Cameras that are not listed have their nominal pose.
        key_light_turn_rad: Rotation of the key light's direction in the world frame, as an axis-angle vector [rad].
    """

    cameras: Mapping[str, CameraOffset] = field(default_factory=dict)
    key_light_turn_rad: Vector = (0.0, 0.0, 0.0)

    def to_json(self) -> dict[str, Any]:
        """Return the jitter in JSON form."""
        cameras = {
            name: {"shift_m": list(offset.shift_m), "turn_rad": list(offset.turn_rad)}
            for name, offset in self.cameras.items()
        }
        return {"cameras": cameras, "key_light_turn_rad": list(self.key_light_turn_rad)}


NO_JITTER = ViewJitter()
"""Jitter that leaves all cameras and lights in their nominal poses."""
