"""Main function of the process in which a user's policy runs. It loads the policy and answers the run's requests.

Requests arrive through a socket. This module does not import a simulator, so that the process starts fast and the
memory is available to the policy.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Sequence
from multiprocessing.reduction import ForkingPickler
from pathlib import Path

import numpy as np

from betterbench.errors import BetterError, InvalidInputError, UnknownNameError, described
from betterbench.interface import BatchPolicy, Policy
from betterbench.jobs.frames import FrameContent, FrameError, answer_requests, send_frame
from betterbench.policies.kinds import find_kind, make_policy, read_address
from betterbench.policies.process.process_link import Declared, ProcessAnswer, content_of, text_of

MAX_TEXT = 2000
"""Maximum length of the text of an error, in characters."""

ERRORS = (
    "PolicyError",
    "PolicyProcessError",
    "PolicyUnavailableError",
    "HandshakeError",
    "RecordError",
    "MissingDependencyError",
)
"""Errors of betterbench that keep their class when they are sent to the run. All other errors become a PolicyError."""

# These functions are stored here before the policy can replace them.
_exit, _killpg, _write, _loads = os._exit, os.killpg, os.write, ForkingPickler.loads


def main(address: str, link: int, life: int, world: str = "") -> None:
    """Load the policy of an address, and answer requests until the socket is closed.

    Args:
        address: Address of the policy.
        link: File descriptor of the socket.
        life: File descriptor of a pipe whose other end is closed when the run ends.
        world: Benchmark whose conventions apply, such as "libero", or empty.
    """
    threading.Thread(target=_end_with_run, args=(life,), daemon=True).start()
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("500")  # if memory runs out, this process should be ended first
    sys.excepthook = lambda *_: _exit(1)
    run = socket.socket(fileno=link)
    kind = find_kind(address)
    try:
        policy = make_policy(address, world=world)
        source = "" if kind is None else kind.file_of(read_address(address))
        send_frame(run, *content_of(ProcessAnswer(declared=_declared(policy, source))))
    except BaseException as problem:  # noqa: BLE001 - any error of a constructor is reported to the run
        if not (
            isinstance(problem, BetterError) or (kind is not None and kind.source_of)
        ):  # errors in the user's file get a line number
            traceback.print_exc()
        send_frame(run, *content_of(_told(problem)))
        _exit(1)
    try:
        answer_requests(run, lambda _, asked: _answered(policy, asked))
        _close(policy)
    except (FrameError, OSError):
        _exit(1)  # the run has ended
    except BaseException as problem:  # noqa: BLE001 - code of the policy may have broken this process
        _say("the process of the policy failed", problem)
        _exit(1)
    finally:
        _exit(0)  # without waiting for threads of the policy


def _end_with_run(life: int) -> None:
    """Wait until the run has ended, then immediately end this process and its child processes."""
    try:
        os.read(life, 1)
    finally:
        with contextlib.suppress(BaseException):
            _killpg(0, signal.SIGKILL)
        _exit(1)


def _declared(policy: Policy, source: str) -> Declared:
    """Return the description of a policy, converted to values that can be sent to the run."""
    info, e = policy.info, policy.info.execution
    return Declared(
        name=text_of(info.name),
        action_space=text_of(info.action_space),
        needs_images=bool(info.needs_images),
        metadata={text_of(k): text_of(v) for k, v in info.metadata.items()},
        horizon=None if e.horizon is None else int(e.horizon),
        ahead=int(e.ahead),
        ensemble=None if e.ensemble is None else float(e.ensemble),
        heavy=bool(info.heavy),
        batches=isinstance(policy, BatchPolicy),
        source=source,
        cameras=None if info.cameras is None else [text_of(name) for name in info.cameras],
    )


def _answered(policy: Policy, asked: dict[str, np.ndarray]) -> FrameContent | None:
    """Call the requested method of a policy, and return the resulting arrays or the error.

    Return None if no more requests follow.
    """
    if not asked:
        return None
    method, args, options = _loads(asked["question"].data)
    try:
        given = getattr(policy, method)(*args, **options)
        return content_of(ProcessAnswer(), [given] if method == "act" else given if method == "act_batch" else ())
    except BaseException as problem:  # noqa: BLE001 - any error ends only the trial, not the run
        return content_of(_told(problem))


def _told(problem: BaseException) -> ProcessAnswer:
    """Return the class and the texts of an error, without the other objects to which the error refers."""
    if isinstance(problem, UnknownNameError):
        return _error("UnknownNameError", (problem.kind, problem.name, *problem.known))
    if isinstance(problem, InvalidInputError):
        return _error("InvalidInputError", (problem.where, problem.problem, problem.cure))
    known = next((c.__name__ for c in type(problem).__mro__ if c.__name__ in ERRORS), "")
    known = known if isinstance(problem, BetterError) else ""
    text = kind = type(problem).__name__
    for shown in (
        str if known else described,
        lambda p: f"{kind}: {p}",
        lambda _: f"{kind}: the error cannot be shown as text",
    ):
        with contextlib.suppress(BaseException):  # an error that cannot be shown as text is still reported
            text = text_of(shown(problem))
            break
    if len(text) > MAX_TEXT:
        text = text[:MAX_TEXT] + " ..."
    return _error(known, (text,))


def _error(kind: str, texts: Sequence[object]) -> ProcessAnswer:
    return ProcessAnswer(error=kind, texts=tuple(text_of(text) for text in texts))


def _close(policy: Policy) -> None:
    close = getattr(policy, "close", None)
    if callable(close):
        try:
            close()
        except BaseException as problem:  # noqa: BLE001 - the run is over
            _say("the policy could not be closed", problem)


def _say(what: str, problem: BaseException) -> None:
    """Write one line to standard error. If this is impossible, do nothing."""
    with contextlib.suppress(BaseException):
        _write(2, f"{what}: {described(problem)}\n".encode("utf-8", "backslashreplace"))
