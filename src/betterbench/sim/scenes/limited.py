"""Rendering of untrusted stored scenes (MuJoCo's binary models) in a separate process with limits.

MuJoCo does not validate such files, so a forged file can crash or hang the process or exhaust the memory. The process
therefore has limits for memory and time, and returns only pixels or strings, never Python objects.

A process can also end for other reasons, for example if a renderer crashes or the system is short of memory. The
request during which a process ended is therefore repeated once in a new process. It is rejected only if the new process
ends too.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeVar

import numpy as np
from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, RecordError
from betterbench.geometry import Vector
from betterbench.interface.state import ViewJitter
from betterbench.jobs.limited_process import (
    LONGEST_REASON,
    LimitedProcess,
    LimitedProcessError,
    ProcessEndedError,
    ProcessLateError,
    RefusedError,
    answer_requests,
)
from betterbench.json_form import read_form, strict_form
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.graphics import next_device_variables
from betterbench.sim.scenes.gl_context import renderer_fingerprint
from betterbench.sim.scenes.sights import ModelFacts, StoredSights, sight_type
from betterbench.sim.scenes.stage import quality_preset
from betterbench.sim.scenes.stored import StoredView, load_model

if TYPE_CHECKING:
    from betterbench.records import Record, RunFolder

MAX_MEMORY_BYTES = 16 * 1024**3
"""Address space of the process [byte]. The software renderer maps 4 GB of it."""
REQUEST_CPU_S = 60.0
"""Maximum CPU time to open a scene or render an image [s]."""
REQUEST_S = 900.0
"""Maximum wall-clock time of the same [s], including the start of the process: much more, for busy machines."""

_JITTER = TypeAdapter(ViewJitter)
_MOST_FACTS_BYTES = 1 << 22

_AnswerT = TypeVar("_AnswerT")
_Number = Annotated[int, Field(ge=0, le=0xFFFF)]


@strict_form
@dataclass(frozen=True, slots=True)
class _Facts:
    """JSON representation of :class:`~betterbench.sim.scenes.sights.ModelFacts`, and the process's renderer."""

    instances: list[_Number]
    object_bodies: list[_Number]
    boxes: list[tuple[Vector, Vector]]
    focal_px: list[Annotated[float, Field(gt=0.0)]]
    renderer: dict[str, str]


_Wanted = tuple[tuple[ViewSpec, ...], tuple[str, ...], bool]
_FACTS, _VIEWS = TypeAdapter(_Facts), TypeAdapter(list[ViewSpec])


class _EndedError(RecordError):
    """The process has ended without a request to end."""


