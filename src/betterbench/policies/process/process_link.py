"""Messages between a run and the process of a policy. :mod:`betterbench.jobs.frames` sends and receives them.

A request from the run is pickled and sent as a byte array. A request without arrays ends the process. An answer must
not contain pickled Python objects, because an untrusted policy could write anything to its socket. The run reads
answers in :mod:`betterbench.policies.process.process_reader`. This module does not import the code that checks answers,
so that the process of a policy starts fast.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from betterbench.interface import Execution, PolicyInfo
from betterbench.jobs.frames import MAX_ARRAY_BYTES, FrameContent

MAX_ANSWER_BYTES = 64 << 20
"""Largest answer [bytes]. A chunk of 1,000 actions with 7 numbers takes 56,000 bytes."""


@dataclass(frozen=True, slots=True)
class Declared:
    """Description that a policy sends after it has been loaded.

    Attributes:
        batches: Whether the policy answers several observations in one call.
        source: Name and SHA-256 of the file from which the policy was loaded, or an empty string.
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
        """Description of the policy, converted to a PolicyInfo."""
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
    """Message from the process of a policy: an answer or an error.

    Attributes:
        error: Class name of the error if it is one of betterbench's own errors, an empty string for any other
            exception, or None if there was no error.
        texts: Texts of the error.
        declared: Description of the policy. Only the first message contains it.
    """

    error: str | None = None
    texts: tuple[str, ...] = ()
    declared: Declared | None = None


# This function is stored here before the policy can replace it.
_array = np.asarray


def text_of(value: object) -> str:
    """Convert a value from a policy to a string that can be encoded as UTF-8."""
    return str.encode(str(value), "utf-8", "backslashreplace").decode()


def content_of(answer: ProcessAnswer, given: Sequence[object] = ()) -> FrameContent:
    """Return the content of a message with a policy's answer.

    ``given`` contains the values that the policy returned. They are converted to arrays. Raises ValueError if the
    message would be too large.
    """
    arrays = [_array(one) for one in given]
    for array in arrays:
        if array.nbytes > MAX_ANSWER_BYTES:
            raise ValueError(f"an answer of {array.nbytes} bytes is too large")
    if (size := sum(array.nbytes for array in arrays)) > MAX_ARRAY_BYTES:
        raise ValueError(f"an answer of {size} bytes is too large")
    return asdict(answer), {f"{place}": array for place, array in enumerate(arrays)}
