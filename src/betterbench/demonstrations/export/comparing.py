"""Comparison of a data set with its expected content. The error message describes the first difference."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np
import pyarrow as pa

from betterbench.errors import BetterError, InvalidInputError, one_line
from betterbench.jobs.conflict import first_difference
from betterbench.json_form import parse_json

ReadPictures = Callable[[str, Sequence[int]], Mapping[int, np.ndarray]]
"""Function that takes the name of an image column and some rows of an episode, and returns the image of each row."""

CURE = "Export the data set again into another folder"

LEVEL = "a number from 0 to 1"
"""Placeholder for the expected value of an image statistic, because image statistics are not computed again."""

_CLOSE = 1e-9
"""Maximum relative difference between two numbers that are considered equal.

Other versions of NumPy may sum in a different order.
"""

_ROOT = "$"
_MOST_OF_A_FIELD = 200
"""Maximum number of characters of a field name in a message, because the names come from untrusted files."""


def require_match(there: object, wanted: object, where: str) -> None:
    """Raise InvalidInputError unless a JSON value equals the expected value.

    Non-integer numbers may differ by rounding.

    Args:
        there: Value in the data set.
        wanted: Expected value.
        where: Name of the file and the field, for the error message.
    """
    wanted = parse_json(json.dumps(wanted))
    require_equal(_settled(there, wanted), wanted, where)


def require_equal(there: object, wanted: object, where: str) -> None:
    """Raise InvalidInputError unless two JSON values are exactly equal, including their types."""
    found = first_difference(there, wanted, _ROOT)
    if found is None:
        return
    name, was, should = found
    before, _, field = name.partition(_ROOT)
    shown = one_line(before + (field.removeprefix(".") or "it"), most=_MOST_OF_A_FIELD)
    raise InvalidInputError(where, f"{shown} is {was}, expected {should}", CURE)


@contextmanager
def intact(where: str) -> Iterator[None]:
    """Return a context manager that raises InvalidInputError if a part of a data set is damaged and cannot be read."""
    try:
        yield
    except BetterError:
        raise
    except _BROKEN as error:
        said = one_line(error, most=_MOST_OF_A_FIELD) or type(error).__name__
        raise InvalidInputError(where, f"it is damaged ({said})", CURE) from error


_BROKEN = (
    OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError, MemoryError,
    pa.ArrowException,
)  # fmt: skip
"""Exceptions that can occur when a damaged or unknown file is read."""


def _settled(there: object, wanted: object) -> object:
    """Convert a value from a data set so that it can be compared with the expected JSON value.

    A number that is close to the expected number is replaced by the expected number. Values that JSON cannot represent
    are converted to strings.
    """
    if isinstance(there, dict):
        known = wanted if isinstance(wanted, dict) else {}
        return {str(name): _settled(value, known.get(name)) for name, value in there.items()}
    if isinstance(there, list):
        items = wanted if isinstance(wanted, list) else []
        return [_settled(value, items[i] if i < len(items) else None) for i, value in enumerate(there)]
    if isinstance(there, (int, float)) and not isinstance(there, bool):
        if wanted == LEVEL:
            return LEVEL if 0.0 <= there <= 1.0 else there
        if isinstance(wanted, float) and math.isclose(there, wanted, rel_tol=_CLOSE, abs_tol=_CLOSE):
            return wanted
    return there if there is None or isinstance(there, (str, int, float)) else str(there)
