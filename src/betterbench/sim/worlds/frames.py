"""Frames between a run and the process of a foreign simulator: a JSON document and the bytes of arrays, no pickles.

The process of the simulator reads this file too, in an environment without betterbench: it imports only the standard
library and NumPy.
"""

from __future__ import annotations

import json
import math
import re
import socket
import struct
import time
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

MAX_HEAD_BYTES = 16 << 20
"""Largest JSON of a frame [byte]."""

MAX_ARRAY_BYTES = 256 << 20
"""Largest sum of the arrays of a frame [byte]."""

_LENGTHS = struct.Struct(">IIQQ")
"""Sizes of the document, of the array forms and of the arrays, and the number of the frame."""
_TYPES = re.compile(r"[<|](b1|[iu][1248]|f[48])", re.ASCII)
_MAX_AXES = 8
_BLOCK = 1 << 16
_SHORT_BYTES = 64
"""Longest JSON that is cached [byte]."""
_ALIGNED = 8
"""Alignment of arrays [byte], if the sizes of the arrays before allow it."""
_ENCODE = json.JSONEncoder(allow_nan=False).encode


class FrameError(Exception):
    """The other side has disconnected, or sent bytes that are not a frame."""


def send_frame(
    link: socket.socket, document: Mapping[str, Any], arrays: Mapping[str, np.ndarray], *, number: int = 0
) -> None:
    """Send a document and arrays by name; FrameError if the other side has disconnected or does not read in time.

    The ``number`` is that of a request; its answer has the same number.
    """
    forms, kinds = _forms_text(tuple(arrays), tuple([(array.dtype, array.shape) for array in arrays.values()]))
    head = _encoded(document)
    head += b" " * (-(len(head) + len(forms)) % _ALIGNED)
    if kinds is None:
        blocks = [array.tobytes() for array in arrays.values()]
    else:
        blocks = [array.astype(kind).tobytes() for array, kind in zip(arrays.values(), kinds, strict=True)]
    lengths = _LENGTHS.pack(len(head), len(forms), sum(map(len, blocks)), number)
    try:
        link.sendall(b"".join((lengths, head, forms, *blocks)))
    except OSError as error:
        raise FrameError(f"it cannot be reached ({error})") from error


