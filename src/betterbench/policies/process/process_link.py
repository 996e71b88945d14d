"""Messages between a run and the process of a policy: frames on a socket, and answers without Python objects.

A request of the run is pickled. An answer is JSON and the bytes of arrays, because a policy can write anything to its
socket. The run reads answers in :mod:`betterbench.policies.process.process_reader`. JSON validation is not imported
here, so that the process of a policy starts fast.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from betterbench.interface import Execution, PolicyInfo

LENGTH = struct.Struct(">Q")
"""Header of each frame: its length [byte]."""

MAX_ANSWER_BYTES = 64 << 20
"""Largest answer [byte]; a chunk of 1,000 actions of 7 numbers takes 56,000."""

MAX_LINK_BYTES = 4 * MAX_ANSWER_BYTES
"""Largest frame of a process [byte]; one batch is one frame."""

MAX_HEAD_BYTES = 4 << 20
"""Largest head of a frame [byte]: everything except the arrays, such as errors and declarations."""

SIZES = struct.Struct(">QI")
"""Format of the length of a frame and the length of its head [byte]."""

ArrayForm = tuple[str, tuple[int, ...]]
"""Type string and shape of an array; arrays of Python objects are sent without bytes."""


@dataclass(frozen=True, slots=True)
class Declared:
    """Declarations that a policy sends when it is loaded.

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
    cameras: list[str] | None = None

    @property
    def info(self) -> PolicyInfo:
        """The declarations as a PolicyInfo; raises the errors of PolicyInfo."""
        return PolicyInfo(
            self.name,
            self.action_space,
            self.needs_images,
            self.metadata,
            Execution(self.horizon, self.ahead, self.ensemble),
            self.heavy,
            None if self.cameras is None else tuple(self.cameras),
        )


@dataclass(frozen=True, slots=True)
class ProcessAnswer:
    """Message of a policy's process: an answer, or an error.

    Attributes:
        number: Number of the request; 0 for the message that the policy is loaded.
        arrays: Types and shapes of the arrays that follow.
        error: Class name of a raised error of betterbench, empty for another exception, None without an error.
        texts: Texts of the error.
        declared: Declarations of the policy, in the first message only.
    """

    number: int
    arrays: tuple[ArrayForm, ...] = ()
    error: str | None = None
    texts: tuple[str, ...] = ()
    declared: Declared | None = None


# Bound at import, before a policy can replace the function.
_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode
_pack, _array = SIZES.pack, np.asarray


def text_of(value: object) -> str:
    """Return a printable text from any value that a policy uses as a text."""
    return str.encode(str(value), "utf-8", "backslashreplace").decode()


def plain_array(answer: object) -> tuple[ArrayForm, bytes]:
    """Return an answer as an array without objects; raise ValueError if it is too large."""
    array = _array(answer)
    if array.nbytes > MAX_ANSWER_BYTES:
        raise ValueError(f"an answer of {array.nbytes} bytes is too large")
    return (array.dtype.str, array.shape), b"" if array.dtype.hasobject else array.tobytes()


def answer_frame(answer: ProcessAnswer, data: Sequence[bytes] = ()) -> bytes:
    """Return the frame of an answer and its arrays, preceded by its length; ValueError if it is too large."""
    head = _encode(asdict(answer)).encode("ascii")
    size = SIZES.size - LENGTH.size + len(head) + sum(map(len, data))
    if size > MAX_LINK_BYTES or len(head) > MAX_HEAD_BYTES:
        raise ValueError(f"an answer of {size} bytes is too large")
    return b"".join([_pack(size, len(head)), head, *data])
