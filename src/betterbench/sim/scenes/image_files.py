"""Encoding of rendered images as files."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image


def jpeg_bytes(image: np.ndarray | Image.Image, *, quality: int, whole_colors: bool = False) -> bytes:
    """Encode an image, or an array (height, width, 3) uint8, as JPEG. ``whole_colors`` turns off chroma subsampling."""
    drawn = image if isinstance(image, Image.Image) else Image.fromarray(np.ascontiguousarray(image))
    buffer = io.BytesIO()
    drawn.save(buffer, "JPEG", quality=quality, subsampling=0 if whole_colors else -1)
    return buffer.getvalue()
