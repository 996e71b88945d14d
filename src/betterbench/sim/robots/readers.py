"""Fast access to the physics engine's arrays as plain floats, for use at every control step.

Between two physics steps, the CPU caches are cold, so an array operation takes several times as long as in an isolated
benchmark. Unpacking the memory directly takes a quarter of the time of indexing an array and converting the result.
"""

from __future__ import annotations

import functools
import math
import operator
import struct
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

Reader = Callable[[], tuple[Any, ...]]
"""Function that returns the current values as a tuple of numbers or of rows of numbers."""

Speeds = tuple[tuple[float, ...], tuple[float, ...]]
"""Linear speeds [m/s] and angular speeds [rad/s] of all objects."""

_AT_REST = (0.0,) * 6
_Made = TypeVar("_Made")


def number_reader(array: np.ndarray, indices: Sequence[int]) -> Reader:
    """Return a function that reads the current values of the given elements of an array."""
    low, high = min(indices), max(indices) + 1
    read = functools.partial(struct.Struct(f"{high - low}d").unpack_from, _memory(array), 8 * low)
    pick = _picker(indices)
    return read if pick is None else lambda: pick(read())


def row_reader(array: np.ndarray, rows: Sequence[int]) -> Reader:
    """Return a function that reads the current values of the given rows of an array."""
    if not rows:
        return tuple
    size = 8 * array.shape[1]
    memory = _memory(array)[size * min(rows) : size * (max(rows) + 1)]
    unpack, pick = struct.Struct(f"{array.shape[1]}d").iter_unpack, _picker(rows)
    return _kept(memory, lambda now: tuple(unpack(now)) if pick is None else pick(tuple(unpack(now))))


def speed_reader(array: np.ndarray, free: Sequence[int], slides: Sequence[int]) -> Callable[[], Speeds]:
    """Return a function that reads the current speeds of objects.

    Args:
        array: Velocities of all degrees of freedom (nv,), a contiguous float64 array that must stay at the same memory
            address.
        free: Index of the first of the six degrees of freedom of each object, or -1 if the object is not free.
        slides: Index of the only degree of freedom of each object, or -1 if the object does not slide.
    """
    ends = [(d, d + 6) for d in free if d >= 0] + [(d, d + 1) for d in slides if d >= 0]
    first, last = min((a for a, _ in ends), default=0), max((b for _, b in ends), default=0)
    unpack, n = struct.Struct(f"{last - first}d").unpack, len(free)
    turning = tuple((i, slice(d - first, d - first + 6)) for i, d in enumerate(free) if d >= 0)
    sliding = tuple((i, d - first) for i, d in enumerate(slides) if d >= 0)

    def speeds(now: bytes) -> Speeds:
        velocities = unpack(now)
        linear, angular = [0.0] * n, [0.0] * n
        for i, its in turning:
            if (velocity := velocities[its]) != _AT_REST:
                vx, vy, vz, wx, wy, wz = velocity
                linear[i] = math.sqrt(vx * vx + vy * vy + vz * vz)
                angular[i] = math.sqrt(wx * wx + wy * wy + wz * wz)
        for i, dof in sliding:
            linear[i] = abs(velocities[dof])
        return tuple(linear), tuple(angular)

    return _kept(_memory(array)[8 * first : 8 * last], speeds)


def numbers_of(array: np.ndarray) -> memoryview[float]:
    """Return a float64 array (n,) as a memory view, which gives fast access to single elements."""
    return _memory(array).cast("d")


def number_writer(array: np.ndarray) -> Callable[..., None]:
    """Return a function that writes its n arguments into a float64 array (n,)."""
    return functools.partial(struct.Struct(f"{len(array)}d").pack_into, _memory(array), 0)


def _kept(memory: memoryview, make: Callable[[bytes], _Made]) -> Callable[[], _Made]:
    """Return a function that returns a value derived from memory.

    It computes the value again only if a byte of the memory has changed.
    """
    last = memory.tobytes()
    made = make(last)

    def read() -> _Made:
        nonlocal last, made
        now = memory.tobytes()
        if now != last:
            last, made = now, make(now)
        return made

    return read


def _picker(indices: Sequence[int]) -> Callable[[tuple[Any, ...]], tuple[Any, ...]] | None:
    """Return a function that selects the given indices from the values between the smallest and the largest index.

    The result is None if the indices select all of these values in order, so that no selection is needed.
    """
    low, high = min(indices), max(indices) + 1
    return None if list(indices) == list(range(low, high)) else operator.itemgetter(*(i - low for i in indices))


def _memory(array: np.ndarray) -> memoryview:
    if array.dtype != np.float64:
        raise TypeError(f"got an array of {array.dtype}, expected float64")
    return array.data.cast("B")