class LimitedView:
    """Renderer for recorded states of stored scenes, one scene at a time. A context manager, which ends the process."""

    def __init__(self, *, quality: str, size: int = 256) -> None:
        """Start the process. ``size`` is the side length of the images from :meth:`draw` [pixel].

        Raises GraphicsError if ``MUJOCO_EGL_DEVICE_ID`` names no device.
        """
        self._quality, self._size = quality, size
        self._told_to_end = False
        self._types: list[np.dtype[np.void]] = []
        self._opened: tuple[str, str] | None = None
        self._files: Mapping[str, bytes] | None = None
        self._prepared: tuple[_Wanted, tuple[ModelFacts, dict[str, str]]] | None = None
        self._start()

    def _start(self) -> None:
        self._process = LimitedProcess(
            f"{__name__}:draw_for_parent",
            self._quality,
            self._size,
            cpu_s=REQUEST_CPU_S,
            environment=next_device_variables(),
        )
        if self._told_to_end:  # another thread has called stop() meanwhile
            self._process.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def size(self) -> int:
        """Side of the images [pixel]."""
        return self._size

    def set_look(self, *, quality: str, size: int) -> None:
        """Use another preset and another size [pixel] for the next scene. The open scene is closed.

        Raises RecordError if the process does not answer.
        """
        if (quality, size) == (self._quality, self._size):
            return
        self._quality, self._size = quality, size
        self._opened, self._prepared, self._files = None, None, None
        self._at_most_twice(lambda: self._ask({"quality": quality, "size": size}, b""))

    def open(self, files: Mapping[str, bytes]) -> None:
        """Open a stored scene from the result of :func:`betterbench.sim.scenes.stored.scene_files`.

        Raises:
            RecordError: If it cannot be opened, because it is damaged or forged, or was written by another version of
                MuJoCo.
            MissingDependencyError: If no off-screen OpenGL works here.
        """
        self._opened, self._prepared, self._files = None, None, None
        self._at_most_twice(lambda: self._load(files))
        self._files = files

    def _load(self, files: Mapping[str, bytes]) -> None:
        self._ask({"files": {name: len(data) for name, data in files.items()}}, b"".join(files.values()))

    def open_of(self, run: RunFolder, record: Record) -> None:
        """Open the stored scene of a run's record, unless it is already open.

        Raises the same errors as :meth:`open`.
        """
        from betterbench.tasks import TrialId  # noqa: PLC0415 - takes 0.1 s, which the rendering process does not need

        m = record.metadata
        digest = run.scene_digest(TrialId(m.task, m.condition, m.seed))
        scene = (m.scene_hash, digest or str(run.path))
        if scene != self._opened:
            self.open(run.load_scene(m.scene_hash, digest=digest))
            self._opened = scene

    def draw(self, qpos: np.ndarray, camera: str, *, jitter: ViewJitter) -> np.ndarray:
        """Return the view of one recorded state, (nq,), as (size, size, 3) uint8.

        Raises the same errors as :meth:`open`.
        """
        numbers = np.asarray(qpos, dtype=np.float64).tobytes()
        request = {"camera": camera, "jitter": jitter.to_json()}
        pixels = self._at_most_twice(lambda: self._ask(request, numbers))
        if len(pixels) != 3 * self._size**2:
            raise self._refused("its process returned an image of another size")
        return np.frombuffer(pixels, np.uint8).reshape(self._size, self._size, 3)

    def project(self, points: np.ndarray, camera: str) -> np.ndarray:
        """Return the pixels (n, 2) of world points (n, 3) [m] in the last view, or NaN behind the camera.

        Raises the errors of :meth:`open`.
        """
        numbers = np.ascontiguousarray(points, dtype=np.float64).tobytes()
        found = self._ask({"project": camera}, numbers)
        if 3 * len(found) != 2 * len(numbers):
            raise self._refused("its process returned another number of points")
        return np.frombuffer(found).reshape(-1, 2)

    def prepare(
        self, views: Sequence[ViewSpec], modalities: Sequence[str], *, gripper: bool = False
    ) -> tuple[ModelFacts, dict[str, str]]:
        """Prepare to render sights of the open scene, and return their common properties and OpenGL's fingerprint.

        ``gripper`` has the same meaning as in :class:`~betterbench.sim.scenes.sights.Sights`. The last preparation for
        the same scene is reused. Raises the errors of :meth:`open`.
        """
        wanted = (tuple(views), tuple(modalities), gripper)
        if self._prepared is None or self._prepared[0] != wanted:
            self._prepared = None
            found = self._at_most_twice(lambda: self._prepare(views, modalities, gripper=gripper))
            self._prepared = wanted, found
        return self._prepared[1]

    def _prepare(
        self, views: Sequence[ViewSpec], modalities: Sequence[str], *, gripper: bool
    ) -> tuple[ModelFacts, dict[str, str]]:
        request = {"views": json.loads(_VIEWS.dump_json(list(views))), "modalities": list(modalities)}
        answer = self._ask({**request, "gripper": gripper}, b"", most=_MOST_FACTS_BYTES)
        told = read_form(_FACTS, bytes(answer), where="stored scene", cure="Run the trial again", raises=RecordError)
        facts = ModelFacts(
            np.array(told.instances, np.uint16),
            np.array(told.object_bodies, np.int64),
            np.array(told.boxes, np.float64).reshape(-1, 2, 3),
            tuple(told.focal_px),
        )
        known = bool((facts.object_bodies < len(facts.instances)).all())
        if not known or len(facts.boxes) != len(facts.object_bodies) or len(facts.focal_px) != len(views):
            raise self._refused("its process returned other views")
        sizes = {"bodies": len(facts.instances), "objects": len(facts.object_bodies)}
        self._types = [sight_type(view, modalities, **sizes, gripper=gripper) for view in views]
        return facts, told.renderer

    def sights(self, qpos: np.ndarray, *, jitter: ViewJitter) -> Iterator[list[np.ndarray]]:
        """Yield the sights of all views for each row of (T, nq) recorded states, as from ``StoredSights.draw``.

        Rows are rendered ahead, up to the size of the pipe. Consume all of them, or close the view. Raises the errors
        of :meth:`open`.

        """
        drawn, failed_at = 0, -1
        while True:
            try:
                for row in self._drawn(qpos[drawn:], jitter):
                    drawn += 1
                    yield row
            except _EndedError:
                if failed_at == drawn:
                    raise
                failed_at = drawn
                self._start_again()
            else:
                return

    def _drawn(self, qpos: np.ndarray, jitter: ViewJitter) -> Iterator[list[np.ndarray]]:
        numbers = np.ascontiguousarray(qpos, dtype=np.float64).tobytes()
        self._send({"sights": len(qpos), "jitter": jitter.to_json()}, numbers)
        for _ in range(len(qpos)):
            row = []
            for kind in self._types:
                answer = self._receive(max(kind.itemsize, 4 * LONGEST_REASON))
                if len(answer) != kind.itemsize:
                    raise self._refused("its process returned an image of another size")
                row.append(np.frombuffer(answer, kind)[0])
            yield row

    @property
    def row_bytes(self) -> int:
        """Size of one row's sights [byte]."""
        return sum(kind.itemsize for kind in self._types)

    @property
    def process_id(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def is_closed(self) -> bool:
        """Whether the process has ended, or was requested to end."""
        return self._process.is_closed

    def stop(self) -> None:
        """End the process from another thread. A waiting thread then gets a RecordError."""
        self._told_to_end = True
        self._process.stop()

    def close(self) -> None:
        """End the process."""
        self._process.close()

    def _ask(self, request: Mapping[str, object], data: bytes, *, most: int = 0) -> bytes | bytearray:
        self._send(request, data)
        return self._receive(max(3 * self._size**2, 4 * LONGEST_REASON, len(data), most))

    def _send(self, request: Mapping[str, object], data: bytes) -> None:
        with self._told_plainly():
            self._process.send(request, data, within_s=REQUEST_S)

    def _receive(self, most: int) -> bytes | bytearray:
        """Return an answer of at most ``most`` bytes. Raise the error that it describes, if any."""
        with self._told_plainly():
            return self._process.receive(most=most, within_s=REQUEST_S)

    @contextlib.contextmanager
    def _told_plainly(self) -> Iterator[None]:
        """Turn process errors into stored scene errors."""
        try:
            yield
        except RefusedError as problem:
            raise RecordError(str(problem)) from None
        except InvalidInputError as problem:
            raise RecordError(str(problem)) from None
        except ProcessEndedError as problem:
            raise _EndedError(str(self._refused(str(problem)))) from None
        except ProcessLateError as problem:
            raise self._refused(
                str(problem), "The machine may be too busy, or the file of the scene damaged or forged"
            ) from None
        except LimitedProcessError as problem:
            raise self._refused(str(problem)) from None

    def _at_most_twice(self, ask: Callable[[], _AnswerT]) -> _AnswerT:
        """Return an answer, from a new process if the first one ends during the request."""
        try:
            return ask()
        except _EndedError:
            self._start_again()
            return ask()

    def _start_again(self) -> None:
        """Start a new process in place of an ended one, and restore its state."""
        self._start()
        if self._files is not None:
            self._load(self._files)
        if self._prepared is not None:
            views, modalities, gripper = self._prepared[0]
            self._prepare(views, modalities, gripper=gripper)

    def _refused(self, what: str, cause: str = "The file of the scene may be damaged or forged") -> RecordError:
        self.close()
        return RecordError(
            f"stored scene: {what}. {cause}. Run the trial again to store the scene, or leave out films."
        )


class LimitedViews:
    """Views that are used again for other steps of one command. A context manager that ends their processes.

    A new process takes half a second of CPU time before its first image.
    """

    def __init__(self) -> None:
        """Prepare. Processes are started on demand."""
        self._views: list[LimitedView] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for view in self._views:
            view.close()

    def take(self, count: int, *, quality: str, size: int) -> list[LimitedView]:
        """Return views of a preset and a size [pixel]. Their earlier users must have finished.

        Raises the errors of :class:`LimitedView`.
        """
        self._views = [view for view in self._views if not view.is_closed]
        for view in self._views[:count]:
            view.set_look(quality=quality, size=size)
        while len(self._views) < count:
            self._views.append(LimitedView(quality=quality, size=size))
        return self._views[:count]


class _Drawer:
    """Process state between two requests, with a scene, its view, and the renderer of its sights."""

    def __init__(self, quality: str, size: int) -> None:
        self._quality, self._size = quality_preset(quality), size
        self._model: Any = None
        self._view: StoredView | None = None
        self._sights: StoredSights | None = None

    def answers(self, request: Mapping[str, Any], data: bytes) -> Iterator[bytes]:
        """Yield the answers to a request."""
        if "quality" in request:
            self._close()
            self._quality, self._size = quality_preset(request["quality"]), request["size"]
            yield b""
            return
        if "files" in request:
            self._close()
            self._model = load_model(_split(request["files"], data))
            yield b""
            return
        if self._model is None:
            raise RecordError("stored scene: no scene is open. Run the trial again to store it.")
        if "views" in request:
            yield self._prepare(request["views"], request["modalities"], gripper=request["gripper"])
        elif "sights" in request:
            yield from self._draw_all(np.frombuffer(data).reshape(request["sights"], -1), _jitter_of(request))
        elif "project" in request:
            pixels = self._opened_view().project(np.frombuffer(data).reshape(-1, 3), request["project"])
            yield np.ascontiguousarray(pixels, dtype=np.float64).tobytes()
        else:
            yield _pixels(self._opened_view(), np.frombuffer(data), request["camera"], _jitter_of(request))

    def _opened_view(self) -> StoredView:
        if self._view is None:
            self._view = StoredView(self._model, self._quality, width=self._size, height=self._size)
        return self._view

    def _prepare(self, views: list[dict[str, Any]], modalities: list[str], *, gripper: bool) -> bytes:
        if self._sights is not None:
            self._sights.close()
        wanted = _VIEWS.validate_json(json.dumps(views))
        self._sights = StoredSights(self._model, self._quality, wanted, modalities, gripper=gripper)
        facts = self._sights.facts()
        form = _Facts(
            facts.instances.tolist(),
            facts.object_bodies.tolist(),
            [((x, y, z), (a, b, c)) for (x, y, z), (a, b, c) in facts.boxes.tolist()],
            list(facts.focal_px),
            renderer_fingerprint(),
        )
        return _FACTS.dump_json(form)

    def _draw_all(self, rows: np.ndarray, jitter: ViewJitter) -> Iterator[bytes]:
        if self._sights is None:
            raise RecordError("stored scene: no view is prepared. Run the command again.")
        for qpos in rows:
            for sight in self._sights.draw(qpos, jitter=jitter):
                yield sight.tobytes()

    def _close(self) -> None:
        for open_one in (self._view, self._sights):
            if open_one is not None:
                open_one.close()
        self._model = self._view = self._sights = None


def draw_for_parent(quality: str, size: int | str) -> None:
    """Answer requests from standard input on standard output until the input ends. This is the main function."""
    drawer = _Drawer(quality, int(size))
    answer_requests(drawer.answers, memory_bytes=MAX_MEMORY_BYTES, cpu_s=REQUEST_CPU_S, unexpected=_unexpected)


def _unexpected(problem: Exception) -> str:
    return f"stored scene: it cannot be rendered ({type(problem).__name__}: {problem})"


def _jitter_of(request: Mapping[str, Any]) -> ViewJitter:
    return _JITTER.validate_json(json.dumps(request["jitter"]))


def _split(sizes: Mapping[str, int], data: bytes) -> dict[str, bytes]:
    """Return the files that are concatenated in some bytes."""
    files, at = dict[str, bytes](), 0
    for name, size in sizes.items():
        files[name] = data[at : at + size]
        at += size
    return files


def _pixels(view: StoredView, qpos: np.ndarray, camera: str, jitter: ViewJitter) -> bytes:
    rgb = view.draw(qpos, camera, jitter=jitter).rgb
    if rgb is None:
        raise AssertionError("colors were requested")
    return np.ascontiguousarray(rgb).tobytes()
