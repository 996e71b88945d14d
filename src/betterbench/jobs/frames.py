"""Frames: messages between a run and a policy process or simulator.

A frame consists of a JSON document and arrays. Pickle is not used.

Simulator processes also import this file, and betterbench is not installed in their environments. The file therefore
imports only the standard library and NumPy.
"""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

MAX_HEAD_BYTES = 16 << 20
"""Maximum size of the JSON in a frame [byte]."""

MAX_ARRAY_BYTES = 256 << 20
"""Maximum total size of the arrays in a frame [byte]."""

_LENGTHS = struct.Struct(">IIQQ")
"""Header of a frame: sizes of the JSON document, the array descriptions and the arrays [byte], and the frame number."""
_TYPES = re.compile(r"[<|](b1|[iu][1248]|f[48])", re.ASCII)
_LONGEST_TYPE = 40
_MAX_AXES = 32
_BLOCK = 1 << 20
_ALIGNED = 8
"""Alignment of the arrays in a frame [byte]."""
_ENCODE = json.JSONEncoder(allow_nan=False).encode  # stored at import, before a policy can replace it
_BROKEN = (ArithmeticError, AttributeError, LookupError, MemoryError, RuntimeError, SyntaxError, TypeError, ValueError)


FrameContent = tuple[dict[str, Any], dict[str, np.ndarray]]
"""Content of a frame: a JSON document, and arrays by name."""


class FrameError(Exception):
    """The other process has closed the connection, or has sent bytes that are not a frame."""


class FrameEndError(FrameError):
    """The other process has closed the connection or exited."""


class FrameTimeoutError(FrameError):
    """The other process did not send or receive data in time."""


class Link(Protocol):
    """Socket, or an object with the same methods that enforces a deadline."""

    def sendall(self, data: bytes, /) -> None:
        """Send all bytes."""

    def recv(self, size: int, /) -> bytes:
        """Return the next bytes, or ``b""`` if the other process has ended."""


def send_frame(link: Link, document: Mapping[str, Any], arrays: Mapping[str, np.ndarray], *, number: int = 0) -> None:
    """Send a frame, i.e. a JSON document and named arrays.

    A request and its reply have the same ``number``. For an array of Python objects, only the shape is sent. Raises
    FrameError if the other process has ended or does not receive the frame in time.
    """
    forms, kinds = _forms_text(tuple(arrays), tuple([(array.dtype, array.shape) for array in arrays.values()]))
    head = _ENCODE(document).encode()
    head += b" " * (-(len(head) + len(forms)) % _ALIGNED)
    if kinds is None:
        blocks = [array.tobytes() for array in arrays.values()]
    else:
        blocks = [
            b"" if kind.hasobject else array.astype(kind).tobytes()
            for array, kind in zip(arrays.values(), kinds, strict=True)
        ]
    lengths = _LENGTHS.pack(len(head), len(forms), sum(map(len, blocks)), number)
    try:
        link.sendall(b"".join((lengths, head, forms, *blocks)))
    except OSError as error:
        raise _failed(error) from error


def receive_frame(link: Link, *, any_type: bool = False) -> tuple[int, dict[str, Any], dict[str, np.ndarray]]:
    """Receive a frame. Return its number, its document and its arrays, which are read-only.

    Args:
        link: Socket.
        any_type: Whether to accept arrays of any type. Arrays of Python objects arrive without their content.

    Raises:
        FrameError: If the other process has ended, sends an invalid frame, or does not send in time.
    """
    head_bytes, forms_bytes, body_bytes, number = _LENGTHS.unpack(_received(link, _LENGTHS.size))
    if head_bytes + forms_bytes > MAX_HEAD_BYTES or body_bytes > MAX_ARRAY_BYTES:
        raise FrameError(f"a frame of {head_bytes + forms_bytes} and {body_bytes} bytes is too large")
    frame = _received(link, head_bytes + forms_bytes + body_bytes)
    body_at = head_bytes + forms_bytes
    try:
        document = _loaded(frame[:head_bytes])
        places, end = _places(frame[head_bytes:body_at], any_type)
        if not isinstance(document, dict):
            raise TypeError(f"expected a JSON object, got {type(document).__name__}")
        if end != body_bytes:
            raise ValueError(f"the frame contains {body_bytes} bytes of arrays, but declares {end}")
        arrays = {
            name: np.empty(shape, dtype) if dtype.hasobject else np.ndarray(shape, dtype, frame, body_at + at)
            for name, dtype, shape, at in places
        }
    except _BROKEN as error:
        raise FrameError(f"a frame cannot be read ({' '.join(str(error).split())[:200]})") from error
    return number, document, arrays


