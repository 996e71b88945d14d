"""Opening and rendering of untrusted stored scenes (MuJoCo's binary models) in a separate process with limits.

MuJoCo's reader trusts such files: a forged file can crash the reader, make it hang or fill the memory. The process
therefore has limits for memory and time, and returns only pixels or a text, never an object.

A process can also end for other reasons: a renderer crashes, or the system is short of memory. The request during which
a process ended is therefore repeated once in a new process; the request is refused only if the new process ends too.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import resource
import select
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, BinaryIO, Self, TypeVar

import numpy as np
from pydantic import Field, TypeAdapter

from betterbench.errors import BetterError, MissingDependencyError, RecordError, one_line
from betterbench.geometry import Vector
from betterbench.interface.state import ViewJitter
from betterbench.json_form import read_form, strict_form
from betterbench.records import Record, RunFolder
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.graphics import next_device_variables
from betterbench.sim.scenes.gl_context import renderer_fingerprint
from betterbench.sim.scenes.sights import ModelFacts, StoredSights, sight_type
from betterbench.sim.scenes.stage import quality_preset
from betterbench.sim.scenes.stored import StoredView, load_model
from betterbench.tasks import TrialId

MAX_MEMORY_BYTES = 16 * 1024**3
"""Address space of the process [byte]; the software renderer maps 4 GB of it."""
REQUEST_CPU_S = 60.0
"""Maximum processor time to open a scene or render an image [s]."""
REQUEST_S = 900.0
"""Maximum wall-clock time of the same [s], including the start of the process: much more, for busy machines."""

_PIXELS, _BROKEN, _MISSING = range(3)
_QUESTION = struct.Struct("!QQ")
_HEADER = struct.Struct("!BQ")
_JITTER = TypeAdapter(ViewJitter)
_LONGEST_REASON = 2000
_SLICE_S = 10.0
"""Longest slice of a wait [s]."""
_ENDS_WITHIN_S = 5.0
"""Time for a process to end after it has closed its pipe [s]."""
_BLOCK = 1 << 16
_PIPE_BYTES = 1 << 20
"""Size of the pipe for images, the largest that Linux allows without privileges [byte]."""
_MOST_FACTS_BYTES = 1 << 22

_AnswerT = TypeVar("_AnswerT")
_Number = Annotated[int, Field(ge=0, le=0xFFFF)]


@strict_form
@dataclass(frozen=True, slots=True)
class _Facts:
    """The JSON form of :class:`~betterbench.sim.scenes.sights.ModelFacts`, and the renderer of the process."""

    instances: list[_Number]
    object_bodies: list[_Number]
    boxes: list[tuple[Vector, Vector]]
    focal_px: list[Annotated[float, Field(gt=0.0)]]
    renderer: dict[str, str]


_Wanted = tuple[tuple[ViewSpec, ...], tuple[str, ...], bool]
_FACTS, _VIEWS = TypeAdapter(_Facts), TypeAdapter(list[ViewSpec])


class _EndedError(RecordError):
    """The process has ended without a request to end."""


@dataclass(slots=True)
class _Patience:
    """Remaining time to wait for a process [s].

    Waiting is divided into slices, each counted with at most its nominal duration, because Ctrl-Z can stop both
    processes for any time while the clock continues.
    """

    left_s: float

    def lasts_until_ready(self, pipe: BinaryIO, *, to_write: bool) -> bool:
        """Wait until a pipe can be written or read; False if no time is left."""
        pipes: list[BinaryIO] = [pipe]
        while True:
            slice_s, began = min(_SLICE_S, max(0.0, self.left_s)), time.monotonic()
            ready = select.select([] if to_write else pipes, pipes if to_write else [], [], slice_s)
            self.left_s -= min(slice_s, time.monotonic() - began)
            if ready[0] or ready[1]:
                return True
            if self.left_s <= 0.0:
                return False


class LimitedView:
    """Renderer of recorded states of stored scenes, one scene at a time. A context manager, which ends the process."""

    def __init__(self, *, quality: str, size: int = 256) -> None:
        """Start the process; ``size`` is the side of the images of :meth:`draw` [pixel].

        Raises GraphicsError if ``MUJOCO_EGL_DEVICE_ID`` names no device.
        """
        self._quality, self._size = quality, size
        self._told_to_end = self._is_closed = False
        self._types: list[np.dtype[np.void]] = []
        self._opened: tuple[str, str] | None = None
        self._files: Mapping[str, bytes] | None = None
        self._prepared: tuple[_Wanted, tuple[ModelFacts, dict[str, str]]] | None = None
        self._start()

    def _start(self) -> None:
        paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path)
        self._process = subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-m", __name__, self._quality, str(self._size)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=tempfile.gettempdir(),  # a folder where MuJoCo may write its log
            env={**os.environ, "PYTHONPATH": paths, **next_device_variables()},
        )
        os.set_blocking(_opened(self._process.stdin).fileno(), False)
        with contextlib.suppress(OSError):  # the size may exceed the user's limit
            fcntl.fcntl(_opened(self._process.stdout), fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        self._is_closed = False
        if self._told_to_end:  # another thread has called stop() in the meantime
            self._process.kill()

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

    def open(self, files: Mapping[str, bytes]) -> None:
        """Open a stored scene from the result of :func:`betterbench.sim.scenes.stored.scene_files`.

        Raises:
            RecordError: If it cannot be opened: it is damaged or forged, or was written by another version of MuJoCo.
            MissingDependencyError: If no off-screen OpenGL works here.
        """
        self._opened, self._prepared, self._files = None, None, None
        self._at_most_twice(lambda: self._load(files))
        self._files = files

    def _load(self, files: Mapping[str, bytes]) -> None:
        self._ask({"files": {name: len(data) for name, data in files.items()}}, b"".join(files.values()))

    def open_of(self, run: RunFolder, record: Record) -> None:
        """Open the stored scene of a record of a run, unless it is open; raises the errors of :meth:`open`."""
        m = record.metadata
        digest = run.scene_digest(TrialId(m.task, m.condition, m.seed))
        scene = (m.scene_hash, digest or str(run.path))
        if scene != self._opened:
            self.open(run.load_scene(m.scene_hash, digest=digest))
            self._opened = scene

    def draw(self, qpos: np.ndarray, camera: str, *, jitter: ViewJitter) -> np.ndarray:
        """Return the view of one recorded state, (nq,), as (size, size, 3) uint8; raises the errors of :meth:`open`."""
        numbers = np.asarray(qpos, dtype=np.float64).tobytes()
        request = {"camera": camera, "jitter": jitter.to_json()}
        pixels = self._at_most_twice(lambda: self._ask(request, numbers))
        if len(pixels) != 3 * self._size**2:
            raise self._refused("its process returned an image of another size")
        return np.frombuffer(pixels, np.uint8).reshape(self._size, self._size, 3)

    def project(self, points: np.ndarray, camera: str) -> np.ndarray:
        """Return the pixels (n, 2) of world points (n, 3) [m] in the last view; NaN behind the camera.

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
        """Prepare to render sights of the open scene; return their common properties, and OpenGL's fingerprint.

        ``gripper`` is that of :class:`~betterbench.sim.scenes.sights.Sights`. The last preparation for the same scene
        is reused. Raises the errors of :meth:`open`.
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

        Rows are rendered ahead, up to the size of the pipe. Consume all sights, or close the view. Raises the errors of
        :meth:`open`.
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
                answer = self._receive(max(kind.itemsize, 4 * _LONGEST_REASON))
                if len(answer) != kind.itemsize:
                    raise self._refused("its process returned an image of another size")
                row.append(np.frombuffer(answer, kind)[0])
            yield row

    @property
    def row_bytes(self) -> int:
        """Size of the sights of one row [byte]."""
        return sum(kind.itemsize for kind in self._types)

    @property
    def process_id(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def is_closed(self) -> bool:
        """Whether the process has ended, or was asked to end."""
        return self._is_closed or self._told_to_end or self._process.poll() is not None

    def stop(self) -> None:
        """End the process from another thread; a waiting thread then gets a RecordError."""
        self._told_to_end = True
        self._process.kill()

    def close(self) -> None:
        """End the process."""
        self._is_closed = True
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()

    def _ask(self, request: Mapping[str, object], data: bytes, *, most: int = 0) -> bytes | bytearray:
        self._send(request, data)
        return self._receive(max(3 * self._size**2, 4 * _LONGEST_REASON, len(data), most))

    def _send(self, request: Mapping[str, object], data: bytes) -> None:
        text = json.dumps(request).encode()
        try:
            self._write(_QUESTION.pack(len(text), len(data)) + text + data)
        except (OSError, EOFError):
            raise self._ended() from None

    def _receive(self, most: int) -> bytes | bytearray:
        """Return an answer of at most ``most`` bytes; raise the error that it describes, if any."""
        try:
            patience = _Patience(REQUEST_S)
            kind, size = _HEADER.unpack(self._read(_HEADER.size, patience))
            if size > most:
                raise self._refused("its answer is too long")
            answer = self._read(size, patience)
        except (OSError, EOFError):
            raise self._ended() from None
        if kind == _PIXELS:
            return answer
        reason = one_line(answer.decode("utf-8", "replace"), most=_LONGEST_REASON)
        raise (MissingDependencyError if kind == _MISSING else RecordError)(reason)

    def _write(self, data: bytes) -> None:
        pipe, left, patience = _opened(self._process.stdin), memoryview(data), _Patience(REQUEST_S)
        while left:
            self._wait(patience, to_write=True)
            left = left[os.write(pipe.fileno(), left[:_BLOCK]) :]

    def _wait(self, patience: _Patience, *, to_write: bool) -> None:
        """Wait until the pipe can be written or read."""
        pipe = _opened(self._process.stdin if to_write else self._process.stdout)
        if not patience.lasts_until_ready(pipe, to_write=to_write):
            raise self._refused(
                f"its process did not answer within {REQUEST_S:g} s", "The machine is too busy, or the file"
            )

    def _read(self, count: int, patience: _Patience) -> bytearray:
        pipe, answer = _opened(self._process.stdout), bytearray(count)
        left = memoryview(answer)
        while left:
            self._wait(patience, to_write=False)
            got = os.readv(pipe.fileno(), [left])
            if not got:
                raise EOFError
            left = left[got:]
        return answer

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

    def _ended(self) -> RecordError:
        """Return the error for an ended process: it can be restarted, unless it was asked to end."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_ENDS_WITHIN_S)
        problem = self._refused(_end_in_words(self._process.returncode))
        return problem if self._told_to_end else _EndedError(str(problem))

    def _refused(self, what: str, whose: str = "Its file") -> RecordError:
        self.close()
        return RecordError(
            f"stored scene: {what}. {whose} is damaged or forged; run the trial again to store it, or leave films out."
        )


