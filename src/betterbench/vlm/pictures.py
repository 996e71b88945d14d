"""Read untrusted images, image sizes and target regions from folders, tables, JSON and videos."""

from __future__ import annotations

import base64
import binascii
import io
import warnings
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, UnidentifiedImageError

from betterbench.errors import InvalidInputError, one_line
from betterbench.jobs.places import require_inside
from betterbench.json_form import read_bounded
from betterbench.vqa.llm.chat import media_type

MOST_BYTES = 64 << 20
"""Maximum size of an image file [byte]."""
MOST_PIXELS = 64_000_000
NOT_A_PICTURE = (OSError, ValueError, SyntaxError, Image.DecompressionBombError)
"""Exceptions that Pillow raises for a file that is truncated, too large or not an image."""
_CURE = "Download the data again"
_SENT = ("image/png", "image/jpeg")
_OF_PNG = ("1", "L", "LA", "P", "RGB", "RGBA", "I;16")
"""Pillow image modes that a PNG file can store without conversion."""


def size_of(data: bytes, where: str) -> tuple[int, int]:
    """Return the width and height of an image, read from its header. Raises InvalidInputError if it is not an image."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data)) as image:
                width, height = image.size
    except NOT_A_PICTURE as error:
        raise not_a_picture(where, error) from error
    if width * height > MOST_PIXELS:
        raise InvalidInputError(where, f"it has {width} × {height} pixels, more than {MOST_PIXELS:,}", _CURE)
    return width, height


def not_a_picture(where: str, error: Exception) -> InvalidInputError:
    """Return the error for an image file that Pillow cannot read."""
    why = "" if isinstance(error, UnidentifiedImageError) else f" ({one_line(error).rstrip('.')})"
    return InvalidInputError(where, f"is not an image{why}", _CURE)


def require_whole(data: bytes, where: str) -> None:
    """Raise InvalidInputError if an image is too large, truncated, or cannot be decoded.

    Decoding takes most of the CPU time of a request, so this function does not decode images at full size. For a PNG
    file, it only verifies the checksums (0.1 ms instead of 9 ms for 640 x 480 pixels). A JPEG file is decoded
    completely, but at an eighth of its size (0.6 ms instead of 1.1 ms).
    """
    size_of(data, where)
    try:
        with Image.open(io.BytesIO(data)) as image:
            if image.format == "PNG":
                image.verify()
            else:
                image.draft("L", (1, 1))  # only JPEG supports decoding at a reduced size
                image.load()
    except NOT_A_PICTURE as error:
        raise not_a_picture(where, error) from error


def sendable(data: bytes, where: str) -> bytes:
    """Return an image as PNG or JPEG, the formats that every endpoint and every processor accepts.

    PNG and JPEG files stay unchanged. Files in other formats, such as WebP, GIF, BMP and TIFF, are converted to PNG
    files with the same pixels.

    Raises:
        InvalidInputError: If the image is too large, cannot be decoded completely, has several frames, or has pixels
            that PNG cannot store.
    """
    require_whole(data, where)
    if media_type(data) in _SENT:
        return data
    try:
        with Image.open(io.BytesIO(data)) as image:
            frames = getattr(image, "n_frames", 1)
            if frames != 1:
                raise InvalidInputError(
                    where, f"it has {frames} frames, expected one image", "Use files with a single image"
                )
            plain = image if image.mode in _OF_PNG else image.convert("RGB")
            file = io.BytesIO()
            plain.save(file, "PNG")
    except NOT_A_PICTURE as error:
        raise not_a_picture(where, error) from error
    return file.getvalue()


def mask_of(data: bytes, where: str, *, above: int = 0) -> npt.NDArray[np.bool_]:
    """Return a boolean array (rows, columns) of the pixels with a value above ``above`` in the first channel."""
    size_of(data, where)
    try:
        with Image.open(io.BytesIO(data)) as image:
            values = np.asarray(image)
    except NOT_A_PICTURE as error:
        raise not_a_picture(where, error) from error
    return np.asarray((values if values.ndim == 2 else values[:, :, 0]) > above)


def file_in(folder: Path, place: str, *, where: str) -> Path:
    """Return the path of a file that a data row refers to.

    Raises:
        InvalidInputError: If the path leads out of the data folder, or the file is missing.
    """
    pure = PurePosixPath(place)
    if not place or pure.is_absolute() or ".." in pure.parts or not place.isprintable():
        raise InvalidInputError(
            where, f"{one_line(place, most=80)!r} is outside the data folder", "Use a path relative to the data folder"
        )
    path = folder / place
    require_inside(path, folder)
    if not path.is_file():
        raise InvalidInputError(
            where, f"it refers to {one_line(place, most=120)}, which is missing", f"Put it into {folder}"
        )
    return path


def picture_file(path: Path) -> bytes:
    """Return the content of an image file."""
    return read_bounded(path, max_bytes=MOST_BYTES, cure=_CURE)


def embedded(value: Any, where: str) -> bytes:  # noqa: ANN401 - a cell of JSON or Parquet
    """Return the content of an image that is embedded in a cell of a table.

    The cell contains bytes, a base64 string, or a struct with either of them.

    Raises:
        InvalidInputError: If the cell does not contain an image. The message names the row and the column.
    """
    if isinstance(value, Mapping):
        value = value.get("bytes")
    if isinstance(value, bytes | bytearray) and value:
        return bytes(value)
    if isinstance(value, str) and value:
        text = value.partition(",")[2] if value.startswith("data:") else value
        try:
            return base64.b64decode("".join(text.split()), validate=True)
        except (binascii.Error, ValueError) as error:
            problem = f"is not base64 ({one_line(error)})"
            raise InvalidInputError(where, problem, "Store the image as base64 or bytes") from error
    raise InvalidInputError(where, "it contains no image", "Store the image as base64, bytes, or a struct with bytes")
