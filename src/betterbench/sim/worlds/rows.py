"""Rows: all numbers of a control step in one array. The layout is sent once at the start of an episode.

Between two control steps the CPU's caches are cold, and sending and receiving twenty arrays takes twenty times as long
as one array. Like :mod:`betterbench.jobs.frames`, this module is imported in an environment without betterbench.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

MAX_NUMBERS = 1 << 20
"""Maximum number of values in a row."""


def row_of(arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return float64 arrays concatenated as one array (n,)."""
    return np.concatenate(tuple(arrays.values()), axis=None)


def form_of(arrays: Mapping[str, np.ndarray]) -> list[list[Any]]:
    """Return name and shape of each array, in order, as JSON data for :class:`RowForm`."""
    return [[name, list(array.shape)] for name, array in arrays.items()]


class RowForm:
    """Layout of a row: the position and shape of each array in it."""

    def __init__(self, form: object) -> None:
        """Read a form from :func:`form_of`. Raises ValueError or TypeError if it has another structure."""
        if not isinstance(form, list):
            raise TypeError("the form of its rows is missing")
        self.places: dict[str, slice] = {}
        self.shapes: dict[str, tuple[int, ...]] = {}
        at = 0
        for entry in form:
            name, shape = entry if isinstance(entry, list) and len(entry) == 2 else (None, None)
            if not isinstance(name, str) or not isinstance(shape, list) or name in self.places:
                raise ValueError(f"the form of its rows has the entry {str(entry)[:60]}")
            if not all(type(length) is int and 0 <= length <= MAX_NUMBERS for length in shape):
                raise ValueError(f"the form of its rows gives {name[:40]!r} the shape {str(shape)[:60]}")
            end = at + math.prod(shape)
            self.places[name], self.shapes[name] = slice(at, end), tuple(shape)
            at = end
        if at > MAX_NUMBERS:
            raise ValueError(f"its rows have {at} numbers")
        self.size = at

    def array(self, row: np.ndarray, name: str) -> np.ndarray:
        """Return one array of a row (n,) with its shape, as a view."""
        return row[self.places[name]].reshape(self.shapes[name])

    def not_finite(self, row: np.ndarray) -> Sequence[str]:
        """Return the names of the arrays in a row that contain a non-finite number."""
        return [name for name, place in self.places.items() if not np.isfinite(row[place]).all()]
