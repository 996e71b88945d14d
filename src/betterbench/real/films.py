"""Videos of a trial, encoded in a thread while the arm moves."""

from __future__ import annotations

import queue
import threading

import numpy as np

from betterbench.demonstrations.export.video import VideoWriter
from betterbench.errors import InvalidInputError
from betterbench.real.record import Film
from betterbench.real.robots.robot import Frame, RobotError


class FilmThread:
    """Thread that encodes the video of one camera, with one frame per control step."""

    def __init__(self, camera: str, *, rate_hz: float) -> None:
        """Start the encoding thread."""
        self._camera, self._period_s = camera, 1.0 / rate_hz
        self._writer = VideoWriter(rate_hz=max(1, round(rate_hz)))
        self._frames: queue.Queue[np.ndarray | None] = queue.Queue()
        self._size: tuple[int, int] | None = None
        self._count = self._late = self._dropped = 0
        self._last_s: float | None = None
        self._problem: Exception | None = None
        self._thread = threading.Thread(target=self._run, name=f"film {camera}", daemon=True)
        self._thread.start()

    def add(self, frame: Frame, now_s: float) -> bool:
        """Append the newest frame of the camera at a control step, and return whether the frame was too old.

        Raises:
            RobotError: If the camera changed its image size.
        """
        # The codec needs an even width and height.
        height, width = (side - side % 2 for side in frame.image.shape[:2])
        if self._size is None:
            self._size = (width, height)
        if self._size != (width, height):
            problem = f"changed its image size from {self._size[0]} x {self._size[1]} to {width} x {height}"
            raise RobotError(f"Camera {self._camera} {problem}. Check its settings.")
        late = now_s - frame.time_s > self._period_s
        self._late += late
        self._dropped += frame.time_s == self._last_s
        self._last_s = frame.time_s
        self._count += 1
        self._frames.put(np.ascontiguousarray(frame.image[:height, :width]))
        return late

    def finish(self) -> tuple[Film, bytes] | None:
        """Return the metadata of the video and the encoded file, or None if there are no frames.

        Raises:
            InvalidInputError: If encoding failed.
        """
        self._frames.put(None)
        self._thread.join()
        if self._problem is not None:
            raise InvalidInputError(f"camera {self._camera}", str(self._problem), "Repeat the trial") from self._problem
        if self._size is None:
            return None
        try:
            data = self._writer.finish()
        except Exception as problem:
            raise InvalidInputError(f"camera {self._camera}", str(problem), "Repeat the trial") from problem
        return Film(*self._size, self._count, self._late, self._dropped), data

    def _run(self) -> None:
        while (image := self._frames.get()) is not None:
            try:
                self._writer.add(image)
            except Exception as problem:  # noqa: BLE001 - of the encoder; raised in finish
                self._problem = self._problem or problem
