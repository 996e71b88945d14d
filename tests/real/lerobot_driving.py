"""The real lerobot for tests on emulated servos: its imports, cameras at the port of OpenCV, and ``better`` with both.

Run as a script with the arguments of ``better``, in the environment of requirements/lerobot-feetech.lock.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
import warnings

os.environ["HF_HUB_OFFLINE"] = "1"  # read when the package of the hub is imported

with contextlib.suppress(ImportError), warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import torchvision_for_processors  # noqa: F401 - of the environment; lerobot 0.6 does not need it

import cv2
import numpy as np
from scservo_sdk import PortHandler

PATIENCE = 8.0
"""Factor of the SDK's time for an answer, 50 ms by lerobot: a busy machine lets the emulated servos wait for longer."""

_real_time = PortHandler.getCurrentTime
PortHandler.getCurrentTime = lambda port: _real_time(port) / PATIENCE

COLOR_BGR = (10, 120, 200)


class Capture:
    """A camera in place of ``cv2.VideoCapture``: lerobot's own camera class sets and reads it as a device."""

    absent = ("9",)
    """Cameras that are not there."""
    unplugged: tuple[str, ...] = ()
    """Cameras that send nothing more."""

    def __init__(self, source: int | str, _backend: int = 0) -> None:
        self._source, self._is_open = str(source), str(source) not in self.absent
        self._set = {cv2.CAP_PROP_FPS: 30.0, cv2.CAP_PROP_FRAME_WIDTH: 640.0, cv2.CAP_PROP_FRAME_HEIGHT: 480.0}

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        return self._is_open

    def set(self, name: int, value: float) -> bool:
        self._set[name] = value
        return True

    def get(self, name: int) -> float:
        return self._set.get(name, 0.0)

    def read(self) -> tuple[bool, np.ndarray | None]:
        time.sleep(1.0 / self._set[cv2.CAP_PROP_FPS])
        if self._source in self.unplugged:
            return False, None
        size = (int(self._set[cv2.CAP_PROP_FRAME_HEIGHT]), int(self._set[cv2.CAP_PROP_FRAME_WIDTH]), 3)
        return True, np.full(size, COLOR_BGR, np.uint8)

    def release(self) -> None:
        self._is_open = False


if __name__ == "__main__":
    from betterbench.cli.main import main

    cv2.VideoCapture = Capture
    sys.exit(main(sys.argv[1:]))
