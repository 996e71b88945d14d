"""Videos in data sets: H.264 in MP4, with one frame per control step and reproducible bytes."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.ordinary_file import open_ordinary

CODEC, PIXEL_FORMAT = "h264", "yuv420p"

QUALITY = 18
"""Constant rate factor of the x264 encoder."""

EFFORT = "veryfast"
"""Speed preset of the x264 encoder."""

GROUP = 2
"""Distance between key frames. The distance is as small as in LeRobot, so that random frames are decoded quickly."""

VIDEO_SETTINGS = {
    "codec": CODEC,
    "pixel_format": PIXEL_FORMAT,
    "quality": QUALITY,
    "effort": EFFORT,
    "group": GROUP,
}
"""Settings of the video encoder, which are stored with the data set."""

_BITEXACT = {"fflags": "+bitexact"}  # do not write library versions into the file


class VideoWriter:
    """Encoder for a sequence of images of the same size, (height, width, 3) uint8 with even width and height.

    The encoder runs in one thread, because its output depends on the number of threads.
    """

    def __init__(self, *, rate_hz: int) -> None:
        self._rate_hz, self._count = rate_hz, 0
        self._buffer = io.BytesIO()
        self._container = av.open(self._buffer, "w", format="mp4", options=_BITEXACT)
        self._stream: Any = None

    def add(self, picture: np.ndarray) -> None:
        """Append an image. Raises InvalidInputError if its width or height is odd."""
        if self._stream is None:
            self._stream = self._begin(*picture.shape[:2])
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        frame.pts, frame.time_base = self._count, Fraction(1, self._rate_hz)
        self._count += 1
        self._container.mux(self._stream.encode(frame))

    def finish(self) -> bytes:
        """Return the encoded video file. Raises InvalidInputError if no image was added."""
        if self._stream is None:
            raise InvalidInputError("video", "the episode has no images", "Leave out the episode")
        self._container.mux(self._stream.encode(None))
        self._container.close()
        return self._buffer.getvalue()

    def _begin(self, height: int, width: int) -> Any:  # noqa: ANN401 - PyAV's stream
        require_even(width, height)
        stream: Any = self._container.add_stream("libx264", rate=self._rate_hz)
        stream.width, stream.height, stream.pix_fmt = width, height, PIXEL_FORMAT
        context = stream.codec_context
        stream.time_base = context.time_base = Fraction(1, self._rate_hz)
        context.gop_size, context.max_b_frames, context.thread_count = GROUP, 0, 1
        stream.options = {"crf": str(QUALITY), "preset": EFFORT, "threads": "1", "flags": "+bitexact"}
        return stream


def require_even(width: int, height: int) -> None:
    """Raise InvalidInputError if a width or height is odd, because the pixel format requires even sizes."""
    if width % 2 or height % 2:
        raise InvalidInputError(
            "--images",
            f"a video needs an even width and height, but the images have {width} x {height} pixels",
            "Use --images png",
        )


def join(videos: Sequence[bytes], *, rate_hz: int) -> bytes:
    """Concatenate videos without encoding them again.

    All videos must have been written by :class:`VideoWriter`, with images of the same size.
    """
    buffer = io.BytesIO()
    with av.open(buffer, "w", format="mp4", options=_BITEXACT) as container:
        stream: Any = None
        begun = Fraction(0)
        for data in videos:
            with av.open(io.BytesIO(data), "r") as source:
                given: Any = source.streams.video[0]
                if stream is None:
                    stream = container.add_stream_from_template(given)
                    stream.time_base = given.time_base
                packets: Iterator[Any] = source.demux(given)
                for packet in packets:
                    if packet.dts is None:
                        continue
                    offset = round(begun / given.time_base)
                    packet.pts, packet.dts = packet.pts + offset, packet.dts + offset
                    packet.stream = stream
                    container.mux(packet)
                begun += Fraction(given.frames, rate_hz)
    return buffer.getvalue()


def read_pictures(source: io.BytesIO | str, *, first: int = 0) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the index and the image (height, width, 3) uint8 of each frame of a video, starting at the frame ``first``.

    Raises InvalidInputError if the video cannot be read.
    """
    name = source if isinstance(source, str) else "video"
    try:
        with (
            open_ordinary(Path(source)) if isinstance(source, str) else source as opened,
            av.open(opened, "r", format="mp4") as container,  # other formats could name further files
        ):
            stream: Any = container.streams.video[0]
            rate, base = stream.average_rate, stream.time_base
            container.seek(round(first / rate / base), stream=stream)
            for frame in container.decode(stream):
                number = round((frame.pts or 0) * base * rate)
                if number >= first:
                    yield number, frame.to_ndarray(format="rgb24")
    except (av.FFmpegError, OSError, ValueError, IndexError, TypeError) as error:
        said = " ".join(str(getattr(error, "strerror", None) or error).split())
        raise InvalidInputError(name, f"the video cannot be read ({said})", "Export the data set again") from error
