"""Rows: all numbers of a control step concatenated in one array. Their layout is sent once, at the start of an episode.

Between two control steps, other data replaces these arrays in the CPU caches. Sending and receiving twenty arrays
therefore takes twenty times as long as sending and receiving one array. Like :mod:`betterbench.jobs.frames`, this
module is imported in environments in which betterbench is not installed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

MAX_NUMBERS = 1 << 20
"""Maximum number of values in a row."""


def row_of(arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """Concatenate arrays into one float64 array (n,)."""
    return np.concatenate(tuple(arrays.values()), axis=None)


def form_of(arrays: Mapping[str, np.ndarray]) -> list[list[Any]]:
    """Return the layout of a row: the name and shape of each array in order, as JSON data for :class:`RowForm`."""
    return [[name, list(array.shape)] for name, array in arrays.items()]


class RowForm:
    """Layout of a row, i.e. the position and the shape of each array in it."""

    def __init__(self, form: object) -> None:
        """Read the layout that :func:`form_of` returned. Raises ValueError or TypeError if it is malformed."""
        if not isinstance(form, list):
            raise TypeError("the layout of the rows is missing or is not a list")
        self.places: dict[str, slice] = {}
        self.shapes: dict[str, tuple[int, ...]] = {}
        at = 0
        for entry in form:
            name, shape = entry if isinstance(entry, list) and len(entry) == 2 else (None, None)
            if not isinstance(name, str) or not isinstance(shape, list) or name in self.places:
                raise ValueError(
                    f"each entry of the rows' layout must be a unique name and a shape, got {str(entry)[:60]}"
                )
            if not all(type(length) is int and 0 <= length <= MAX_NUMBERS for length in shape):
                raise ValueError(f"the rows' layout gives {name[:40]!r} the invalid shape {str(shape)[:60]}")
            end = at + math.prod(shape)
            self.places[name], self.shapes[name] = slice(at, end), tuple(shape)
            at = end
        if at > MAX_NUMBERS:
            raise ValueError(f"the rows have {at} numbers, expected at most {MAX_NUMBERS}")
        self.size = at

    def array(self, row: np.ndarray, name: str) -> np.ndarray:
        """Return the array with the given name, as a view of the row (n,) with the shape of the array."""
        return row[self.places[name]].reshape(self.shapes[name])

    def not_finite(self, row: np.ndarray) -> Sequence[str]:
        """Return the names of the arrays in a row that contain a non-finite number."""
        return [name for name, place in self.places.items() if not np.isfinite(row[place]).all()]
