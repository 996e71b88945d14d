"""Installation and running of other benchmarks whose speed is compared, and the rule for when their times are trusted.

The times of such a peer can be wrong: robosuite was once ten times faster because it rendered nothing (README, "When
the result of a peer is accepted"). Therefore, a time is trusted only if every image shows something new, and if two
separately started processes agree.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import selectors
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import platformdirs

from betterbench.errors import MissingDependencyError
from betterbench.sim.worlds import world_named

LOCKS = Path(__file__).resolve().parents[1] / "requirements"

INSTALL_LIMIT_S = 1800.0

ANSWER_LIMIT_S = 600.0
"""Longest wait for one answer [s]. An environment with cameras is built in 2 to 10 s, but at first numba compiles."""

ANSWER_LIMIT_BYTES = 1_000_000

END_LIMIT_S = 10.0
"""Longest wait for a process to end after it was terminated [s]."""

AGREEMENT = 1.3
"""Largest ratio of the medians of two blocks that agree."""

MOST_BLOCKS = 3
"""Number of blocks after which a measurement is abandoned if no two of them agree."""

FAULTS = {"flat": "was of one color", "noise": "was noise"}
"""Values that replace a digest, and their descriptions."""

_COMPLETE = "complete"


class PeerUnavailableError(Exception):
    """The peer cannot be installed or does not follow the protocol; the message gives the reason."""


@dataclass(frozen=True, slots=True)
class PeerPackage:
    """Name and script of a peer.

    Its environment contains the packages in ``requirements/peer-NAME.lock``, with the name in lower case.

    Attributes:
        name: Name in the table.
        script: Script that answers as :mod:`peer_loop` says.
    """

    name: str
    script: Path

    @property
    def lock(self) -> Path:
        """Locked requirements of its environment."""
        return LOCKS / f"peer-{self.name.lower()}.lock"

    @property
    def folder(self) -> Path:
        """Folder of the environment in the user's cache directory; it differs for each lock file."""
        digest = hashlib.sha256(self.lock.read_bytes()).hexdigest()[:16]
        return platformdirs.user_cache_path("betterbench") / "peers" / f"{self.name.lower()}-{digest}"


ROBOSUITE = PeerPackage("robosuite", Path(__file__).with_name("robosuite_peer.py"))
LIBERO = PeerPackage("LIBERO", Path(__file__).with_name("libero_peer.py"))


def installed(package: PeerPackage) -> Path:
    """Return the Python of a peer's environment, which is built on first use in the user's cache directory.

    Args:
        package: The peer.

    Raises:
        PeerUnavailableError: If it cannot be built.
    """
    if package is LIBERO:
        # LIBERO's environment is shared with the world, so it is built only once.
        try:
            return world_named("libero").installation.install() / "bin" / "python"
        except MissingDependencyError as error:
            raise PeerUnavailableError(str(error)) from error
    folder = package.folder
    python = folder / "bin" / "python"
    if (folder / _COMPLETE).exists():
        return python
    print(f"Building the environment of {package.name} in {folder}", file=sys.stderr)
    shutil.rmtree(folder, ignore_errors=True)
    install = ["install", "--quiet", "--require-hashes", "--no-deps", "--requirement", str(package.lock)]
    uv = shutil.which("uv") or shutil.which("uv", path=str(Path(sys.executable).parent))
    if uv is not None:
        _run([uv, "venv", "--quiet", "--python", sys.executable, str(folder)])
        _run([uv, "pip", *install, "--python", str(python)])
    else:
        _run([sys.executable, "-m", "venv", str(folder)])
        _run([str(python), "-m", "pip", *install])
    (folder / _COMPLETE).touch()
    return python


def _run(command: list[str]) -> None:
    """Run a command.

    Raises:
        PeerUnavailableError: If it fails, with the last line of its output.
    """
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_LIMIT_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise PeerUnavailableError(f"{Path(command[0]).name}: {error}") from error
    if done.returncode != 0:
        said = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()
        raise PeerUnavailableError(f"{Path(command[0]).name} {command[1]} failed: {said[-1][:160]}")


