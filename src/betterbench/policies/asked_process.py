"""The process of a policy that is not ours: it loads the policy and answers one question after the other over a pipe.

Nothing here imports a simulator, so that the process starts fast and the memory is the policy's.
"""

from __future__ import annotations

import importlib
import os
import sys
import threading
import traceback
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from betterbench.errors import BetterError, InvalidInputError, UnknownNameError, described
from betterbench.interface import BatchPolicy, Execution, Policy, PolicyInfo
from betterbench.policies.plugin import load_plugin, source_of

MAX_ANSWER_BYTES = 64 << 20
"""Largest answer that is passed on [byte]; a chunk of 1,000 actions of 7 numbers takes 56,000."""

MAX_TEXT = 2000
"""Characters of an error that are passed on."""

ERRORS = (
    "PolicyError",
    "PolicyProcessError",
    "PolicyUnavailableError",
    "HandshakeError",
    "RecordError",
    "MissingDependencyError",
)
"""Errors of betterbench that keep their class on the way to the run; others of a policy become PolicyError."""


def main(address: str, pipe: int, life: int) -> None:
    """Load the policy of an address and answer until the pipe is closed.

    ``pipe`` is the file descriptor of a connection, and ``life`` one that reads an end when the run has ended.
    """
    os.dup2(2, 1)  # what a policy prints is no output of the run
    threading.Thread(target=_end_with_run, args=(life,), daemon=True).start()
    connection = Connection(pipe)
    try:
        policy = _load(address)
        source = source_of(address.removeprefix("python:")) if address.startswith("python:") else ""
        connection.send(("ready", _plain_info(policy.info), isinstance(policy, BatchPolicy), source))
    except BaseException as problem:  # noqa: BLE001 - whatever a constructor raises is told to the run
        if not isinstance(problem, BetterError):
            traceback.print_exc()
        connection.send(_told(problem))
        os._exit(1)
    try:
        while (asked := connection.recv()) is not None:
            connection.send(_answered(policy, *asked))
        _close(policy)
    except (EOFError, OSError):
        os._exit(1)  # the run has ended
    finally:
        os._exit(0)  # threads that the policy has left do not keep the process


def _end_with_run(life: int) -> None:
    try:
        os.read(life, 1)
    finally:
        os._exit(1)


def _load(address: str) -> Policy:
    if address.startswith("python:"):
        return load_plugin(address.removeprefix("python:"))
    connect = importlib.import_module("betterbench.policies.connect").connect
    made: Policy = connect(address)
    return made


def _plain_info(info: PolicyInfo) -> PolicyInfo:
    """Return what a policy declares as a value that the run can read, whatever class the policy made of it."""
    e = info.execution
    return PolicyInfo(
        str(info.name),
        str(info.action_space),
        bool(info.needs_images),
        {str(k): str(v) for k, v in info.metadata.items()},
        Execution(e.horizon, e.ahead, e.ensemble),
        bool(info.heavy),
    )


def _answered(policy: Policy, method: str, args: tuple[Any, ...], options: dict[str, Any]) -> tuple[Any, ...]:
    """Return what a method gave, as plain arrays, or what it raised."""
    try:
        given = getattr(policy, method)(*args, **options)
        if method == "act":
            return "ok", _plain(given)
        if method == "act_batch":
            return "ok", [_plain(array) for array in given]
    except BaseException as problem:  # noqa: BLE001 - it ends the trial, whatever it is, and never the run
        return _told(problem)
    return "ok", None


Plain = tuple[str, tuple[int, ...], bytes]
"""An array as the text of its type, its shape and its bytes; the bytes are empty where it holds Python objects."""


def _plain(answer: object) -> Plain:
    array = np.asarray(answer)
    if array.nbytes > MAX_ANSWER_BYTES:
        raise ValueError(f"an answer of {array.nbytes} bytes is no chunk of actions")
    return array.dtype.str, array.shape, b"" if array.dtype.hasobject else array.tobytes()


def array_of(plain: Plain) -> np.ndarray:
    """Return the array that a process has sent; ValueError or TypeError if it has sent none."""
    kind, shape, data = plain
    dtype = np.dtype(kind)
    return np.empty(shape, dtype) if dtype.hasobject else np.frombuffer(bytearray(data), dtype).reshape(shape)


def _told(problem: BaseException) -> tuple[str, str, Sequence[str]]:
    """Return the class of an error and its texts, without the objects that it may hold."""
    if isinstance(problem, UnknownNameError):
        return "error", "UnknownNameError", (problem.kind, problem.name, *problem.known)
    if isinstance(problem, InvalidInputError):
        return "error", "InvalidInputError", (problem.where, problem.problem, problem.cure)
    known = next((c.__name__ for c in type(problem).__mro__ if c.__name__ in ERRORS), "")
    known = known if isinstance(problem, BetterError) else ""
    try:
        text = str(problem) if known else described(problem)
    except BaseException:  # noqa: BLE001 - an error that cannot be shown is an error all the same
        text = f"{type(problem).__name__}: it cannot be shown as text"
    if len(text) > MAX_TEXT:
        text = text[:MAX_TEXT] + " ..."
    text = text.encode("utf-8", "backslashreplace").decode()
    return "error", known, (text,)


def _close(policy: Policy) -> None:
    close = getattr(policy, "close", None)
    if callable(close):
        try:
            close()
        except BaseException:  # noqa: BLE001 - the run is over
            traceback.print_exc()
    sys.stderr.flush()
