"""Color word of an object, i.e. the name of the color that covers most of its visible surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from betterbench.sim.assets.asset import CollisionPart, VisualPart
from betterbench.sim.assets.authoring.paint import PALETTE


def color_word(parts: Sequence[VisualPart | CollisionPart]) -> str:
    """Return the color word, such as "red", that covers the largest part of the visible surface.

    Each part of the surface is assigned the palette word with the nearest color in CIELAB.
    """
    words = list(PALETTE)
    palette = _lab(np.array([PALETTE[word] for word in words]))
    votes = np.zeros(len(words))
    for part in parts:
        if isinstance(part, VisualPart) and len(part.faces):
            a, b, c = (part.vertices[part.faces[:, k]].astype(np.float64) for k in range(3))
            area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
            distance = np.linalg.norm(_lab(_face_colors(part))[:, None] - palette[None], axis=2)
            votes += np.bincount(distance.argmin(axis=1), weights=area, minlength=len(words))
    return words[int(votes.argmax())]


def _face_colors(part: VisualPart) -> np.ndarray:
    """Return the color at the center of each triangle as an (m, 3) array in [0, 1]."""
    base = np.tile(np.asarray(part.rgba[:3], dtype=np.float64), (len(part.faces), 1))
    texture = part.texture
    if texture is None:
        return base
    corners = part.faces if texture.corners is None else texture.corners
    uv = np.clip(texture.uv[corners].astype(np.float64).mean(axis=1), 0.0, 1.0)
    height, width = texture.pixels.shape[:2]
    column = np.minimum((uv[:, 0] * width).astype(int), width - 1)
    row = np.minimum(((1.0 - uv[:, 1]) * height).astype(int), height - 1)
    return np.asarray(base * texture.pixels[row, column] / 255.0)


def _lab(rgb: np.ndarray) -> np.ndarray:
    """Convert sRGB colors (k, 3) in [0, 1] to CIELAB coordinates (k, 3) (IEC 61966-2-1, white point D65)."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = linear @ to_xyz.T / np.array([0.9505, 1.0, 1.089])
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.stack([116.0 * f[:, 1] - 16.0, 500.0 * (f[:, 0] - f[:, 1]), 200.0 * (f[:, 1] - f[:, 2])], axis=1)