class Peer:
    """A running process that steps one environment of a peer on request. Use it as a context manager.

    Attributes:
        versions: Versions of the packages that influence its speed; set when an environment has been made.
    """

    def __init__(self, script: Path, *, python: Path, answer_limit_s: float = ANSWER_LIMIT_S) -> None:
        """Start the process.

        Args:
            script: Script that answers as :mod:`peer_loop` says.
            python: Python to run it with.
            answer_limit_s: Longest wait for one answer [s].

        Raises:
            PeerUnavailableError: If it cannot be started.
        """
        self.versions: dict[str, str] = {}
        self._answer_limit_s = answer_limit_s
        self._received = b""
        self._measured = 0
        self._seen: set[str] = set()
        self._faults: Counter[str] = Counter()
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        # Its own libraries only, and the same GL back end and number of threads as this process.
        environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
        try:
            self._process = subprocess.Popen(
                [str(python), str(script)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._said,
                env=environment,
            )
        except OSError as error:
            self._said.close()
            raise PeerUnavailableError(f"{script.name} cannot be started: {error}") from error

    def __enter__(self) -> Self:
        """Return the peer itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the process."""
        self._process.terminate()
        self._wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):  # an unsent request to a process that has ended
                    pipe.close()
        self._said.close()

    def make(self, *, everything: bool) -> None:
        """Build the environment, with depth and instance masks if ``everything`` is true.

        Raises:
            PeerUnavailableError: If that fails.
        """
        request = {"do": "make", "all": everything}
        answer = self._ask(request)
        self._seconds(answer, request, count=1)
        versions = answer.get("versions")
        if not isinstance(versions, dict):
            raise self._strange(answer, request)
        self.versions = {str(k): str(v) for k, v in versions.items()}
        self.take_doubt()  # the first images are not part of a measurement

    def step(self, count: int) -> float:
        """Take control steps and return the seconds they took together.

        Raises:
            PeerUnavailableError: If that fails.
        """
        request = {"do": "step", "count": count}
        return sum(self._seconds(self._ask(request), request, count=count))

    def reset(self) -> float:
        """Reset to a new layout and return the seconds it took.

        Raises:
            PeerUnavailableError: If that fails.
        """
        request = {"do": "reset"}
        return sum(self._seconds(self._ask(request), request, count=1))

    def take_doubt(self) -> str:
        """Return why the times since the last call are not trusted, or an empty text, and reset the counts."""
        measured, self._measured = self._measured, 0
        faults, self._faults = self._faults, Counter()
        return ", ".join(f"{fault} in {count} of {measured} measurements" for fault, count in sorted(faults.items()))

    def _seconds(self, answer: dict[str, Any], request: dict[str, Any], *, count: int) -> list[float]:
        """Return the seconds of an answer and look at its images.

        Raises:
            PeerUnavailableError: If the answer does not follow the protocol.
        """
        seconds, images = answer.get("seconds"), answer.get("images")
        if not (isinstance(seconds, list) and isinstance(images, list) and len(seconds) == len(images) == count):
            raise self._strange(answer, request)
        if not all(isinstance(s, float) and math.isfinite(s) and s > 0.0 for s in seconds):
            raise self._strange(answer, request)
        if not all(isinstance(i, dict) and i for i in images):
            raise self._strange(answer, request)
        for of_step in images:
            self._measured += 1
            self._look_at({str(name): str(digest) for name, digest in of_step.items()})
        return [float(s) for s in seconds]

    def _look_at(self, digests: dict[str, str]) -> None:
        """Count what is wrong with the images of one measurement."""
        for name, digest in digests.items():
            if digest in FAULTS:
                self._faults[f"{name} {FAULTS[digest]}"] += 1
            # Two cameras never see the same image, and while the robot moves, no camera sees the same image twice.
            elif digest in self._seen or list(digests.values()).count(digest) > 1:
                self._faults[f"{name} did not change"] += 1
        self._seen.update(digests.values())

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        pipe = self._process.stdin
        if pipe is None:
            raise AssertionError("the process was started with pipes")
        try:
            pipe.write(json.dumps(request).encode() + b"\n")
            pipe.flush()
        except BrokenPipeError:
            raise self._ended(request) from None
        line = self._line(request)
        try:
            answer = json.loads(line)
        except ValueError:
            answer = None
        if not isinstance(answer, dict):
            raise self._strange(line.decode(errors="backslashreplace"), request)
        return answer

    def _line(self, request: dict[str, Any]) -> bytes:
        """Return the next line of the process.

        Raises:
            PeerUnavailableError: If there is no line in time.
        """
        pipe = self._process.stdout
        if pipe is None:
            raise AssertionError("the process was started with pipes")
        deadline = time.monotonic() + self._answer_limit_s
        with selectors.DefaultSelector() as selector:
            selector.register(pipe, selectors.EVENT_READ)
            while b"\n" not in self._received:
                if len(self._received) > ANSWER_LIMIT_BYTES:
                    raise self._strange(self._received[:80].decode(errors="backslashreplace"), request)
                if not selector.select(max(0.0, deadline - time.monotonic())):
                    raise PeerUnavailableError(f"no answer to {request['do']!r} within {self._answer_limit_s:g} s")
                chunk = os.read(pipe.fileno(), 65536)
                if not chunk:
                    raise self._ended(request)
                self._received += chunk
        line, _, self._received = self._received.partition(b"\n")
        return line

    def _ended(self, request: dict[str, Any]) -> PeerUnavailableError:
        status = self._wait()
        self._said.seek(0)
        said = self._said.read().decode(errors="backslashreplace").strip().splitlines()
        last = f": {said[-1][:160]}" if said else ""
        return PeerUnavailableError(f"its process has ended with status {status} on {request['do']!r}{last}")

    @staticmethod
    def _strange(answer: object, request: dict[str, Any]) -> PeerUnavailableError:
        return PeerUnavailableError(f"no answer to {request['do']!r} as agreed, but {str(answer)[:80]!r}")

    def _wait(self) -> int:
        try:
            return self._process.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()


@dataclass(frozen=True, slots=True)
class Block:
    """Times of one process of a peer, measured alternately with ours.

    Attributes:
        own_s: Seconds of each of our measurements.
        peer_s: Seconds of each measurement of the peer.
        doubt: Why the peer's times are not trusted, or an empty text.
    """

    own_s: tuple[float, ...]
    peer_s: tuple[float, ...]
    doubt: str

    @property
    def median_s(self) -> float:
        """Median of the peer's seconds."""
        return statistics.median(self.peer_s)

    @property
    def described(self) -> str:
        """The peer's median, and why it is not trusted."""
        return f"{self.median_s:.3g} s" + (f" ({self.doubt})" if self.doubt else "")


def agreeing(blocks: Sequence[Block]) -> tuple[Block, Block] | None:
    """Return the first two blocks whose times of the peer agree, or None.

    Args:
        blocks: Blocks of separate processes, in the order in which they were measured.
    """
    sound = [b for b in blocks if not b.doubt and b.peer_s]
    for pair in combinations(sound, 2):
        low, high = sorted(b.median_s for b in pair)
        if high <= AGREEMENT * low:
            return pair
    return None


def why_not_believed(blocks: Sequence[Block]) -> str:
    """Return why no two blocks agree, block by block.

    Args:
        blocks: Blocks of separate processes.
    """
    return f"peer not believed: of {len(blocks)} processes no two agree; {'; '.join(b.described for b in blocks)}"
