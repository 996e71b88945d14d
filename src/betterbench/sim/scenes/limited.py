"""Rendering of untrusted stored scenes in a separate process with memory and time limits.

A stored scene is a model in MuJoCo's binary format. MuJoCo does not validate such files, so a forged file can crash or
hang the process or exhaust the memory. The process that opens them therefore has limits for memory and time, and sends
only pixels or strings back, never Python objects.

A process can also end for other reasons, for example if a renderer crashes or the system is short of memory. Therefore,
if a process ends during a request, the request is repeated once in a new process. The scene is rejected only if the new
process also ends.
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
"""Maximum address space of the process [byte]. The software renderer alone maps 4 GB."""
REQUEST_CPU_S = 60.0
"""Maximum CPU time for opening a scene or rendering an image [s]."""
REQUEST_S = 900.0
"""Maximum wall-clock time for opening a scene or rendering an image [s], including the start of the process.

It is much longer than the maximum CPU time, because the machine may be busy.
"""

_JITTER = TypeAdapter(ViewJitter)
_MOST_FACTS_BYTES = 1 << 22

_AnswerT = TypeVar("_AnswerT")
_Number = Annotated[int, Field(ge=0, le=0xFFFF)]


@strict_form
@dataclass(frozen=True, slots=True)
class _Facts:
    """JSON form of :class:`~betterbench.sim.scenes.sights.ModelFacts`, with the properties of the renderer."""

    instances: list[_Number]
    object_bodies: list[_Number]
    boxes: list[tuple[Vector, Vector]]
    focal_px: list[Annotated[float, Field(gt=0.0)]]
    renderer: dict[str, str]


_Wanted = tuple[tuple[ViewSpec, ...], tuple[str, ...], bool]
_FACTS, _VIEWS = TypeAdapter(_Facts), TypeAdapter(list[ViewSpec])


class _EndedError(RecordError):
    """The process has ended unexpectedly."""


class LimitedView:
    """Renderer of recorded states of stored scenes, with one open scene at a time.

    The scenes are opened in a separate process, which ends when the context manager exits.
    """

    def __init__(self, *, quality: str, size: int = 256) -> None:
        """Start the process. ``size`` is the side length of the images that :meth:`draw` returns [pixel].

        Raises GraphicsError if ``MUJOCO_EGL_DEVICE_ID`` does not name a device.
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
        """Side length of the images [pixel]."""
        return self._size

    def set_look(self, *, quality: str, size: int) -> None:
        """Set the quality preset and the image size [pixel] for the next scene.

        If one of them changes, the open scene is closed.

        Raises RecordError if the process does not answer.
        """
        if (quality, size) == (self._quality, self._size):
            return
        self._quality, self._size = quality, size
        self._opened, self._prepared, self._files = None, None, None
        self._at_most_twice(lambda: self._ask({"quality": quality, "size": size}, b""))

    def open(self, files: Mapping[str, bytes]) -> None:
        """Open a stored scene, given its files (see :func:`betterbench.sim.scenes.stored.scene_files`).

        Raises:
            RecordError: If the scene cannot be opened because it is damaged or forged, or was written by a different
                version of MuJoCo.
            MissingDependencyError: If off-screen OpenGL does not work on this machine.
        """
        self._opened, self._prepared, self._files = None, None, None
        self._at_most_twice(lambda: self._load(files))
        self._files = files

    def _load(self, files: Mapping[str, bytes]) -> None:
        self._ask({"files": {name: len(data) for name, data in files.items()}}, b"".join(files.values()))

    def open_of(self, run: RunFolder, record: Record) -> None:
        """Open the stored scene of a record, unless it is already open.

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
        """Render a recorded state (nq,) with one camera, as a (size, size, 3) uint8 image.

        Raises the same errors as :meth:`open`.
        """
        numbers = np.asarray(qpos, dtype=np.float64).tobytes()
        request = {"camera": camera, "jitter": jitter.to_json()}
        pixels = self._at_most_twice(lambda: self._ask(request, numbers))
        if len(pixels) != 3 * self._size**2:
            raise self._refused("its process returned an image with a wrong size")
        return np.frombuffer(pixels, np.uint8).reshape(self._size, self._size, 3)

    def project(self, points: np.ndarray, camera: str) -> np.ndarray:
        """Project points of the world frame (n, 3) [m] to pixels (n, 2) of the last rendered view.

        Points behind the camera become NaN. Raises the same errors as :meth:`open`.
        """
        numbers = np.ascontiguousarray(points, dtype=np.float64).tobytes()
        found = self._ask({"project": camera}, numbers)
        if 3 * len(found) != 2 * len(numbers):
            raise self._refused("its process returned a wrong number of points")
        return np.frombuffer(found).reshape(-1, 2)

    def prepare(
        self, views: Sequence[ViewSpec], modalities: Sequence[str], *, gripper: bool = False
    ) -> tuple[ModelFacts, dict[str, str]]:
        """Prepare to render views of the open scene.

        Return the properties that all views share, and the properties of the renderer. ``gripper`` has the same meaning
        as in :class:`~betterbench.sim.scenes.sights.Sights`. If the last preparation for this scene was the same, it is
        reused. Raises the same errors as :meth:`open`.
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
            raise self._refused("its process returned different views than requested")
        sizes = {"bodies": len(facts.instances), "objects": len(facts.object_bodies)}
        self._types = [sight_type(view, modalities, **sizes, gripper=gripper) for view in views]
        return facts, told.renderer

    def sights(self, qpos: np.ndarray, *, jitter: ViewJitter) -> Iterator[list[np.ndarray]]:
        """Yield the rendered views of each row of recorded states (T, nq), as ``StoredSights.draw`` returns them.

        The process renders rows ahead of the caller, as many as fit into the pipe. The caller must consume all rows or
        close the view. Raises the same errors as :meth:`open`.
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
                    raise self._refused("its process returned an image with a wrong size")
                row.append(np.frombuffer(answer, kind)[0])
            yield row

    @property
    def row_bytes(self) -> int:
        """Size of all views of one recorded state [byte]."""
        return sum(kind.itemsize for kind in self._types)

    @property
    def process_id(self) -> int:
        """Process id (PID)."""
        return self._process.pid

    @property
    def is_closed(self) -> bool:
        """Whether the process has ended or has been asked to end."""
        return self._process.is_closed

    def stop(self) -> None:
        """End the process.

        This method may be called from another thread. If a thread is waiting for an answer, RecordError is raised in
        that thread.
        """
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
        """Receive an answer of at most ``most`` bytes. If the answer reports an error, raise that error."""
        with self._told_plainly():
            return self._process.receive(most=most, within_s=REQUEST_S)

    @contextlib.contextmanager
    def _told_plainly(self) -> Iterator[None]:
        """Convert errors of the rendering process into errors about the stored scene."""
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
                str(problem), "The machine may be too busy, or the scene file may be damaged or forged"
            ) from None
        except LimitedProcessError as problem:
            raise self._refused(str(problem)) from None

    def _at_most_twice(self, ask: Callable[[], _AnswerT]) -> _AnswerT:
        """Return the answer to a request.

        If the process ends during the request, repeat the request once in a new process.
        """
        try:
            return ask()
        except _EndedError:
            self._start_again()
            return ask()

    def _start_again(self) -> None:
        """Start a new process to replace the one that ended, and open the same scene and views in it."""
        self._start()
        if self._files is not None:
            self._load(self._files)
        if self._prepared is not None:
            views, modalities, gripper = self._prepared[0]
            self._prepare(views, modalities, gripper=gripper)

    def _refused(self, what: str, cause: str = "The scene file may be damaged or forged") -> RecordError:
        self.close()
        return RecordError(
            f"stored scene: {what}. {cause}. Run the trial again to store the scene, or run the command without films."
        )


class LimitedViews:
    """Pool of processes that render stored scenes.

    The processes stay open until the pool is closed, so that later steps of a command can use them again.

    This saves the half second of CPU time that a new process needs before its first image.
    """

    def __init__(self) -> None:
        """Create an empty pool. Processes are started when they are needed."""
        self._views: list[LimitedView] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for view in self._views:
            view.close()

    def take(self, count: int, *, quality: str, size: int) -> list[LimitedView]:
        """Return ``count`` views with the given preset and size [pixel].

        The caller must no longer use views from earlier calls, because they may be returned again. Raises the same
        errors as :class:`LimitedView`.
        """
        self._views = [view for view in self._views if not view.is_closed]
        for view in self._views[:count]:
            view.set_look(quality=quality, size=size)
        while len(self._views) < count:
            self._views.append(LimitedView(quality=quality, size=size))
        return self._views[:count]


class _Drawer:
    """State of the rendering process between two requests: the open scene and its renderers."""

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
            raise RecordError("stored scene: no scene is open. Run the trial again to store its scene.")
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
    """Run the rendering process: read requests from standard input, and write the answers to standard output.

    The function returns when the input ends.
    """
    drawer = _Drawer(quality, int(size))
    answer_requests(drawer.answers, memory_bytes=MAX_MEMORY_BYTES, cpu_s=REQUEST_CPU_S, unexpected=_unexpected)


def _unexpected(problem: Exception) -> str:
    return f"stored scene: it cannot be rendered ({type(problem).__name__}: {problem})"


def _jitter_of(request: Mapping[str, Any]) -> ViewJitter:
    return _JITTER.validate_json(json.dumps(request["jitter"]))


def _split(sizes: Mapping[str, int], data: bytes) -> dict[str, bytes]:
    """Split the concatenated contents of several files, given the size of each file."""
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