def receive_frame(link: socket.socket, *, number: int = 0) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return the next document and its read-only arrays.

    The timeout of the socket applies to the whole frame, whatever the number of its pieces.

    Raises:
        FrameError: If the other side has disconnected, sends an invalid frame or one with another number, or does not
            send in time.
    """
    limit_s = link.gettimeout()
    until = None if limit_s is None else time.monotonic() + limit_s
    frame = _more(link, _BLOCK)
    if len(frame) < _LENGTHS.size:
        frame += _received(link, _LENGTHS.size - len(frame), until)
    head_bytes, forms_bytes, body_bytes, found = _LENGTHS.unpack_from(frame)
    if head_bytes + forms_bytes > MAX_HEAD_BYTES or body_bytes > MAX_ARRAY_BYTES:
        raise FrameError(f"a frame of {head_bytes + forms_bytes} and {body_bytes} bytes is too large")
    forms_at = _LENGTHS.size + head_bytes
    body_at = forms_at + forms_bytes
    left = body_at + body_bytes - len(frame)
    if left > 0:
        frame += _received(link, left, until)
    elif left < 0:
        raise FrameError(f"{-left} bytes follow a frame")
    if found != number:
        raise FrameError(f"a frame has the number {found} , expected {number}: one was sent twice or left out")
    try:
        document = _decoded(frame[_LENGTHS.size : forms_at])
        places, end = _places(frame[forms_at:body_at])
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, MemoryError) as error:
        raise FrameError(f"a frame cannot be read ({' '.join(str(error).split())[:200]})") from error
    if not isinstance(document, dict):
        raise FrameError(f"a frame contains a {type(document).__name__} instead of a document")
    if end != body_bytes:
        raise FrameError(f"a frame contains {body_bytes} bytes of arrays, but declares {end}")
    return document, {name: np.ndarray(shape, dtype, frame, body_at + at) for name, dtype, shape, at in places}


def _encoded(document: Mapping[str, Any]) -> bytes:
    """Return a document as JSON; the short ones of control steps repeat and are cached."""
    for value in document.values():
        if value is not True and value is not False and type(value) is not str:  # 1 and True are one key
            return _ENCODE(document).encode()
    return _short_text(tuple(document.items()))


@lru_cache(maxsize=64)
def _short_text(items: tuple[tuple[str, bool | str], ...]) -> bytes:
    return _ENCODE(dict(items)).encode()


def _decoded(text: bytes) -> Any:  # noqa: ANN401 - any JSON
    """Return the value of a JSON text; the short texts of control steps repeat and are cached."""
    known = _short_items(text) if len(text) <= _SHORT_BYTES else None
    return _loaded(text) if known is None else dict(known)


def _loaded(text: bytes) -> Any:  # noqa: ANN401 - any JSON
    """Return the value of a JSON text; ValueError if it is not JSON, or a number in it is not finite."""
    return json.loads(text.decode(), parse_constant=_finite, parse_float=_finite)


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is not finite")
    return number


@lru_cache(maxsize=64)
def _short_items(text: bytes) -> tuple[tuple[str, Any], ...] | None:
    """Return the entries of a short document, or None for other values or mutable entries."""
    document = _loaded(text)
    if not isinstance(document, dict) or any(isinstance(value, (dict, list)) for value in document.values()):
        return None
    return tuple(document.items())


@lru_cache(maxsize=64)
def _forms_text(
    names: tuple[str, ...], forms: tuple[tuple[np.dtype[Any], tuple[int, ...]], ...]
) -> tuple[bytes, list[np.dtype[Any]] | None]:
    """Return names, types and shapes of arrays as JSON, and the types to send where an array has another byte order.

    Most frames have the same arrays as the previous one.
    """
    kinds = [kind.newbyteorder("<") for kind, _ in forms]
    shapes = {name: (kind.str, shape) for name, kind, (_, shape) in zip(names, kinds, forms, strict=True)}
    return json.dumps(shapes).encode(), kinds if any(kind.str[0] == ">" for kind, _ in forms) else None


@lru_cache(maxsize=64)
def _places(text: bytes) -> tuple[tuple[tuple[str, np.dtype[Any], tuple[int, ...], int], ...], int]:
    """Return name, type and shape of arrays and the offset of each, and the end of the last one [byte]."""
    found, at = [], 0
    for name, (kind, shape) in json.loads(text).items():
        if not isinstance(kind, str) or not _TYPES.fullmatch(kind):
            raise ValueError(f"an array has the type {str(kind)[:40]!r}")
        if not isinstance(shape, list) or len(shape) > _MAX_AXES or not all(type(n) is int and n >= 0 for n in shape):
            raise ValueError(f"an array has the shape {str(shape)[:40]!r}")
        dtype = np.dtype(kind)
        if (
            math.prod(n or 1 for n in shape) * dtype.itemsize > MAX_ARRAY_BYTES
        ):  # NumPy refuses them also where one is 0
            raise ValueError(f"an array has the shape {str(shape)[:40]!r}")
        found.append((name, dtype, tuple(shape), at))
        at += math.prod(shape) * dtype.itemsize
    return tuple(found), at


def _received(link: socket.socket, count: int, until: float | None) -> bytes:
    """Return exactly ``count`` bytes, which must arrive before a time of the monotonic clock."""
    blocks = []
    while count:
        if until is not None:
            link.settimeout(max(until - time.monotonic(), 1e-3))
        blocks.append(_more(link, min(count, 1 << 20)))
        count -= len(blocks[-1])
    return b"".join(blocks)


def _more(link: socket.socket, most: int) -> bytes:
    """Return the next bytes, at least one."""
    try:
        block = link.recv(most)
    except TimeoutError as error:
        raise FrameError("no answer in time") from error
    except OSError as error:
        raise FrameError(f"it cannot be reached ({error})") from error
    if not block:
        raise FrameError("it has ended")
    return block
