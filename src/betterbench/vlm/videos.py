"""Extract single frames from a video, by frame number."""

from __future__ import annotations

import io
from functools import lru_cache
from pathlib import Path

import av
from PIL import Image

from betterbench.errors import InvalidInputError, one_line


@lru_cache(maxsize=4)
def frames_of(video: Path, numbers: tuple[int, ...]) -> tuple[bytes, ...]:
    """Return the frames with the given numbers from a video as PNG files, in the order of the numbers.

    The video is decoded from the start, so that frame numbers are exact. For a number beyond the end of the video, the
    last frame is returned.

    Raises:
        InvalidInputError: If the video is empty or cannot be decoded.
    """
    found, last = dict[int, bytes](), None
    try:
        with av.open(str(video), format="mp4") as container:  # other formats could name further files
            for number, frame in enumerate(container.decode(video=0)):
                last = frame
                if number in numbers:
                    found[number] = _png(frame)
                if number >= max(numbers):
                    break
        if last is None:
            raise InvalidInputError(str(video), "it has no frames", "Download it again")
        return tuple(found[n] if n in found else _png(last) for n in numbers)
    except (OSError, av.FFmpegError, IndexError) as error:
        raise InvalidInputError(str(video), f"it cannot be decoded ({one_line(error)})", "Download it again") from error


def _png(frame: av.VideoFrame) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(frame.to_ndarray(format="rgb24")).save(buffer, "PNG")
    return buffer.getvalue()
