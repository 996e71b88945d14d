"""Policies written by users. Each runs in a separate process, so that a crash affects at most the current trial."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Sequence
from multiprocessing.reduction import ForkingPickler
from typing import Any

import numpy as np

from betterbench import errors
from betterbench.errors import (
    BetterError,
    HandshakeError,
    InvalidInputError,
    PolicyError,
    PolicyKilledError,
    PolicyProcessError,
    PolicyUnavailableError,
    UnknownNameError,
)
from betterbench.interface import EpisodeStart, Observation
from betterbench.jobs.asked_process import AskedProcess
from betterbench.jobs.frames import FrameEndError, FrameError, FrameTimeoutError, send_frame
from betterbench.jobs.leftovers import end_leftovers
from betterbench.jobs.process_output import ProcessOutput
from betterbench.jobs.worker_process import exit_text
from betterbench.policies.kinds import kind_of
from betterbench.policies.process.asked_process import ERRORS
from betterbench.policies.process.process_link import Declared, ProcessAnswer
from betterbench.policies.process.process_reader import read_answer

logger = logging.getLogger(__name__)

LOAD_S = 3000.0
"""Default time limit for loading a policy [s]."""

CLOSE_S = 5.0
"""Time that a policy may take to close [s]. After that, its process is killed."""

MAX_KILLS = 3
"""Maximum number of times that a batch is attempted if another process kills the policy's process."""

_LEAVE_S = 0.5
_FROM_OUTSIDE = ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")
_START = (
    "import sys; sys.path[:] = {path!r}; from betterbench.policies.process.asked_process import main; main({arguments})"
)

MARK = "BETTERBENCH_POLICY_PROCESS"
"""Environment variable that marks the child processes of a policy.

It is used to find them after the policy's process has ended.
"""