def _end_in_words(status: int | None) -> str:
    """Return a description of a process's exit status; a negative one is a signal."""
    if status is None or status >= 0:
        return f"its process ended (exit status {status})"
    if -status == signal.SIGPROF:
        return f"its process took more than {REQUEST_CPU_S:g} s of processor time"
    if -status == signal.SIGKILL:
        return "its process was killed, perhaps because memory ran out"
    return f"its process crashed ({signal.Signals(-status).name})"


def _opened(pipe: object) -> BinaryIO:
    if pipe is None:
        raise EOFError
    return pipe  # type: ignore[return-value]


class _Drawer:
    """State of the process between two requests: a scene, its view, and the renderer of its sights."""

    def __init__(self, quality: str, size: int) -> None:
        self._quality, self._size = quality_preset(quality), size
        self._model: Any = None
        self._view: StoredView | None = None
        self._sights: StoredSights | None = None

    def answers(self, request: Mapping[str, Any], data: bytes) -> Iterator[bytes]:
        """Yield the answers to a request."""
        if "files" in request:
            self._close()
            self._model = load_model(_split(request["files"], data))
            yield b""
            return
        if self._model is None:
            raise RecordError("stored scene: none is open. Run the trial again to store it.")
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


def draw_for_parent(quality: str, size: int) -> None:
    """Answer requests from standard input on standard output until the input ends: the main function."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # other output must not mix with the answers
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGPROF, signal.SIG_DFL)  # independent of the parent's handler
    drawer = _Drawer(quality, size)
    asked = sys.stdin.buffer
    while header := asked.read(_QUESTION.size):
        text, data = (asked.read(size) for size in _QUESTION.unpack(header))
        reason, kind = "", _BROKEN
        try:
            _limit_time()
            for answer in drawer.answers(json.loads(text), data):
                answers.write(_HEADER.pack(_PIXELS, len(answer)))
                answers.write(answer)
                answers.flush()
                _limit_time()
        except MissingDependencyError as problem:
            reason, kind = str(problem), _MISSING
        except BetterError as problem:
            reason = str(problem)
        except Exception as problem:  # noqa: BLE001 - whatever a forged scene breaks is told to the parent
            reason = f"stored scene: it cannot be rendered ({type(problem).__name__}: {problem})"
        if reason:
            said = reason.encode()[:_LONGEST_REASON]
            answers.write(_HEADER.pack(kind, len(said)) + said)
            answers.flush()


def _limit_time() -> None:
    """Set the processor time limit for the next answer; SIGPROF ends this process when it is used up.

    RLIMIT_CPU, a limit on the total processor time, cannot be advanced exactly: the kernel compares it with ticks,
    which for a rendering process are up to 6 % more than :func:`time.process_time`, a minute after a quarter of an
    hour.
    """
    signal.setitimer(signal.ITIMER_PROF, REQUEST_CPU_S)


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


if __name__ == "__main__":
    draw_for_parent(sys.argv[1], int(sys.argv[2]))
