"""Bridge that serves a Python policy over openpi's websocket protocol. Copy this file to the policy's folder.

The bridge requires ``websockets`` (14 or newer), ``msgpack`` and ``numpy``. The policy must have a method
``get_action(dict) -> dict``, as Being-H's policy does. Write a file that creates the policy::

    # my_policy.py, in the same folder as this file, in the environment of Being-H
    from BeingH.inference.policy import InternVLPolicy

    def make():
        return InternVLPolicy(model_path="path/to/checkpoint", ...)  # with the options of your own server script

Serve this policy, then evaluate it from any machine::

    python being_h_bridge.py my_policy:make --port 8000
    better eval --policy "openpi://HOST:8000?preset=being_h_libero" ...

By default, the bridge accepts only connections from the same machine. Use ``--host 0.0.0.0`` to accept connections from
other machines, and ``--api-key-env NAME`` to require a key. Neither the bridge nor the client unpickles data. The
policy handles one request at a time, even if several clients are connected.

For real-time chunking, set ``--inference-delay`` to the number of control steps that pass while the policy computes an
answer. The bridge stores the policy's ``action_unified`` for each connection and passes it to the policy as
``prev_chunk``, together with ``inference_delay``, in the next request. The bridge detects a new episode by the step
number of the client, so add a state with the key ``better/step`` and the single part ``step`` to the adapter. The
bridge does not pass this number to the policy.
"""

from __future__ import annotations

import argparse
import contextlib
import hmac
import http
import importlib
import logging
import os
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import msgpack
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import Server, ServerConnection, serve

if TYPE_CHECKING:
    from collections.abc import Callable

    from websockets.http11 import Request, Response

logger = logging.getLogger("being_h_bridge")

MAX_FRAME_BYTES = 256 * 1024 * 1024
"""Largest accepted request [bytes]."""


class ServedPolicy(Protocol):
    """Interface that the policy object must have to be served by this bridge."""

    def get_action(self, observation: dict[str, Any]) -> dict[str, Any]:
        """Return a dict with entries ``action.<name>``, each an array (chunk, size) or (1, chunk, size)."""


def encode(value: object) -> bytes:
    """Encode a value as a frame in openpi's variant of msgpack."""
    return bytes(msgpack.packb(value, default=_mark))


def decode(frame: bytes | str) -> Any:  # noqa: ANN401 - a frame may hold anything
    """Decode a frame in openpi's variant of msgpack. Raises ValueError if it is malformed."""
    if isinstance(frame, str):
        raise TypeError("expected a binary frame, got a text frame")
    return msgpack.unpackb(frame, object_hook=_read, strict_map_key=True)


def _mark(thing: object) -> object:
    thing = _plain(thing)
    if isinstance(thing, (np.ndarray, np.generic)) and thing.dtype.kind not in "biufSU":
        raise ValueError(f"an array of type {thing.dtype} cannot be encoded")
    if isinstance(thing, np.ndarray):
        return {b"__ndarray__": True, b"data": thing.tobytes(), b"dtype": thing.dtype.str, b"shape": thing.shape}
    if isinstance(thing, np.generic):
        return {b"__npgeneric__": True, b"data": thing.item(), b"dtype": thing.dtype.str}
    raise ValueError(f"a {type(thing).__name__} cannot be encoded")


def _read(form: dict[Any, Any]) -> object:
    if b"__ndarray__" in form:
        dtype = np.dtype(form[b"dtype"])
        if dtype.kind not in "biufSU":
            raise ValueError(f"arrays of type {dtype} are not supported")
        return np.frombuffer(form[b"data"], dtype).reshape(form[b"shape"]).copy()
    if b"__npgeneric__" in form:
        return np.dtype(form[b"dtype"]).type(form[b"data"])
    return form