class PolicyProcess:
    """Client of a policy that runs in a separate process.

    If the process has ended, the next request starts a new process, which loads the policy again. A new process is also
    started after a failed episode, so that the failure cannot affect later episodes. Only a policy with large weights
    keeps its process. The process belongs to a separate session of the operating system, so that signals sent to the
    run do not reach it.

    Attributes:
        info: Description of the policy.
        source: Name and SHA-256 of the file that contains the policy, or an empty string.
        takes_batches: Whether the policy answers several observations in one call.
        ready_at: Time from which the policy accepts requests [s], as measured by ``time.perf_counter``. Infinite while
            the policy is being loaded.
    """

    def __init__(
        self,
        address: str,
        *,
        world: str = "",
        load_s: float = LOAD_S,
        started: tuple[_Started, Declared] | None = None,
    ) -> None:
        """Start the process, unless one is given, and wait until it has loaded the policy.

        ``world`` names the benchmark whose conventions apply, such as "libero".

        Raises:
            BetterError: If loading the policy raised an error of betterbench. The same error is raised here.
            PolicyProcessError: If loading raised another exception or took longer than ``load_s`` [s], or if the
                process ended.
        """
        self._address, self._world, self._load_s = address, world, load_s
        self._asking, self._closing = threading.Lock(), threading.Lock()
        self._closed = self._failed = self._used = False
        running, declared = started or _loaded(address, world, load_s)
        self._running: _Started | None = running
        self.info, self.takes_batches, self.source = declared.info, declared.batches, declared.source
        self.ready_at = time.perf_counter()

    def reset(self, start: EpisodeStart) -> None:
        """Tell the policy that an episode begins. Raises the same errors as :meth:`act`.

        If this fails in a process that has already run other episodes, the call is repeated in a new process.
        """
        try:
            self._ask("reset", start)
        except (PolicyUnavailableError, HandshakeError):
            raise
        except BetterError:
            if self._closed or not self._used:
                raise
            self._failed = True
            self._ask("reset", start)
        self._used = True

    def act(self, observation: Observation) -> np.ndarray:
        """Return the policy's answer to an observation.

        Raises:
            PolicyError: If the policy raised any exception, or its process crashed.
            PolicyKilledError: If the process was killed by another process.
            PolicyUnavailableError: If the policy itself uses a server that cannot be reached.
            HandshakeError: If the policy itself uses a server that now serves a different policy.
        """
        return self._ask("act", observation, answers=1)[0]

    def check(self, **conventions: Any) -> None:  # noqa: ANN401 - texts, numbers and specifications
        """Ask the policy to compare its conventions with those of the run.

        Do nothing for policy kinds that declare no conventions.
        """
        if kind_of(self._address).compares:
            self._ask("check", options=conventions)

    def distrust(self) -> None:
        """Use a new process for the next episode, because a trial has failed.

        A policy with large weights keeps its process.
        """
        self._failed = not self.info.heavy

    def close(self) -> None:
        """Close the policy and end its process.

        If a request is running, the process is ended without closing the policy. If another thread is already closing
        the policy, return immediately.
        """
        with self._closing:
            first, self._closed = not self._closed, True
        if not self._asking.acquire(blocking=False):
            running = self._running
            if first and running is not None:
                running.kill()  # a running request then reaches the end of the stream
            return
        try:
            if self._running is not None:
                self._running.close()
                self._running = None
        finally:
            self._asking.release()

    def _ask(
        self, method: str, *args: object, answers: int = 0, options: dict[str, object] | None = None
    ) -> list[np.ndarray]:
        with self._asking:
            if self._closed:
                raise PolicyError("the policy is closed")
            self._prepare(begins=method == "reset")
            running = self._running
            if running is None:
                raise AssertionError("unreachable: _prepare() creates a process")
            try:
                answer, arrays = running.call(method, args, options or {})
                if answer.error is None and len(arrays) != answers:
                    raise PolicyError(f"got {len(arrays)} arrays instead of {answers}")  # noqa: TRY301 - ends the process as below
            except Exception as error:
                status, self._running = running.finish(), None
                if isinstance(error, PolicyError):
                    raise PolicyError(f"the process of the policy sent an invalid answer: {error}") from error
                kind = PolicyKilledError if status.startswith(_FROM_OUTSIDE) else PolicyError
                raise kind(f"the process of the policy ended during a request ({status})") from error
            if answer.error is None:
                return arrays
            self.distrust()
            raise _error(answer.error, answer.texts)

    def _prepare(self, *, begins: bool) -> None:
        """Start a process if there is none, or if an episode begins after a trial has failed in the current process."""
        running = self._running
        if running is not None and not (begins and (self._failed or not running.waits)):
            return
        self.ready_at = math.inf
        try:
            self._start_another(running)
        finally:
            self.ready_at = time.perf_counter()

    def _start_another(self, running: _Started | None) -> None:
        """Replace the process. If the new process cannot load the policy, the old process is kept if possible."""
        if running is not None and not running.waits:
            running.finish()
            running = None
        self._failed = self._used = False
        self._running = _Started(self._address, self._world)
        try:
            self._require_unchanged(self._running.loaded(self._load_s))
        except BaseException as problem:
            self._running.finish()
            self._running = running
            if running is None:
                raise
            if self._closed or not isinstance(problem, BetterError):
                self._running = None
                running.finish()
                raise
            logger.warning("%s The policy continues in the process in which it failed.", problem)
        else:
            if running is not None:
                running.close()

    def _require_unchanged(self, declared: Declared) -> None:
        if declared.source != self.source:
            raise PolicyProcessError(
                f"{self._address}: the file of the policy has changed since the run began. Restore the original file."
            )


class BatchPolicyProcess(PolicyProcess):
    """Client of a policy that runs in a separate process and answers several observations in one call."""

    def act_batch(self, observations: Sequence[Observation]) -> Sequence[np.ndarray]:
        """Return one answer per observation. Raises the errors of :meth:`act`.

        Each answer depends only on its own observation, so a batch can be repeated if the process was killed.
        """
        for left in reversed(range(MAX_KILLS)):
            try:
                return self._ask("act_batch", list(observations), answers=len(observations))
            except PolicyKilledError as error:
                if not left:
                    raise
                logger.warning("%s; the policy is loaded again", error)
        raise AssertionError("unreachable: the last attempt either returns or raises")


