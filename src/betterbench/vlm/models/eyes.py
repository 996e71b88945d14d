"""Image resolutions for the ablation with a "myopic" model in Table 3 of arXiv:2604.18000 ("the paper").

The paper's "single 224 x 224 picture" can be understood in three ways, which lose different information. In each of
them, the image is resized to a square without padding. Positions given as fractions of width and height therefore stay
the same:

======================  ========================================  ==================================================
eyes                    image                                     loss compared with ``native``
======================  ========================================  ==================================================
``native``              unchanged, with up to 12 tiles            nothing
``tile-1``              448 x 448 pixels, one tile                the tiles, and detail of images larger than a tile
``blur-224``            reduced to 224 x 224, shown as 448 x 448  detail; as many tokens as ``tile-1``
``native-224``          224 x 224 pixels                          detail and three quarters of a tile's tokens
======================  ========================================  ==================================================

``tile-1`` and ``blur-224`` differ only in detail. ``blur-224`` and ``native-224`` differ only in the number of tokens.
"""

from __future__ import annotations

import functools
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from PIL import Image

from betterbench.vqa.coordinates import Convention

TILE = 448
"""Side of an InternVL tile [pixel] (``image_size`` in the configuration of InternVL-3.5)."""
MYOPIC = 224
"""Side of the paper's single image [pixel] (appendix A.3)."""


class Eyes(StrEnum):
    """Resolution at which a model is shown images."""

    NATIVE = "native"
    TILE_1 = "tile-1"
    BLUR_224 = "blur-224"
    NATIVE_224 = "native-224"


_STEPS: dict[Eyes, tuple[int, ...]] = {
    Eyes.NATIVE: (),
    Eyes.TILE_1: (TILE,),
    Eyes.BLUR_224: (MYOPIC, TILE),
    Eyes.NATIVE_224: (MYOPIC,),
}
"""Side lengths to which an image is resized, one after the other [pixel]."""


@dataclass(frozen=True, slots=True)
class Shown:
    """An image as it is shown to a model, i.e. after its resolution was changed.

    Attributes:
        data: Content of the image file. It is the original file for ``native``, and otherwise a PNG file.
        width: Width of the shown image [pixel]. Absolute coordinates in an answer refer to the shown image.
        height: Height of the shown image [pixel].
        detail: Width and height [pixel] of the image at its effective resolution, which limits the visible detail. For
            ``blur-224``, they are smaller than those of the shown image.
    """

    data: bytes
    width: int
    height: int
    detail: tuple[int, int]


@functools.lru_cache(maxsize=8)  # cached because consecutive questions are often about the same image
def shown_picture(picture: bytes, eyes: Eyes) -> Shown:
    """Convert an image to the resolution of the given eyes.

    Args:
        picture: Content of an image file that Pillow can read, such as PNG or JPEG.
        eyes: The resolution.

    Raises:
        OSError: If the image cannot be decoded.
    """
    with Image.open(io.BytesIO(picture)) as opened:
        width, height = opened.size
        if eyes is Eyes.NATIVE:
            return Shown(picture, width, height, (width, height))
        image = opened.convert("RGB")
    detail = (width, height)
    for side in _STEPS[eyes]:
        detail = (min(detail[0], side), min(detail[1], side))
        image = image.resize((side, side), Image.Resampling.BICUBIC)
    return Shown(_png(image), image.width, image.height, detail)


def convention_for(eyes: Eyes, convention: Convention) -> Convention:
    """Return the coordinate convention for answers about images that are shown at the given resolution.

    If the image is not shown unchanged, pixel coordinates refer to the shown image, which is a square of known size.
    Other conventions stay the same.
    """
    if eyes is Eyes.NATIVE or convention.side is not None:
        return convention
    side = _STEPS[eyes][-1]
    return replace(convention, side=side, unit=convention.unit.format(width=side, height=side))


def size_in_detail(size: tuple[float, float], picture: tuple[int, int], eyes: Eyes) -> float:
    """Return the size of an object at the effective resolution of the eyes [pixel].

    Args:
        size: Width and height of the object in the original image [pixel].
        picture: Width and height of the original image [pixel].
        eyes: The resolution at which the model is shown the image.

    Returns:
        The geometric mean of the object's width and height.
    """
    least = min(_STEPS[eyes], default=None)
    across, down = ((1.0 if least is None else min(1.0, least / side)) for side in picture)
    return float((size[0] * across * size[1] * down) ** 0.5)


def contact_sheet(picture: bytes, eyes: Sequence[Eyes] = tuple(Eyes), *, side: int = TILE) -> bytes:
    """Draw an image at each resolution, side by side and labeled, as a PNG file.

    Below each image is its center, enlarged three times without smoothing, so that the pixels are visible.

    Raises:
        OSError: If the image cannot be decoded.
    """
    from PIL import ImageDraw  # noqa: PLC0415 - only for sheets

    gap, line = 8, 24
    sheet = Image.new("RGB", (gap + (side + gap) * len(eyes), line + 2 * (side + gap)), "white")
    pen = ImageDraw.Draw(sheet)
    for i, each in enumerate(eyes):
        shown = shown_picture(picture, each)
        with Image.open(io.BytesIO(shown.data)) as opened:
            image = opened.convert("RGB")
        middle = (image.width / 3, image.height / 3, image.width * 2 / 3, image.height * 2 / 3)
        left = gap + (side + gap) * i
        pen.text((left, 6), f"{each.value}: {shown.width} x {shown.height} pixels", fill="black")
        sheet.paste(image.resize((side, side), Image.Resampling.LANCZOS), (left, line))
        sheet.paste(image.resize((side, side), Image.Resampling.NEAREST, box=middle), (left, line + side + gap))
    return _png(sheet)


def _png(image: Image.Image) -> bytes:
    file = io.BytesIO()
    image.save(file, "PNG")
    return file.getvalue()