class Bridge:
    """Server for one policy. It accepts several connections, but passes one request at a time to the policy."""

    def __init__(self, policy: ServedPolicy, *, inference_delay: int = 0, api_key: str | None = None) -> None:
        """Store the policy and the settings.

        ``inference_delay`` is the number of control steps that pass while the policy computes an answer.
        """
        self._policy, self._delay, self._api_key = policy, inference_delay, api_key
        self._one_at_a_time = threading.Lock()
        self._told = False

    def listen(self, host: str, port: int) -> Server:
        """Return a server bound to the host and port. It has the methods ``serve_forever`` and ``shutdown``."""
        return serve(
            self._converse,
            host,
            port,
            compression=None,
            max_size=MAX_FRAME_BYTES,
            process_request=self._admit,
            origins=[None],  # no requests from browser pages
        )

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        if request.path == "/healthz":
            return connection.respond(http.HTTPStatus.OK, "OK\n")
        given = request.headers.get("Authorization", "")
        if self._api_key is not None and not hmac.compare_digest(given.encode(), f"Api-Key {self._api_key}".encode()):
            return connection.respond(http.HTTPStatus.UNAUTHORIZED, "Wrong or missing key\n")
        return None

    def _converse(self, connection: ServerConnection) -> None:
        """Send the metadata, then answer requests until the connection is closed.

        If the policy fails, send the traceback to the client as text and close the connection.
        """
        kept: dict[str, Any] = {}
        with contextlib.suppress(ConnectionClosed):
            connection.send(encode({"server": "being_h_bridge", "policy": type(self._policy).__name__}))
            while True:
                frame = connection.recv()
                try:
                    reply = encode(self._answer(decode(frame), kept))
                except Exception:  # errors of the policy are sent to the client
                    logger.exception("a request could not be answered")
                    connection.send(traceback.format_exc())
                    connection.close(1011, "The policy failed")
                    return
                connection.send(reply)

    def _answer(self, observation: object, kept: dict[str, Any]) -> dict[str, Any]:
        if not isinstance(observation, dict):
            raise TypeError(f"expected a map, got a {type(observation).__name__}")
        step = _whole(observation.pop("better/step", None))
        if self._delay and step is None and not self._told:
            self._told = True
            logger.warning(
                "a client does not send its step number (better/step), so a new action chunk cannot continue the "
                "previous chunk"
            )
        if step is not None and "chunk" in kept and step > kept["step"]:
            observation |= continue_chunk(kept["step"], kept["chunk"], step=step, delay=self._delay)
        began = time.monotonic()
        with self._one_at_a_time:
            answer = dict(self._policy.get_action(observation))
        chunk = answer.pop("action_unified", None)
        kept.clear()
        if chunk is not None and step is not None:
            kept.update(step=step, chunk=np.asarray(_plain(chunk), np.float32))
        reply: dict[str, Any] = {
            name: np.asarray(_plain(value), np.float32) if name.startswith("action.") else value
            for name, value in answer.items()
        }
        reply["server_timing"] = {"infer_ms": 1000.0 * (time.monotonic() - began)}
        return reply


def continue_chunk(asked_at: int, chunk: np.ndarray, *, step: int, delay: int) -> dict[str, Any]:
    """Return the request entries for real-time chunking.

    The policy copies the first ``delay`` rows of ``prev_chunk`` to its new chunk. The old chunk (..., horizon, dim) is
    therefore shifted by the number of steps since it was requested (at step ``asked_at``). The end is padded with
    copies of the last row, which the policy ignores. If fewer than ``delay`` rows of the old chunk remain, the result
    is an empty dict.
    """
    passed = step - asked_at
    if not delay or chunk.shape[-2] - passed < delay:
        return {}
    moved = np.concatenate([chunk[..., passed:, :], np.repeat(chunk[..., -1:, :], passed, axis=-2)], axis=-2)
    return {"prev_chunk": moved, "inference_delay": delay}


def _whole(value: object) -> int | None:
    """Convert a number, or an array of one number, to an integer. Return None for any other value."""
    if value is None or isinstance(value, str):
        return None
    array = np.asarray(value)
    return int(array.item()) if array.size == 1 and array.dtype.kind in "iuf" else None


def _plain(value: object) -> object:
    """Convert a torch tensor to an array without importing torch. Return any other value unchanged."""
    detach = getattr(value, "detach", None)
    return value if detach is None else detach().float().cpu().numpy()


def serve_from_command_line() -> int:
    """Serve the policy named on the command line. Return the exit status of the process."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("make", help="MODULE:FUNCTION to call, without arguments, to create the policy")
    parser.add_argument("--host", default="127.0.0.1", help="interface to listen on (default: %(default)s)")
    parser.add_argument("--port", type=int, default=8000, help="port to listen on (default: %(default)s)")
    parser.add_argument(
        "--inference-delay",
        type=int,
        default=0,
        help=("control steps that pass while the policy computes an answer, for real-time chunking"),
    )
    parser.add_argument("--api-key-env", help="name of the environment variable with the key that clients must send")
    options = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    where, _, name = options.make.partition(":")
    sys.path.insert(0, str(Path.cwd()))
    make: Callable[[], ServedPolicy] = getattr(importlib.import_module(where), name or "make")
    key = None
    if options.api_key_env:
        key = os.environ.get(options.api_key_env)
        if not key:
            parser.error(f"the environment variable {options.api_key_env} contains no key")
    bridge = Bridge(make(), inference_delay=options.inference_delay, api_key=key)
    with bridge.listen(options.host, options.port) as server:
        logger.info("serving %s on ws://%s:%d", options.make, options.host, server.socket.getsockname()[1])
        with contextlib.suppress(KeyboardInterrupt):
            server.serve_forever()
    return 0


if __name__ == "__main__":
    sys.exit(serve_from_command_line())
