"""Pictures of stripes, as PNG files."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image


def stripes(width: int, height: int, period: int) -> bytes:
    """A picture of vertical black and white stripes with a period in pixels."""
    row = np.where(np.arange(width) % period < period // 2, 255, 0).astype(np.uint8)
    return png(np.repeat(np.broadcast_to(row, (height, width))[..., None], 3, axis=2))


def png(array: np.ndarray) -> bytes:
    """An array (height, width, 3) uint8 as a file."""
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(array)).save(file, "PNG")
    return file.getvalue()
