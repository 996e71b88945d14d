"""Color pictures of masks and depth, and boxes drawn over images."""

from __future__ import annotations

import colorsys
import io
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from betterbench.records.modalities.labels import FIRST_OBJECT

_GOLDEN = 0.6180339887498949
"""Fractional part of the golden ratio. Its multiples modulo 1 are spread evenly over the hue circle."""

LEAST_SEEN = 0.02
"""Smallest visible fraction of an object for which its box is drawn."""


def object_colors(count: int) -> list[tuple[int, int, int]]:
    """Return clearly different colors (red, green, blue) for the objects of a scene."""
    hues = [colorsys.hsv_to_rgb((i * _GOLDEN) % 1.0, 0.75, 1.0 if i % 2 else 0.82) for i in range(count)]
    return [(round(255 * r), round(255 * g), round(255 * b)) for r, g, b in hues]


def own_colors(rgb: np.ndarray, instances: np.ndarray, count: int) -> list[tuple[int, int, int]]:
    """Return a color for each object. It resembles the object's own color, so that a red mug is shown in red.

    Objects with similar colors get different brightness. Objects that are not in the image get the colors of
    :func:`object_colors`.

    Args:
        rgb: Image (height, width, 3) uint8.
        instances: Instance id of each pixel (height, width).
        count: Number of objects.
    """
    colors = object_colors(count)
    taken: list[tuple[int, int, int]] = []
    for i in range(count):
        pixels = rgb[instances == FIRST_OBJECT + i]
        if len(pixels):
            hue, saturation, _ = colorsys.rgb_to_hsv(*(np.median(pixels, axis=0) / 255.0))
            gray = saturation < _GRAY
            for value in (0.95, 0.7, 0.5, 0.82, 0.6):
                shade = colorsys.hsv_to_rgb(hue, 0.0 if gray else 0.75, value)
                colors[i] = (round(255 * shade[0]), round(255 * shade[1]), round(255 * shade[2]))
                if all(max(abs(a - b) for a, b in zip(colors[i], other, strict=True)) >= _APART for other in taken):
                    break
        taken.append(colors[i])
    return colors


_GRAY = 0.2
"""Saturation below which an object is considered gray, i.e. without a clear hue."""
_APART = 24
"""Minimum difference between the colors of two objects, in at least one of red, green and blue."""


def mask_png(instances: np.ndarray, colors: Sequence[tuple[int, int, int]], *, alpha: int = 96) -> bytes:
    """Return a mask (height, width) as a PNG file, with objects in their colors and all other pixels transparent."""
    numbers = np.where(instances >= FIRST_OBJECT, instances - FIRST_OBJECT + 1, 0)
    image = Image.fromarray(np.minimum(numbers, 255).astype(np.uint8), "P")
    image.putpalette([0, 0, 0, *(part for color in colors[:255] for part in color)])
    image.info["transparency"] = bytes([0, *[alpha] * min(len(colors), 255)])
    buffer = io.BytesIO()
    image.save(buffer, "PNG", transparency=image.info["transparency"])
    return buffer.getvalue()


def mask_image(instances: np.ndarray, colors: Sequence[tuple[int, int, int]]) -> np.ndarray:
    """Return a mask (height, width) as a color image (height, width, 3) uint8. Everything except objects is gray."""
    stage = [(24 * i + 30,) * 3 for i in range(FIRST_OBJECT)]
    table = np.array([*stage, *colors], np.uint8)
    return np.asarray(table[np.minimum(instances, len(table) - 1)])


def depth_image(depth: np.ndarray) -> np.ndarray:
    """Return depths (height, width) [m] as a gray image (height, width, 3) uint8, in which near pixels are bright."""
    finite = np.isfinite(depth)
    near, far = (float(depth[finite].min()), float(depth[finite].max())) if finite.any() else (0.0, 1.0)
    shade = np.where(finite, 1.0 - (np.where(finite, depth, far) - near) / max(far - near, 1e-6), 0.0)
    return np.repeat((255 * shade**0.7).astype(np.uint8)[..., None], 3, axis=2)


def with_boxes(
    rgb: np.ndarray, boxes: np.ndarray, fractions: np.ndarray, names: Sequence[str], *, scale: int = 2
) -> Image.Image:
    """Return an enlarged image that shows each object's name, its visible fraction, and a box around its visible part.

    ``boxes`` has the shape (n, 4).
    """
    image = Image.fromarray(np.ascontiguousarray(rgb))
    image = image.resize((scale * image.width, scale * image.height), Image.Resampling.BICUBIC)
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(11)
    for i, color in enumerate(object_colors(len(names))):
        if not np.nan_to_num(fractions[i]) >= LEAST_SEEN:
            continue
        left, top, right, bottom = (scale * int(edge) for edge in boxes[i])
        pen.rectangle((left, top, right - 1, bottom - 1), outline=color, width=2)
        said = names[i] if fractions[i] > 0.995 else f"{names[i]} {100 * fractions[i]:.0f} %"
        wide = pen.textlength(said, font=font)
        x, y = min(left, image.width - wide - 4), top - 13 if top >= 13 else top
        pen.rectangle((x, y, x + wide + 4, y + 13), fill=(20, 22, 25))
        pen.text((x + 2, y), said, fill=(255, 255, 255), font=font)
    return image
