"""Sampler of a mixture. Each draw depends only on the seed and the number of the draw.

Draw *n* is the point ``(offset + n * GOLDEN) mod 2**64`` of the unit interval, which the data sets divide by their
shares. Multiples of the golden ratio are spread very evenly, because no number is approximated worse by fractions
(Weyl's equidistribution theorem). After N draws, the count of each data set is therefore within a few draws of ``share
* N``. The error of independent draws grows with the square root of N instead. A data set's number of draws before draw
*n* is a sum of floors, which Euclid's algorithm computes directly. Draw *n* is then the next item in a random order of
the data set, so no item is repeated before every item has been drawn once.

The state of a sampler is therefore a single number, and a sampler can begin at any draw. Any number of processes
together draw what a single process would draw.
"""

from __future__ import annotations

import bisect
import hashlib
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from betterbench.errors import InvalidInputError, RunConflictError, require_between
from betterbench_calibration.mixture.shares import MixturePart

_ONE = 1 << 64
GOLDEN = 0x9E3779B97F4A7C15
"""2**64 divided by the golden ratio, rounded to an odd number."""

_ROUNDS = 4
_MIX = (0xBF58476D1CE4E5B9, 0x94D049BB133111EB)
"""Multipliers of splitmix64 (Steele, Lea and Flood, OOPSLA 2014)."""

_NEAR = 512
"""Maximum number of draws that are counted one by one. For more draws, a formula is faster."""

MOST_DRAWS = 1 << 48
"""Maximum number of draws of a sampler, far above any training."""


@dataclass(frozen=True, slots=True)
class MixtureDraw:
    """A draw from a mixture, with its number, the data set, the item, and the number of earlier passes over the set."""

    number: int
    part: str
    item: int
    epoch: int


