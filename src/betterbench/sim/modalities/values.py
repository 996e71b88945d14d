"""Column values of a modality file, computed from the images, poses and boxes of a state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from betterbench.errors import RecordError
from betterbench.records.modalities.labels import semantics_of_instances
from betterbench.sim.modalities.flow import optical_flow
from betterbench.sim.modalities.poses import in_frame, points_of, products
from betterbench.sim.scenes.sights import ModelFacts

_STANDING = np.array([1.0, 0.0, 0.0, 0.0])


class ViewValues:
    """Converter from the rendered views of one camera to the column values of its modality file."""

    def __init__(
        self, facts: ModelFacts, modalities: Sequence[str], categories: Sequence[str], focal_px: float
    ) -> None:
        self._facts, self._modalities, self._focal_px = facts, frozenset(modalities), focal_px
        semantics = np.array(semantics_of_instances(categories), np.uint16)
        self._instances = np.concatenate([[0], facts.instances]).astype(np.uint16)
        if int(self._instances.max()) >= len(semantics):
            raise RecordError(
                "stored scene: its objects differ from those of the record. Run the trial again to store its scene."
            )
        self._semantics = semantics[self._instances]

    def of(self, sight: np.ndarray, time_s: float, following: np.ndarray | None) -> dict[str, np.ndarray]:
        """Return the values of all columns for one row, except the row number."""
        camera, wanted = sight["camera"], self._modalities
        values: dict[str, np.ndarray] = {
            "time": np.array(time_s),
            "camera_position": camera[:3],
            "camera_quaternion": camera[3:],
        }
        values |= {name: sight[name] for name in ("rgb", "depth") if name in wanted}
        if "instances" in wanted:
            values["instances"] = self._instances.take(sight["bodies"], mode="clip")
        if "semantics" in wanted:
            values["semantics"] = self._semantics.take(sight["bodies"], mode="clip")
        if "boxes" in wanted:
            values |= self._boxes(sight)
        if "flow" in wanted:
            values["flow"] = optical_flow(sight, following, focal_px=self._focal_px)
        return values

    def _boxes(self, sight: np.ndarray) -> dict[str, np.ndarray]:
        poses = sight["poses"][self._facts.object_bodies]
        # q and -q describe the same rotation. ``products`` returns the quaternion with w >= 0.
        turned = products(poses[:, 3:], _STANDING)
        boxes = np.concatenate([points_of(poses, self._facts.boxes[:, 0]), turned], axis=1)
        seen = in_frame(boxes, sight["camera"])
        visible, full = sight["visible_pixels"], sight["full_pixels"]
        return {
            "visible_box": sight["visible_box"],
            "full_box": sight["full_box"],
            "visible_pixels": visible,
            "full_pixels": full,
            "visible_fraction": np.divide(visible, full, out=np.full(len(full), np.nan), where=full > 0),
            "box_center_world": boxes[:, :3],
            "box_quaternion_world": boxes[:, 3:],
            "box_center_camera": seen[:, :3],
            "box_quaternion_camera": seen[:, 3:],
        }
