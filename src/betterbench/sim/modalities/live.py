"""Modality files that are written during recording.

They are byte-identical to the files that ``better materialize`` would write later.
"""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Self

from betterbench.records import Record
from betterbench.sim.modalities.folder import ModalityFolder, Wanted
from betterbench.sim.modalities.trial_files import TrialFiles, TrialOrigin
from betterbench.sim.scenes import Scene, renderer_fingerprint
from betterbench.sim.scenes.sights import Sights
from betterbench.tasks import TrialId


class LiveMaterializer:
    """Context manager that renders the views of a scene row by row during recording, and writes them to files.

    Call :meth:`add` whenever a row is appended to the record, i.e. after the reset and after every step. Then call
    :meth:`finish` with the finished record. If :meth:`finish` is not called, no files are kept. ``out`` is a folder
    with the same layout as the output of ``better materialize``. If ``out`` is ``RUN/modalities``, ``better
    materialize`` finds the files and keeps them.

    Raises:
        RunConflictError: If the folder contains unrelated files, or was rendered with a different OpenGL.
        StorageError: If the disk is full.
        MissingDependencyError: If off-screen OpenGL does not work on this machine.
    """

    def __init__(self, scene: Scene, out: Path, wanted: Wanted) -> None:
        self._scene, self._folder = scene, ModalityFolder(out, wanted)
        self._fingerprint = renderer_fingerprint()
        self._folder.claim(self._fingerprint)
        self._sights = Sights(scene.model, scene.quality, wanted.views, wanted.modalities)
        place = self._folder.trial(TrialId(scene.task.id, scene.condition.name, scene.seed))
        try:
            self._files = TrialFiles(
                place, wanted.views, wanted.modalities, facts=self._sights.facts(), objects=scene.info.objects
            )
        except BaseException:
            self._sights.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._files.__exit__(kind, error, trace)
        self._sights.close()

    def add(self) -> None:
        """Render the current state as the next row."""
        self._files.add(list(self._sights.draw(self._scene.data)), self._scene.state().time_s)

    def finish(self, record: Record, record_sha256: str) -> list[Path]:
        """Move the finished files to their final paths, and return these paths.

        ``record_sha256`` is the SHA-256 of the record file.
        """
        origin = TrialOrigin(record.metadata, record_sha256, self._scene.quality.name, self._fingerprint)
        return self._files.finish(origin)