class MixtureSampler:
    """Sampler of a mixture in an order that depends only on the seed. Iterating again continues where it stopped.

    Each training process creates a sampler with its own ``shard``. The draws in a step are then consecutive in the
    common order, for any number of processes.

    Args:
        parts: The data sets with their shares, as :func:`~betterbench_calibration.mixture.shares_of` returns them.
        seed: Seed of the order.
        shard: Number of this process, from 0.
        shards: Number of processes.
        draws: Total number of draws over all shards after which the sampler ends. If None, it never ends.

    Raises:
        InvalidInputError: If the shard does not exist, or shares do not add up to 1.
    """

    def __init__(
        self, parts: Sequence[MixturePart], *, seed: int = 0, shard: int = 0, shards: int = 1, draws: int | None = None
    ) -> None:
        require_between("shards", shards, 1, 1 << 20)
        require_between("shard", shard, 0, shards - 1)
        require_between("draws", MOST_DRAWS if draws is None else draws, 0, MOST_DRAWS)
        shares = [part.share for part in parts]
        if not shares or abs(math.fsum(shares) - 1.0) > 1e-9:
            raise InvalidInputError(
                "shares", f"they add up to {math.fsum(shares):g}", "Compute the shares with shares_of"
            )
        self._parts, self._seed, self._shard, self._shards = tuple(parts), seed, shard, shards
        self._draws = MOST_DRAWS if draws is None else draws
        sums = list(itertools.accumulate(shares))
        self._borders = [min(_ONE, round(total * _ONE)) for total in sums[:-1]] + [_ONE]
        self._offset = _number(f"{seed} offset")
        self._identity = _identity(parts, seed)
        self._position = 0
        self._counted, self._counts = 0, [0] * len(parts)

    def __len__(self) -> int:
        """Return the number of remaining draws of this shard."""
        return max(0, -(-(self._draws - self._position - self._shard) // self._shards))

    def __iter__(self) -> Iterator[MixtureDraw]:
        """Yield the remaining draws of this shard."""
        while self._position + self._shard < self._draws:
            drawn = self.draw(self._position + self._shard)
            self._position += self._shards
            yield drawn

    def draw(self, number: int) -> MixtureDraw:
        """Return a draw by its number in the complete mixture."""
        require_between("draw", number, 0, MOST_DRAWS - 1)
        self._count_to(number)
        index = self._index(number)
        part = self._parts[index]
        epoch, turn = divmod(self._counts[index], part.items)
        return MixtureDraw(number, part.name, _permuted(turn, part.items, f"{self._seed} {epoch} {part.name}"), epoch)

    def own(self, index: int) -> MixtureDraw:
        """Return a draw by its number in this shard."""
        return self.draw(index * self._shards + self._shard)

    def counts(self, draws: int) -> dict[str, int]:
        """Return the number of draws per data set among the first ``draws`` draws over all shards."""
        return {part.name: self._before(index, draws) for index, part in enumerate(self._parts)}

    def state_dict(self) -> dict[str, Any]:
        """Return the state: the number of draws so far over all shards, the mixture and the seed.

        The state is valid for every shard, and for any other number of shards if all shards have drawn equally often.
        """
        return {"position": self._position, "identity": self._identity}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Resume from the saved state of a sampler for this mixture.

        Raises:
            RunConflictError: If the state is from a different mixture or seed.
            InvalidInputError: If it is not a state of a sampler.
        """
        position = state.get("position")
        if not isinstance(position, int) or isinstance(position, bool) or not 0 <= position <= MOST_DRAWS:
            raise InvalidInputError(
                "state of the sampler: position", f"{position!r} is not a number of draws", "Start anew"
            )
        if state.get("identity") != self._identity:
            raise RunConflictError(
                "this sampler state is from a different mixture or seed. "
                "Use the original mixture and seed, or start again."
            )
        self._position = position

    def _index(self, number: int) -> int:
        return bisect.bisect_right(self._borders, (self._offset + number * GOLDEN) % _ONE)

    def _count_to(self, number: int) -> None:
        """Set the counts to the values before a draw, by steps if it is near and by formula otherwise."""
        if not 0 <= number - self._counted <= _NEAR:
            self._counts = [self._before(index, number) for index in range(len(self._parts))]
            self._counted = number
        for passed in range(self._counted, number):
            self._counts[self._index(passed)] += 1
        self._counted = number

    def _before(self, index: int, number: int) -> int:
        """Return the number of draws among the first ``number`` that belong to a data set."""
        low = self._borders[index - 1] if index else 0
        return self._below(self._borders[index], number) - self._below(low, number)

    def _below(self, border: int, number: int) -> int:
        """Return the number of points among the first ``number`` that are below a border."""
        whole = _floor_sum(number, _ONE, GOLDEN, self._offset + _ONE)
        return whole - _floor_sum(number, _ONE, GOLDEN, self._offset + _ONE - border)


def _floor_sum(n: int, m: int, a: int, b: int) -> int:
    """Return the sum of ``(a * i + b) // m`` for i from 0 to n - 1 (Euclid's algorithm on the lattice points below)."""
    total = 0
    while n:
        total += n * (n - 1) // 2 * (a // m) + n * (b // m)
        a, b = a % m, b % m
        top = a * n + b
        n, b, m, a = top // m, top % m, a, m
    return total


def _permuted(turn: int, size: int, key: str) -> int:
    """Return an item's index at ``turn`` in a random order of ``range(size)`` (cycle-walking Feistel network)."""
    half = max(1, (max(size - 1, 1).bit_length() + 1) // 2)
    mask, keys = (1 << half) - 1, _round_keys(key)
    value = turn
    while True:
        left, right = value >> half, value & mask
        for number in keys:
            left, right = right, left ^ (_mixed(right ^ number) & mask)
        value = left << half | right
        if value < size:
            return value


@lru_cache(maxsize=4096)
def _round_keys(key: str) -> tuple[int, ...]:
    return tuple(_number(f"{key} {i}") for i in range(_ROUNDS))


def _mixed(value: int) -> int:
    for multiplier in _MIX:
        value = ((value ^ (value >> 29)) * multiplier) % _ONE
    return value ^ (value >> 32)


def _number(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")


def _identity(parts: Sequence[MixturePart], seed: int) -> str:
    told = [[part.name, part.items, repr(part.share)] for part in parts]
    return hashlib.sha256(repr([seed, told]).encode()).hexdigest()[:16]
