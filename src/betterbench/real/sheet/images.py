"""Images of the front camera, read from a file or captured live."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.json_form import read_bounded
from betterbench.real.sheet.camera_pose import opencv

_MOST_BYTES = 64 << 20
_MOST_PIXELS = 64_000_000
"""Maximum number of pixels in an image, which is more than most phone cameras have."""
_WARM_UP = 15
"""Number of frames that are captured until exposure and focus have settled. The last frame is used."""


def image_of(path: Path) -> np.ndarray:
    """Read an image file as (height, width, 3) uint8 RGB, with its orientation tag applied.

    Raises:
        InvalidInputError: If the file is not a PNG or JPEG image, or is too large.
    """
    from PIL import Image, ImageOps, UnidentifiedImageError  # noqa: PLC0415 - the live camera does without

    data = read_bounded(path, max_bytes=_MOST_BYTES, cure="Use an image of the front camera")
    try:
        with warnings.catch_warnings():
            # Disable Pillow's own limit on the image size, because the limit checked below is smaller.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            opened = Image.open(io.BytesIO(data), formats=("PNG", "JPEG"))
        with opened:
            if opened.width * opened.height > _MOST_PIXELS:
                raise _too_large(path, f"the image has {opened.width} x {opened.height} pixels")
            upright = ImageOps.exif_transpose(opened)
            if upright.mode.startswith("I"):  # 16-bit images, which Pillow would clip at 255
                values = np.asarray(upright, dtype=np.float32)
                upright = Image.fromarray((values * (255.0 / max(1.0, float(values.max())))).astype(np.uint8))
            return np.asarray(upright.convert("RGB"))
    except Image.DecompressionBombError as problem:
        raise _too_large(path, "the image has too many pixels") from problem
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as problem:
        raise InvalidInputError(
            str(path), "the file cannot be read as PNG or JPEG", "Use a PNG or JPEG image"
        ) from problem


def _too_large(path: Path, problem: str) -> InvalidInputError:
    cure = (
        f"Use an image of at most {_MOST_PIXELS // 1_000_000} million pixels, such as those that `better real run` uses"
    )
    return InvalidInputError(str(path), problem, cure)


def live_image(source: str, size: tuple[int, int]) -> np.ndarray:
    """Capture one frame of a camera, given by index or path, as (height, width, 3) uint8 RGB.

    Raises:
        InvalidInputError: If the camera sends no frame, or a frame of a different size.
        MissingDependencyError: If OpenCV is not installed.
    """
    cv2 = opencv()
    is_index = source.isascii() and source.isdigit() and len(source) <= 4
    capture = cv2.VideoCapture(int(source) if is_index else source)
    try:
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
        frame = None
        for _ in range(_WARM_UP):
            good, newest = capture.read()
            frame = newest if good else frame
    finally:
        capture.release()
    if frame is None:
        cure = "Check its plug and its index (lerobot-find-cameras opencv), and close programs that use it"
        raise InvalidInputError(f"--camera {source}", "the camera sends no frames", cure)
    if frame.shape[:2] != (size[1], size[0]):
        problem = (
            f"the camera sends images of {frame.shape[1]} x {frame.shape[0]} pixels instead of {size[0]} x {size[1]}"
        )
        raise InvalidInputError(
            f"--camera {source}", problem, "Set this size with --camera-size, both here and for `better real run`"
        )
    return np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
