"""Writer of the modality files of one trial. It takes the rendered views row by row."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from betterbench.errors import RecordError
from betterbench.geometry import Vector
from betterbench.interface.state import ObjectInfo
from betterbench.jobs.durable import on_disk
from betterbench.records import RecordMetadata
from betterbench.records.modalities.columns import view_columns
from betterbench.records.modalities.file import ModalityWriter
from betterbench.records.modalities.header import BoxedObject, ViewHeader, instance_of_object, stage_ids
from betterbench.records.modalities.labels import semantic_id, semantic_ids
from betterbench.records.modalities.spec import MODALITIES, ViewSpec
from betterbench.sim.modalities.values import ViewValues
from betterbench.sim.scenes.sights import ModelFacts


@dataclass(frozen=True, slots=True)
class TrialOrigin:
    """Origin of a trial's files: metadata and digest of the record, the render preset, and the properties of OpenGL."""

    metadata: RecordMetadata
    record_sha256: str
    quality: str
    renderer: dict[str, str]


class TrialFiles:
    """Modality files for views of one trial. The context manager removes files that were not finished.

    Raises StorageError if the disk is full, and RecordError if the scene and the record list different objects.
    """

    def __init__(
        self,
        folder: Path,
        views: Sequence[ViewSpec],
        modalities: Sequence[str],
        *,
        facts: ModelFacts,
        objects: Sequence[ObjectInfo],
    ) -> None:
        if len(objects) != len(facts.object_bodies):
            raise RecordError(
                "stored scene: its objects differ from those of the record. Run the trial again to store its scene."
            )
        self._views, self._modalities, self._facts = tuple(views), tuple(modalities), facts
        self._categories = [o.category for o in objects]
        semantic_ids(self._categories)
        self._values = [ViewValues(facts, modalities, self._categories, focal_px) for focal_px in facts.focal_px]
        self._last: tuple[Sequence[np.ndarray], float] | None = None
        self._folder = folder
        self._writers: list[ModalityWriter] = []
        with ExitStack() as begun, on_disk(folder):
            for view in views:
                columns = view_columns(view, modalities, len(objects))
                writer = ModalityWriter(folder / f"{view.name}.parquet", columns)
                self._writers.append(begun.enter_context(writer))
            self._stack = begun.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def add(self, sights: Sequence[np.ndarray], time_s: float) -> None:
        """Add the rendered views of the next row of the record. ``time_s`` is the time of this row [s]."""
        last, self._last = self._last, (sights, time_s)
        if last is not None:
            self._append(last, sights)

    def finish(self, origin: TrialOrigin) -> list[Path]:
        """Write the last row and the headers of the files, and return the paths of the files."""
        last, self._last = self._last, None
        if last is not None:
            self._append(last, None)
        with on_disk(self._folder):
            return [
                writer.finish(self._header(origin, number, view))
                for number, (writer, view) in enumerate(zip(self._writers, self._views, strict=True))
            ]

    def _append(self, row: tuple[Sequence[np.ndarray], float], following: Sequence[np.ndarray] | None) -> None:
        sights, time_s = row
        with on_disk(self._folder):
            for number, (writer, values) in enumerate(zip(self._writers, self._values, strict=True)):
                writer.append(values.of(sights[number], time_s, None if following is None else following[number]))

    def _header(self, origin: TrialOrigin, number: int, view: ViewSpec) -> ViewHeader:
        meta = origin.metadata
        halves: list[Vector] = [(x, y, z) for x, y, z in self._facts.boxes[:, 1].tolist()]
        objects = tuple(
            BoxedObject(o.name, o.category, instance_of_object(i), semantic_id(o.category), half)
            for i, (o, half) in enumerate(zip(meta.scene.objects, halves, strict=True))
        )
        return ViewHeader(
            task=meta.task,
            condition=meta.condition,
            seed=meta.seed,
            policy=meta.policy,
            record_sha256=origin.record_sha256,
            scene_hash=meta.scene_hash,
            view=view,
            quality=origin.quality,
            modalities=tuple(name for name in MODALITIES if name in self._modalities),
            control_rate_hz=meta.control_rate_hz,
            focal_px=self._facts.focal_px[number],
            objects=objects,
            renderer=origin.renderer,
            stage=stage_ids(),
        )
