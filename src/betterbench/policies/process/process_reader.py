"""Checks of the messages from the process of a policy, which is not trusted."""

from __future__ import annotations

import numpy as np
from pydantic import TypeAdapter

from betterbench.errors import PolicyError
from betterbench.jobs.frames import FrameContent
from betterbench.json_form import read_form, strict_form
from betterbench.policies.process.process_link import Declared, ProcessAnswer

strict_form(Declared)
_ANSWER = TypeAdapter(strict_form(ProcessAnswer))


def read_answer(content: FrameContent) -> tuple[ProcessAnswer, list[np.ndarray]]:
    """Return the answer in a message and its arrays, which may be modified.

    Raises PolicyError if the message is malformed.
    """
    document, arrays = content
    answer = read_form(
        _ANSWER,
        document,
        where="an answer",
        cure="The policy must not use the socket of its process",
        raises=PolicyError,
    )
    if list(arrays) != [str(place) for place in range(len(arrays))]:
        raise PolicyError("the arrays of the answer are out of order")
    return answer, [array.copy() for array in arrays.values()]
