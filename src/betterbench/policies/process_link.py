"""What a run and the process of a policy send each other: frames on a socket, and answers that hold no objects.

A question of the run is pickled. An answer is JSON and the bytes of arrays, because a policy can write to its socket
what it likes.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Annotated

import numpy as np
from pydantic import Field, TypeAdapter

from betterbench.errors import PolicyError
from betterbench.interface import Execution, PolicyInfo
from betterbench.json_form import read_form, strict_form

LENGTH = struct.Struct(">Q")
"""What stands before each frame: its length [byte]."""

MAX_ANSWER_BYTES = 64 << 20
"""Largest answer that is passed on [byte]; a chunk of 1,000 actions of 7 numbers takes 56,000."""

MAX_LINK_BYTES = 4 * MAX_ANSWER_BYTES
"""Largest frame of a process [byte]; one batch is one frame."""

MAX_HEAD_BYTES = 4 << 20
"""Largest part of a frame that is no array [byte]: errors, and what a policy declares."""

MAX_OBJECTS = 1 << 20

_SIZES = struct.Struct(">QI")
_Size = Annotated[int, Field(ge=0, le=MAX_ANSWER_BYTES)]
ArrayForm = tuple[Annotated[str, Field(max_length=40)], Annotated[tuple[_Size, ...], Field(max_length=32)]]
"""The text of an array's type and its shape; what holds Python objects has no bytes."""


@strict_form
@dataclass(frozen=True, slots=True)
class Declared:
    """What a policy says about itself when it is loaded.

    Attributes:
        batches: Whether it answers several observations at once.
        source: Name and fingerprint of the file that it was loaded from, or empty.
    """

    name: str
    action_space: str
    needs_images: bool
    metadata: dict[str, str]
    horizon: int | None
    ahead: int
    ensemble: float | None
    heavy: bool
    batches: bool
    source: str

    @property
    def info(self) -> PolicyInfo:
        """The same as the run knows it; raises what PolicyInfo raises."""
        return PolicyInfo(
            self.name,
            self.action_space,
            self.needs_images,
            self.metadata,
            Execution(self.horizon, self.ahead, self.ensemble),
            self.heavy,
        )


@strict_form
@dataclass(frozen=True, slots=True)
class ProcessAnswer:
    """What a process sends.

    Attributes:
        number: Number of the question, 0 for that it has loaded its policy.
        arrays: Types and shapes of the arrays that follow.
        error: Class of the error of betterbench that was raised, empty for another one, or None.
        texts: Texts of the error.
        declared: What the policy says about itself, once.
    """

    number: Annotated[int, Field(ge=0)]
    arrays: tuple[ArrayForm, ...] = ()
    error: str | None = None
    texts: tuple[str, ...] = ()
    declared: Declared | None = None


_ANSWER = TypeAdapter(ProcessAnswer)
# Bound here, before a policy can put something else into the place of the function.
_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode
_pack, _array = _SIZES.pack, np.asarray


def text_of(value: object) -> str:
    """Return a text that can be written, of whatever a policy calls one."""
    return str.encode(str(value), "utf-8", "backslashreplace").decode()


def plain_array(answer: object) -> tuple[ArrayForm, bytes]:
    """Return an answer as an array without objects; raise ValueError if it is too large."""
    array = _array(answer)
    if array.nbytes > MAX_ANSWER_BYTES:
        raise ValueError(f"an answer of {array.nbytes} bytes is no chunk of actions")
    return (array.dtype.str, array.shape), b"" if array.dtype.hasobject else array.tobytes()


def answer_frame(answer: ProcessAnswer, data: Sequence[bytes] = ()) -> bytes:
    """Return the frame of an answer and its arrays, with its length before it; ValueError if it is too large."""
    head = _encode(asdict(answer)).encode("ascii")
    size = _SIZES.size - LENGTH.size + len(head) + sum(map(len, data))
    if size > MAX_LINK_BYTES or len(head) > MAX_HEAD_BYTES:
        raise ValueError(f"{size} bytes are no answer")
    return b"".join([_pack(size, len(head)), head, *data])


def read_answer(frame: bytes) -> tuple[ProcessAnswer, list[np.ndarray]]:
    """Return what a process has sent, and its arrays; raise PolicyError if it is no answer."""
    begin = _SIZES.size - LENGTH.size
    length = int.from_bytes(frame[:begin], "big")
    at = begin + length
    if len(frame) < begin or length > MAX_HEAD_BYTES or at > len(frame):
        raise PolicyError("a frame that is cut off")
    answer = read_form(_ANSWER, frame[begin:at], where="an answer", cure="Leave its socket alone", raises=PolicyError)
    arrays = []
    for kind, shape in answer.arrays:
        array, at = _read_array(frame, at, kind, shape)
        arrays.append(array)
    if at != len(frame):
        raise PolicyError("an answer with bytes too many")
    return answer, arrays


def _read_array(frame: bytes, at: int, kind: str, shape: tuple[int, ...]) -> tuple[np.ndarray, int]:
    """Return the array that begins at a byte of a frame, and where the next one does."""
    try:
        dtype = np.dtype(kind)
        count = math.prod(shape)
        if dtype.hasobject:
            return np.empty(shape if count <= MAX_OBJECTS else 0, object), at
        if not count:
            return np.zeros(shape, dtype), at
        end = at + count * dtype.itemsize
        return np.frombuffer(bytearray(frame[at:end]), dtype, count).reshape(shape), end
    except (TypeError, ValueError, SyntaxError) as error:
        raise PolicyError(f"an array that is none ({error})") from error
