"""Rendering of recorded states. The images are identical to those that a policy observes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Self

import numpy as np

from betterbench.interface import CameraSpec
from betterbench.records import Record, RunFolder
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.scenes.limited import LimitedView


class Pictures:
    """Renderer of recorded states with the cameras of an observation preset.

    Rendering happens in a separate process with limited resources. Use the renderer as a context manager.
    """

    def __init__(self, cameras: Sequence[CameraSpec], quality: str) -> None:
        self._names = tuple(camera.name for camera in cameras)
        self._views = tuple(ViewSpec(camera.name, camera.width, camera.height) for camera in cameras)
        self._view = LimitedView(quality=quality)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def of(self, run: RunFolder, record: Record, rows: Sequence[int] | None = None) -> Iterator[dict[str, np.ndarray]]:
        """For each row of a record, yield the images (height, width, 3) uint8 by camera name.

        Consume the iterator completely, or close the renderer.

        Args:
            run: Run that contains the record.
            record: Record of the episode.
            rows: Rows of the record to render; None for every row in which an action was taken.

        Raises:
            RecordError: If the stored scene is missing or unreadable, or belongs to another record.
            MissingDependencyError: If off-screen OpenGL does not work on this machine.
        """
        self._view.open_of(run, record)
        self._view.prepare(self._views, ("rgb",))
        shown = range(record.n_steps) if rows is None else rows
        for sights in self._view.sights(record.qpos[shown], jitter=record.metadata.view_jitter):
            yield {name: sight["rgb"] for name, sight in zip(self._names, sights, strict=True)}

    def stop(self) -> None:
        """End the rendering process from another thread. The rendering thread then raises a RecordError."""
        self._view.stop()

    def close(self) -> None:
        """End the rendering process."""
        self._view.close()