def start_policy(address: str, *, world: str = "", load_s: float = LOAD_S) -> PolicyProcess:
    """Load the policy of an address in a separate process. Raises the same errors as :class:`PolicyProcess`."""
    started = _loaded(address, world, load_s)
    kind = BatchPolicyProcess if started[1].batches else PolicyProcess
    return kind(address, world=world, load_s=load_s, started=started)


def _loaded(address: str, world: str, load_s: float) -> tuple[_Started, Declared]:
    """Start a process, wait until it has loaded the policy, and return the process and the policy's description."""
    started = _Started(address, world)
    try:
        return started, started.loaded(load_s)
    except PolicyKilledError as error:  # no trial has begun, so nothing needs to be repeated
        raise PolicyProcessError(str(error)) from error
    except BaseException:
        started.finish()
        raise


class _Started(AskedProcess):
    """Process of a policy. It loads the policy and then answers requests."""

    def __init__(self, address: str, world: str) -> None:
        self._address, self._mark = address, uuid.uuid4().hex
        life, self._life = os.pipe()
        self._output = ProcessOutput()

        def command(link: int) -> list[str]:
            arguments = f"{address!r}, {link}, {life}, {world!r}"
            return [sys.executable, "-c", _START.format(path=sys.path, arguments=arguments)]

        try:
            super().__init__(
                command,
                output=self._output.theirs,  # keeps the output of the policy separate from that of the run
                environment={**os.environ, MARK: self._mark},
                keeps=(life,),
                any_type=True,
            )
        finally:
            os.close(life)
            self._output.begin()

    def loaded(self, timeout_s: float) -> Declared:
        """Wait until the policy has been loaded, and return its description.

        Raises the errors of :class:`PolicyProcess`. Also raises PolicyKilledError if another process killed the
        policy's process.
        """
        try:
            answer, _ = read_answer(self.greeting(limit_s=timeout_s))
        except FrameTimeoutError as error:
            raise PolicyProcessError(
                f"{self._address}: loading took more than {timeout_s:g} s. Increase --policy-timeout, since "
                "loading may take ten times as long as an answer."
            ) from error
        except (FrameError, PolicyError) as error:
            how = self.finish()
            kind = PolicyKilledError if how.startswith(_FROM_OUTSIDE) else PolicyProcessError
            raise kind(
                f"{self._address}: the process of the policy ended while loading ({how}); see its output above. "
                "Load the policy in a Python shell to see why"
            ) from error
        if answer.error is None and answer.declared is not None:
            return answer.declared
        raised = _error(answer.error or "", answer.texts or ("it does not declare anything",))
        if type(raised) is not PolicyError:
            raise raised  # errors of betterbench need no prefix
        raise PolicyProcessError(f"{self._address}: the policy cannot be loaded ({raised}).")

    def call(
        self, method: str, args: Sequence[object], options: dict[str, object]
    ) -> tuple[ProcessAnswer, list[np.ndarray]]:
        """Send a request and return the answer.

        Raises:
            FrameEndError: If the process has ended.
            PolicyError: If the process sends an invalid answer.
        """
        question = np.frombuffer(ForkingPickler.dumps((method, args, options)), np.uint8)
        try:
            return read_answer(self.ask({}, {"question": question}))
        except FrameEndError:
            raise
        except FrameError as error:
            raise PolicyError(str(error)) from error

    def close(self) -> None:
        """Close the policy and end the process."""
        with contextlib.suppress(FrameError):
            send_frame(self, {}, {})
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(CLOSE_S)
        self.finish()

    def finish(self) -> str:
        """End the process if it is still running. Return a description of how it ended."""
        status = self.end(_LEAVE_S)
        if self._life >= 0:
            os.close(self._life)
            self._life = -1
            end_leftovers(MARK, self._mark, self.pid)
            self._output.end()
        return "the process closed its connection to the run" if status is None else exit_text(status)


def _error(kind: str, texts: Sequence[str]) -> BetterError:
    """Create the error that the process has reported."""
    if kind == "UnknownNameError" and len(texts) > 1:
        return UnknownNameError(texts[0], texts[1], texts[2:])
    if kind == "InvalidInputError" and len(texts) == 3:
        return InvalidInputError(*texts)
    made = getattr(errors, kind) if kind in ERRORS else PolicyError
    error: BetterError = made(texts[0] if texts else "no message")
    return error
