"""Readers and writers: numbers that the physics engine keeps in one place, as plain floats, at every control step.

Between two physics steps the processor's caches are cold, and an array operation costs several times what it does in a
benchmark of its own. Unpacking the memory itself takes a quarter of the time of indexing an array and listing it.
"""

from __future__ import annotations

import functools
import operator
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

Reader = Callable[[], tuple[Any, ...]]
"""Returns what is there now: numbers, or rows of numbers."""


def number_reader(array: np.ndarray, indices: Sequence[int]) -> Reader:
    """Return a function that reads some numbers of an array as they are when it is called.

    Args:
        array: (n,) float64, contiguous; it has to stay where it is in memory.
        indices: Which numbers, at least one.
    """
    low, high = min(indices), max(indices) + 1
    read = functools.partial(struct.Struct(f"{high - low}d").unpack_from, _memory(array), 8 * low)
    pick = _picker(indices)
    return read if pick is None else lambda: pick(read())


def row_reader(array: np.ndarray, rows: Sequence[int]) -> Reader:
    """Return a function that reads some rows of an array as they are when it is called.

    Args:
        array: (n, width) float64, contiguous; it has to stay where it is in memory.
        rows: Which rows.
    """
    if not rows:
        return tuple
    size = 8 * array.shape[1]
    memory = _memory(array)[size * min(rows) : size * (max(rows) + 1)]
    read = functools.partial(struct.Struct(f"{array.shape[1]}d").iter_unpack, memory)
    pick = _picker(rows)
    return (lambda: tuple(read())) if pick is None else (lambda: pick(tuple(read())))


def numbers_of(array: np.ndarray) -> memoryview[float]:
    """Return an array (n,) float64 as something whose numbers are read and set one by one in little time."""
    return _memory(array).cast("d")


def number_writer(array: np.ndarray) -> Callable[..., None]:
    """Return a function that writes its arguments into an array (n,) float64, all n of them."""
    return functools.partial(struct.Struct(f"{len(array)}d").pack_into, _memory(array), 0)


def _picker(indices: Sequence[int]) -> Callable[[tuple[Any, ...]], tuple[Any, ...]] | None:
    """Return what picks some indices out of the values from the least to the largest one; None if these are all."""
    low, high = min(indices), max(indices) + 1
    return None if list(indices) == list(range(low, high)) else operator.itemgetter(*(i - low for i in indices))


def _memory(array: np.ndarray) -> memoryview:
    if array.dtype != np.float64:
        raise TypeError(f"an array of {array.dtype} where float64 is due")
    return array.data.cast("B")
