"""Live camera images, rendered in a separate thread so that the control loop never waits for them."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from betterbench.errors import BetterError
from betterbench.sim.scenes import Scene, StoredView

logger = logging.getLogger(__name__)

LONGEST_RATE_HZ = 10.0
"""Maximum number of images per camera and second. The limit leaves CPU time for the physics."""
SIZE_PX = 256
LATE_S = 1.0
"""Minimum delay at which an image is reported as late [s]."""
STOP_S = 0.5
"""Maximum time to wait for the current image when the thread is closed [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    scene: Scene
    qpos: np.ndarray


class CameraThread:
    """Thread that renders the newest state of the scene. It skips older states that it had no time to render."""

    def __init__(
        self,
        cameras: Sequence[str],
        show: Callable[[str, np.ndarray], None],
        complain: Callable[[str], None],
    ) -> None:
        """Start rendering.

        Args:
            cameras: Names of the cameras.
            show: Called with the name of a camera and its image, (height, width, 3) uint8.
            complain: Called with a message if rendering fails.
        """
        self._cameras, self._show, self._complain = tuple(cameras), show, complain
        self._newest: _Frame | None = None
        self._wake = threading.Condition()
        self._is_over = False
        self._waits_since: float | None = None
        self._thread = threading.Thread(target=self._run, name="teleop cameras", daemon=True)
        if self._cameras:
            self._thread.start()

    def look(self, scene: Scene) -> None:
        """Request images of a scene's current state."""
        frame = _Frame(scene, scene.simulator_state()["qpos"].copy())
        with self._wake:
            self._newest = frame
            if self._waits_since is None:
                self._waits_since = time.monotonic()
            self._wake.notify()

    @property
    def late_s(self) -> float:
        """Age of the newest images [s]. It is 0 if the images are up to date or no images are rendered."""
        since = self._waits_since
        if since is None or not self._thread.is_alive():
            return 0.0
        late = time.monotonic() - since
        return late if late >= LATE_S else 0.0

    @property
    def is_busy(self) -> bool:
        """Whether the rendering thread is still running."""
        return self._thread.is_alive()

    def close(self) -> None:
        """Stop rendering and free the renderer, unless the current image takes longer than :data:`STOP_S`."""
        with self._wake:
            self._is_over = True
            self._wake.notify()
        if self._thread.is_alive():
            self._thread.join(timeout=STOP_S)

    def _run(self) -> None:
        view: StoredView | None = None
        of: Scene | None = None
        try:
            while (frame := self._next()) is not None:
                began = time.monotonic()
                if frame.scene is not of:
                    if view is not None:
                        view.close()
                    of, view = frame.scene, None
                    view = StoredView(of.model, of.quality, width=SIZE_PX, height=SIZE_PX)
                if view is not None:
                    for camera in self._cameras:
                        image = view.draw(frame.qpos, camera, jitter=frame.scene.view_jitter).rgb
                        if image is not None:
                            self._show(camera, image)
                self._waits_since = None
                # The thread pauses for as long as it rendered, to leave CPU time for the physics and the page.
                took = time.monotonic() - began
                time.sleep(max(took, 1.0 / LONGEST_RATE_HZ - took))
        except BetterError as problem:
            self._complain(f"no camera images: {problem}")
        except Exception as problem:
            logger.exception("the camera images have stopped")
            self._complain(f"no camera images: {type(problem).__name__}: {problem}")
        finally:
            if view is not None:
                view.close()

    def _next(self) -> _Frame | None:
        with self._wake:
            self._wake.wait_for(lambda: self._newest is not None or self._is_over)
            frame, self._newest = self._newest, None
            return None if self._is_over else frame
