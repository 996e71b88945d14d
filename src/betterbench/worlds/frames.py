"""Frames between a run and the process of a foreign simulator: a JSON document and the bytes of arrays, no pickles.

The process of the simulator reads this file too, in an environment without betterbench: it imports the standard library
and NumPy alone.
"""

from __future__ import annotations

import json
import math
import re
import socket
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

MAX_HEAD_BYTES = 16 << 20
"""Largest JSON document of a frame [byte]."""

MAX_ARRAY_BYTES = 256 << 20
"""Largest sum of the arrays of a frame [byte]."""

_LENGTHS = struct.Struct(">IQ")
_TYPES = re.compile(r"[<|](b1|[iu][1248]|f[48])", re.ASCII)
_MAX_AXES = 8


class FrameError(Exception):
    """The other side has gone, or what it sent is no frame."""


def send_frame(link: socket.socket, document: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Send a document and arrays by name; FrameError if the other side has gone or does not read in time."""
    plain = {name: np.ascontiguousarray(array).reshape(np.shape(array)) for name, array in arrays.items()}
    forms = {name: [array.dtype.newbyteorder("<").str, list(array.shape)] for name, array in plain.items()}
    head = json.dumps({"document": document, "arrays": forms}, allow_nan=False).encode()
    blocks = [array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes() for array in plain.values()]
    body = b"".join(blocks)
    try:
        link.sendall(_LENGTHS.pack(len(head), len(body)) + head + body)
    except OSError as error:
        raise FrameError(f"it cannot be reached ({error})") from error


def receive_frame(link: socket.socket) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return the next document and its arrays.

    Raises:
        FrameError: If the other side has gone, sends what is no frame, or does not send in time.
    """
    head_bytes, body_bytes = _LENGTHS.unpack(_received(link, _LENGTHS.size))
    if head_bytes > MAX_HEAD_BYTES or body_bytes > MAX_ARRAY_BYTES:
        raise FrameError(f"a frame of {head_bytes} and {body_bytes} bytes is too large")
    head, body = _received(link, head_bytes), _received(link, body_bytes)
    try:
        form = json.loads(head)
        document, forms = form["document"], form["arrays"]
        arrays, at = {}, 0
        for name, (kind, shape) in forms.items():
            arrays[name], at = _array(kind, shape, body, at)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise FrameError(f"a frame cannot be read ({' '.join(str(error).split())[:200]})") from error
    if not isinstance(document, dict):
        raise FrameError(f"a frame holds a {type(document).__name__} and no document")
    if at != body_bytes:
        raise FrameError(f"a frame holds {body_bytes} bytes of arrays and names {at}")
    return document, arrays


def _array(kind: object, shape: object, body: bytes, at: int) -> tuple[np.ndarray, int]:
    """Return the array that begins at a place of the body, read-only, and where the next one begins."""
    if not isinstance(kind, str) or not _TYPES.fullmatch(kind):
        raise ValueError(f"an array has the type {str(kind)[:40]!r}")
    if not isinstance(shape, list) or len(shape) > _MAX_AXES or not all(type(n) is int and n >= 0 for n in shape):
        raise ValueError(f"an array has the shape {str(shape)[:40]!r}")
    dtype = np.dtype(kind)
    count = math.prod(shape)
    end = at + count * dtype.itemsize
    if end > len(body):
        raise ValueError("an array is longer than its frame")
    return np.frombuffer(body, dtype, count, at).reshape(shape), end


def _received(link: socket.socket, count: int) -> bytes:
    """Return exactly so many bytes."""
    blocks, left = [], count
    while left:
        try:
            block = link.recv(min(left, 1 << 20))
        except TimeoutError as error:
            raise FrameError("no answer in time") from error
        except OSError as error:
            raise FrameError(f"it cannot be reached ({error})") from error
        if not block:
            raise FrameError("it has ended")
        blocks.append(block)
        left -= len(block)
    return b"".join(blocks)
