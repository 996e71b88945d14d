"""Stored scenes of strangers: MuJoCo's binary models are opened and drawn in a limited process of their own.

The reader of such files trusts them: a forged one can crash it, hang it or fill the memory. The process has limits for
memory and time. What comes back from it is pixels or a text, and never an object.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import select
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np
from pydantic import TypeAdapter

from betterbench.errors import BetterError, MissingDependencyError, RecordError, one_line
from betterbench.geometry import Pose
from betterbench.scenes.cameras import CameraMatrices
from betterbench.scenes.stage import quality_preset
from betterbench.scenes.stored import Sight, StoredView, load_model
from betterbench.state import ViewJitter

MAX_MEMORY_BYTES = 16 * 1024**3
"""Address space of the process; the software renderer maps 4 GB of it."""
REQUEST_S = 60.0
"""Longest time for a scene to be opened, or an image to be drawn [s]; the first one includes the start."""

_PIXELS, _BROKEN, _MISSING = range(3)
_QUESTION = struct.Struct("!QQ")
_HEADER = struct.Struct("!BQ")
_JITTER = TypeAdapter(ViewJitter)
_LONGEST_REASON = 2000
_BLOCK = 1 << 16
_MOST_GROUPS = 1000


class LimitedView:
    """Draws recorded states of stored scenes, one scene at a time. A context manager, which ends the process."""

    def __init__(self, *, quality: str, size: int) -> None:
        """Start the process; ``size`` is the side of the images [pixel]."""
        self._size = size
        paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path)
        self._process = subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-m", __name__, quality, str(size)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=tempfile.gettempdir(),  # where MuJoCo may write its log
            env={**os.environ, "PYTHONPATH": paths},
        )
        os.set_blocking(_opened(self._process.stdin).fileno(), False)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def open(self, files: Mapping[str, bytes]) -> None:
        """Open a stored scene, from what :func:`betterbench.scenes.stored.scene_files` returned.

        Raises:
            RecordError: If it cannot be opened: it is damaged or forged, or another version of MuJoCo wrote it.
            MissingDependencyError: If no off-screen OpenGL works here.
        """
        self._ask({"files": {name: len(data) for name, data in files.items()}}, b"".join(files.values()))

    def draw(self, qpos: np.ndarray, camera: str, *, jitter: ViewJitter) -> np.ndarray:
        """Return the view of one recorded state, (nq,), as (size, size, 3) uint8; raises what :meth:`open` raises."""
        numbers = np.asarray(qpos, dtype=np.float64).tobytes()
        pixels = self._ask({"camera": camera, "jitter": jitter.to_json()}, numbers)
        if len(pixels) != 3 * self._size**2:
            raise self._refused("it gave an image of another size")
        return np.frombuffer(pixels, np.uint8).reshape(self._size, self._size, 3)

    def see(self, qpos: np.ndarray, camera: str, groups: Sequence[Sequence[str]], *, jitter: ViewJitter) -> Sight:
        """Return the view of one recorded state with what it shows of each group of bodies; see ``StoredView.see``.

        Raises what :meth:`open` raises.
        """
        numbers = np.asarray(qpos, dtype=np.float64).tobytes()
        request = {"see": camera, "jitter": jitter.to_json(), "groups": [list(group) for group in groups]}
        answer, count, size = self._ask(request, numbers), len(groups), self._size
        if len(answer) != _sight_bytes(size, count):
            raise self._refused("it gave an image of another size")
        rgb = np.frombuffer(answer, np.uint8, 3 * size**2).reshape(size, size, 3)
        seen = np.frombuffer(answer, np.int16, size**2, offset=3 * size**2).reshape(size, size)
        alone = np.frombuffer(answer, np.int32, count, offset=5 * size**2)
        x, y, z, qw, qx, qy, qz, focal = np.frombuffer(answer, np.float64, 8, offset=5 * size**2 + 4 * count).tolist()
        half = 0.5 * (size - 1)
        K = np.array([[focal, 0.0, half], [0.0, focal, half], [0.0, 0.0, 1.0]])
        camera_at = CameraMatrices(K, Pose((x, y, z), (qw, qx, qy, qz)), size, size)
        return Sight(rgb, seen, tuple(alone.tolist()), camera_at)

    def project(self, points: np.ndarray, camera: str) -> np.ndarray:
        """Return the pixels (n, 2) of world points (n, 3) [m] in the view drawn last; NaN behind the camera.

        Raises what :meth:`open` raises.
        """
        numbers = np.ascontiguousarray(points, dtype=np.float64).tobytes()
        found = self._ask({"project": camera}, numbers)
        if 3 * len(found) != 2 * len(numbers):
            raise self._refused("it gave another number of points")
        return np.frombuffer(found).reshape(-1, 2)

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()

    def _ask(self, request: Mapping[str, object], data: bytes) -> bytes:
        end = time.monotonic() + REQUEST_S
        text = json.dumps(request).encode()
        try:
            self._write(_QUESTION.pack(len(text), len(data)) + text + data, end)
            kind, size = _HEADER.unpack(self._read(_HEADER.size, end))
            if size > max(_sight_bytes(self._size, _MOST_GROUPS), 4 * _LONGEST_REASON, len(data)):
                raise self._refused("it answered too much")
            answer = self._read(size, end)
        except (OSError, EOFError):
            raise self._refused("its process crashed, or took too much memory") from None
        if kind == _PIXELS:
            return answer
        reason = one_line(answer.decode("utf-8", "replace"), most=_LONGEST_REASON)
        raise (MissingDependencyError if kind == _MISSING else RecordError)(reason)

    def _write(self, data: bytes, end: float) -> None:
        pipe, left = _opened(self._process.stdin), memoryview(data)
        while left:
            self._check_time(select.select([], [pipe], [], max(0.0, end - time.monotonic()))[1])
            left = left[os.write(pipe.fileno(), left[:_BLOCK]) :]

    def _check_time(self, ready: Sequence[object]) -> None:
        if not ready:
            raise self._refused(f"nothing came of it within {REQUEST_S:g} s")

    def _read(self, count: int, end: float) -> bytes:
        pipe, blocks = _opened(self._process.stdout), []
        while count:
            self._check_time(select.select([pipe], [], [], max(0.0, end - time.monotonic()))[0])
            block = os.read(pipe.fileno(), count)
            if not block:
                raise EOFError
            blocks.append(block)
            count -= len(block)
        return b"".join(blocks)

    def _refused(self, what: str) -> RecordError:
        self.close()
        return RecordError(
            f"stored scene: {what}. Its file is damaged or forged; run the trial again to store it, or leave films out."
        )


def _opened(pipe: object) -> BinaryIO:
    if pipe is None:
        raise EOFError
    return pipe  # type: ignore[return-value]


def draw_for_parent(quality: str, size: int) -> None:
    """Answer on standard output what comes on standard input, until that ends; the main function of the process."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what else is printed must not stand among the answers
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    view: StoredView | None = None
    asked = sys.stdin.buffer
    while header := asked.read(_QUESTION.size):
        text, data = (asked.read(size) for size in _QUESTION.unpack(header))
        request: dict[str, Any] = json.loads(text)
        used = time.process_time()
        resource.setrlimit(resource.RLIMIT_CPU, (int(used + REQUEST_S) + 1, resource.RLIM_INFINITY))
        try:
            if "files" in request:
                if view is not None:
                    view.close()
                model = load_model(_split(request["files"], data))
                view = StoredView(model, quality_preset(quality), width=size, height=size)
                kind, answer = _PIXELS, b""
            elif view is None:
                kind, answer = _BROKEN, b"stored scene: none is open. Run the trial again to store it."
            elif "project" in request:
                pixels = view.project(np.frombuffer(data).reshape(-1, 3), request["project"])
                kind, answer = _PIXELS, np.ascontiguousarray(pixels, dtype=np.float64).tobytes()
            elif "see" in request:
                kind, answer = _PIXELS, _sight(view, np.frombuffer(data), request)
            else:
                jitter = _JITTER.validate_json(json.dumps(request["jitter"]))
                kind, answer = _PIXELS, _pixels(view, np.frombuffer(data), request["camera"], jitter)
        except MissingDependencyError as problem:
            kind, answer = _MISSING, str(problem).encode()
        except BetterError as problem:
            kind, answer = _BROKEN, str(problem).encode()
        except Exception as problem:  # noqa: BLE001 - whatever a forged scene breaks is told to the parent
            kind, answer = _BROKEN, f"stored scene: it cannot be drawn ({type(problem).__name__}: {problem})".encode()
        answer = answer if kind == _PIXELS else answer[:_LONGEST_REASON]
        answers.write(_HEADER.pack(kind, len(answer)) + answer)
        answers.flush()