def answer_requests(link: Link, answer: Callable[[dict[str, Any], dict[str, np.ndarray]], FrameContent | None]) -> None:
    """Main loop of a child process: answer requests until an answer is None.

    Raises:
        FrameError: If the other process has ended.
    """
    while True:
        number, document, arrays = receive_frame(link)
        given = answer(document, arrays)
        if given is None:
            return
        send_frame(link, *given, number=number)


def _loaded(text: bytes) -> Any:  # noqa: ANN401 - any JSON
    """Parse JSON. Raises ValueError if the text is not valid JSON or contains a number that is not finite."""
    return _DECODE(text.decode())


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is not finite")
    return number


_DECODE = json.JSONDecoder(parse_constant=_finite, parse_float=_finite).decode


@lru_cache(maxsize=64)
def _forms_text(
    names: tuple[str, ...], forms: tuple[tuple[np.dtype[Any], tuple[int, ...]], ...]
) -> tuple[bytes, list[np.dtype[Any]] | None]:
    """Return a JSON description of the arrays, and the types to which the arrays must be converted before sending.

    The types are None if no array has to be converted. Conversion is needed for big-endian arrays and for arrays of
    Python objects. The result is cached, because most frames have the same arrays as the frame before.
    """
    kinds = [kind.newbyteorder("<") for kind, _ in forms]
    shapes = {name: (kind.str, shape) for name, kind, (_, shape) in zip(names, kinds, forms, strict=True)}
    plain = all(kind.str[0] != ">" and not kind.hasobject for kind, _ in forms)
    return _ENCODE(shapes).encode(), None if plain else kinds


@lru_cache(maxsize=64)
def _places(text: bytes, any_type: bool) -> tuple[tuple[tuple[str, np.dtype[Any], tuple[int, ...], int], ...], int]:
    """Return the name, type, shape and offset of each array, and the end offset of the last array [byte]."""
    found, at = [], 0
    for name, (kind, shape) in _loaded(text).items():
        known = isinstance(kind, str) and (len(kind) <= _LONGEST_TYPE if any_type else _TYPES.fullmatch(kind))
        if not known:
            raise ValueError(f"the type of an array is invalid: {str(kind)[:40]!r}")
        if not isinstance(shape, list) or len(shape) > _MAX_AXES or not all(type(n) is int and n >= 0 for n in shape):
            raise ValueError(f"the shape of an array is invalid: {str(shape)[:40]!r}")
        dtype = np.dtype(kind)
        # NumPy rejects a dimension that is too large even if another dimension is 0.
        if not dtype.itemsize or math.prod(n or 1 for n in shape) * dtype.itemsize > MAX_ARRAY_BYTES:
            raise ValueError(f"the shape of an array is invalid: {str(shape)[:40]!r}")
        found.append((name, dtype, tuple(shape), at))
        at += 0 if dtype.hasobject else math.prod(shape) * dtype.itemsize
    return tuple(found), at


def _received(link: Link, count: int) -> bytes:
    blocks = []
    while count:
        try:
            blocks.append(link.recv(min(count, _BLOCK)))
        except OSError as error:
            raise _failed(error) from error
        if not blocks[-1]:
            raise FrameEndError("the process has ended")
        count -= len(blocks[-1])
    return blocks[0] if len(blocks) == 1 else b"".join(blocks)


def _failed(error: OSError) -> FrameError:
    """Return the FrameError to raise after a failed read or write."""
    if isinstance(error, TimeoutError):
        return FrameTimeoutError("no answer arrived in time")
    return FrameEndError(f"the connection failed ({error})")
