"""Reading of messages from the process of a policy; every part is checked, as a policy can send anything."""

from __future__ import annotations

import math

import numpy as np
from pydantic import TypeAdapter

from betterbench.errors import PolicyError
from betterbench.json_form import read_form, strict_form
from betterbench.policies.process.process_link import (
    LENGTH,
    MAX_ANSWER_BYTES,
    MAX_HEAD_BYTES,
    SIZES,
    ArrayForm,
    Declared,
    ProcessAnswer,
)

MAX_OBJECTS = 1 << 20
"""Maximum number of objects in an array whose content is left out."""

_LONGEST_KIND = 40
_MOST_AXES = 32

strict_form(Declared)
_ANSWER = TypeAdapter(strict_form(ProcessAnswer))


def read_answer(frame: bytes) -> tuple[ProcessAnswer, list[np.ndarray]]:
    """Return the message of a process and its arrays; raise PolicyError if it is invalid."""
    begin = SIZES.size - LENGTH.size
    length = int.from_bytes(frame[:begin], "big")
    at = begin + length
    if len(frame) < begin or length > MAX_HEAD_BYTES or at > len(frame):
        raise PolicyError("an incomplete frame")
    answer = read_form(_ANSWER, frame[begin:at], where="an answer", cure="Leave its socket alone", raises=PolicyError)
    if answer.number < 0 or not all(map(_is_array, answer.arrays)):
        raise PolicyError("an answer with a number or a shape out of range")
    arrays = []
    for kind, shape in answer.arrays:
        array, at = _read_array(frame, at, kind, shape)
        arrays.append(array)
    if at != len(frame):
        raise PolicyError("an answer with extra bytes")
    return answer, arrays


def _is_array(form: ArrayForm) -> bool:
    kind, shape = form
    return len(kind) <= _LONGEST_KIND and len(shape) <= _MOST_AXES and all(0 <= n <= MAX_ANSWER_BYTES for n in shape)


def _read_array(frame: bytes, at: int, kind: str, shape: tuple[int, ...]) -> tuple[np.ndarray, int]:
    """Return the array at an offset of a frame, and the offset after it."""
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
        raise PolicyError(f"an invalid array ({error})") from error