def _split(sizes: Mapping[str, int], data: bytes) -> dict[str, bytes]:
    """Return the files that stand one after the other in some bytes."""
    files, at = dict[str, bytes](), 0
    for name, size in sizes.items():
        files[name] = data[at : at + size]
        at += size
    return files


def _pixels(view: StoredView, qpos: np.ndarray, camera: str, jitter: ViewJitter) -> bytes:
    rgb = view.draw(qpos, camera, jitter=jitter).rgb
    if rgb is None:
        raise AssertionError("colors were asked for")
    return np.ascontiguousarray(rgb).tobytes()


def _sight(view: StoredView, qpos: np.ndarray, request: Mapping[str, Any]) -> bytes:
    jitter = _JITTER.validate_json(json.dumps(request["jitter"]))
    sight = view.see(qpos, request["see"], request["groups"], jitter=jitter)
    pose = sight.camera.T_world_camera
    placed = np.array([*pose.position, *pose.quaternion, sight.camera.K[0, 0]], np.float64)
    parts = (
        np.ascontiguousarray(sight.rgb),
        np.ascontiguousarray(sight.groups),
        np.array(sight.alone, np.int32),
        placed,
    )
    return b"".join(part.tobytes() for part in parts)


def _sight_bytes(size: int, groups: int) -> int:
    """Return the length of an answer with colors, groups, the pixels of each group alone, and the camera."""
    return 5 * size**2 + 4 * groups + 8 * 8


if __name__ == "__main__":
    draw_for_parent(sys.argv[1], int(sys.argv[2]))
