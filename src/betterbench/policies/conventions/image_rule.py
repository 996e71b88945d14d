"""Image inputs of a policy, computed from camera images by rotation, mirroring, cropping and resizing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.json_form import NO_TRUTH, strict_form

Fit = Literal["pad", "crop", "stretch"]
"""Method for resizing an image to a different aspect ratio: "pad" adds black bars, "crop" removes margins, and
"stretch" distorts the image.
"""

QuarterTurn = Annotated[Literal[0, 90, 180, 270], NO_TRUTH]
"""Rotation in degrees, counter-clockwise."""

EVERY_CAMERA = "*"
"""Camera name that selects all cameras of the observation. The key of the image input must then contain ``{camera}``.
"""

LARGEST_SIDE_PX = 4096


@strict_form
@dataclass(frozen=True, slots=True)
class ImageRule:
    """Image input of a policy, computed from the image of a camera.

    The image is first rotated, then mirrored, then cropped, and finally resized.

    Attributes:
        key: Path of the image in the request.
        camera: Name of the camera, or ``*`` for all cameras.
        width: Required width [pixel]. With None, the image is not resized.
        height: Required height [pixel]. With None, the image is not resized.
        fit: Method for resizing an image whose aspect ratio differs from the required aspect ratio.
        keep: Fraction of the image area that a center crop keeps before the image is resized. Policies that were
            trained with random crops are evaluated with 0.9 (OpenVLA) or 0.95.
        turn: Counter-clockwise rotation [deg]. The images of betterbench are upright.
        mirror: Whether the image is flipped horizontally.
    """

    key: tuple[str, ...]
    camera: str
    width: int | None = None
    height: int | None = None
    fit: Fit = "pad"
    keep: float = 1.0
    turn: QuarterTurn = 0
    mirror: bool = False

    def __post_init__(self) -> None:
        """Check the size, the crop and the key."""
        where = f"image {'/'.join(self.key)}"
        if (self.width is None) != (self.height is None):
            raise InvalidInputError(where, "only one of width and height is set", "Set both or neither")
        for side in (self.width, self.height):
            if side is not None and not 1 <= side <= LARGEST_SIDE_PX:
                raise InvalidInputError(
                    where, f"{side} pixels are out of range", f"Use a number from 1 to {LARGEST_SIDE_PX}"
                )
        if not 0.0 < self.keep <= 1.0:
            raise InvalidInputError(
                where, f"keep = {self.keep:g} is out of range", "Use a number that is greater than 0 and at most 1"
            )
        if self.camera == EVERY_CAMERA and not any("{camera}" in part for part in self.key):
            raise InvalidInputError(where, "all cameras would have the same key", "Include {camera} in the key")

    def named(self, camera: str) -> tuple[str, ...]:
        """Return the path in the request under which the image of a camera is sent."""
        return tuple(part.replace("{camera}", camera) for part in self.key)

    def show(self, image: np.ndarray) -> np.ndarray:
        """Convert a camera image (height, width, 3) uint8 to the policy's input.

        The image is resized with Pillow's antialiased bilinear filter, as in openpi's client. If it already has the
        required size and is not cropped, it is not resampled.

        Returns:
            Contiguous array (self.height, self.width, 3) uint8.
        """
        turned = np.rot90(image, self.turn // 90)
        if self.mirror:
            turned = turned[:, ::-1]
        turned = np.ascontiguousarray(turned)
        height, width = turned.shape[:2]
        to_width, to_height = self.width or width, self.height or height
        if self.keep == 1.0 and (to_width, to_height) == (width, height):
            return turned
        share = math.sqrt(self.keep)
        from_width, from_height = share * width, share * height
        fitted_width, fitted_height = to_width, to_height
        if self.fit == "crop":
            scale = max(to_width / from_width, to_height / from_height)
            from_width, from_height = to_width / scale, to_height / scale
        elif self.fit == "pad":
            # The size is rounded down, as in openpi's client (openpi_client/image_tools.py).
            ratio = max(from_width / to_width, from_height / to_height)
            fitted_width = max(1, min(to_width, int(from_width / ratio)))
            fitted_height = max(1, min(to_height, int(from_height / ratio)))
        left, top = 0.5 * (width - from_width), 0.5 * (height - from_height)
        whole = (from_width, from_height) == (width, height)
        box = (
            max(0.0, left),
            max(0.0, top),
            min(float(width), left + from_width),
            min(float(height), top + from_height),
        )
        from PIL import Image  # noqa: PLC0415 - Pillow is needed only if images are resized

        resized = np.asarray(
            Image.fromarray(turned).resize(
                (fitted_width, fitted_height), Image.Resampling.BILINEAR, None if whole else box
            )
        )
        if resized.shape[:2] == (to_height, to_width):
            return np.array(resized)
        canvas = np.zeros((to_height, to_width, 3), np.uint8)
        top_bar, left_bar = (to_height - fitted_height) // 2, (to_width - fitted_width) // 2
        canvas[top_bar : top_bar + fitted_height, left_bar : left_bar + fitted_width] = resized
        return canvas
