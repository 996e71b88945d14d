"""Drawing of the measured markers on the image of the front camera, next to their positions in the simulated camera."""

from __future__ import annotations

import math

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from betterbench.real.sheet.camera_pose import CameraPose, MeasuredCamera
from betterbench.real.sheet.layout import MARKERS_MM, corners_mm

_FOUND, _TWIN, _AHEAD, _LEFT = (40, 220, 90), (255, 150, 20), (255, 70, 70), (90, 150, 255)
_AXIS_M = 0.1
"""Length of the axes of the base frame in the drawing [m]."""
_LEGEND = (
    (_FOUND, "found marker"),
    (_TWIN, "its place for the twin's camera"),
    (_AHEAD, "ahead of the arm"),
    (_LEFT, "to its left"),
)


def annotated(image: np.ndarray, camera: MeasuredCamera, twin: CameraPose) -> Image.Image:
    """Draw the detected markers, their positions as seen by the simulated camera, and the axes of the arm's base frame.

    Args:
        image: Image (height, width, 3) uint8 RGB from which the camera was measured.
        camera: Measured camera.
        twin: Pose of the front camera in the simulated twin of the scene.
    """
    height, width = image.shape[:2]
    pen_width = max(2, round(width / 320))
    font = ImageFont.load_default(max(11, width / 45))
    drawn = Image.fromarray(np.ascontiguousarray(image))
    pen = ImageDraw.Draw(drawn)
    for marker in range(len(MARKERS_MM)):
        corners = np.column_stack([0.001 * corners_mm(marker), np.zeros(4)])
        place = _seen(corners, twin, (height, width))
        if place is not None:
            pen.polygon([tuple(point) for point in place], outline=_TWIN, width=pen_width)
    for marker, corners in camera.corners_px.items():
        pen.polygon([tuple(point) for point in corners], outline=_FOUND, width=pen_width)
        pen.text(
            tuple(corners.mean(axis=0)), str(marker), fill=_FOUND, font=font, anchor="mm", stroke_width=2, stroke_fill=0
        )
    for axis, color in (((_AXIS_M, 0.0), _AHEAD), ((0.0, _AXIS_M), _LEFT)):
        line = _seen(np.array([[0.0, 0.0, 0.0], [*axis, 0.0]]), camera.pose, (height, width))
        if line is not None:
            pen.line([tuple(point) for point in line], fill=color, width=2 * pen_width)
    return _with_legend(drawn, font)


def _seen(points: np.ndarray, pose: CameraPose, shape: tuple[int, int]) -> np.ndarray | None:
    """Return the pixels (n, 2) at which a camera without distortion sees points (n, 3) of the base frame.

    Return None if a point is behind the camera.
    """
    rays = (points - pose.position_m) @ pose.axes
    if float(rays[:, 2].min()) < 0.01:
        return None
    height, width = shape
    focal = 0.5 * height / math.tan(0.5 * math.radians(pose.fovy_deg))
    return np.asarray(focal * rays[:, :2] / rays[:, 2:] + [0.5 * (width - 1), 0.5 * (height - 1)])


def _with_legend(drawn: Image.Image, font: ImageFont.ImageFont | ImageFont.FreeTypeFont) -> Image.Image:
    """Return the image with an additional line at the bottom that explains the colors."""
    line = round(1.6 * font.getbbox("Hg")[3])
    whole = Image.new("RGB", (drawn.width, drawn.height + line), (20, 20, 20))
    whole.paste(drawn, (0, 0))
    pen, x = ImageDraw.Draw(whole), 0.4 * line
    for color, name in _LEGEND:
        pen.text((x, drawn.height + 0.5 * line), name, fill=color, font=font, anchor="lm")
        x += pen.textlength(name, font=font) + line
    return whole
