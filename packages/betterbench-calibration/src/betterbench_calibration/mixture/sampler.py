"""Sampler of a mixture. Each draw depends only on the seed and the number of the draw.

The data sets divide the range of 64-bit integers in proportion to their shares. Draw *n* is from the data set to which
the number ``(offset + n * GOLDEN) mod 2**64`` belongs. These numbers are spread very evenly over the range (golden
ratio sequence). After N draws, the number of draws of each data set therefore differs from ``share * N`` by only a few
draws. With independent random draws, the difference would grow with the square root of N.

The number of earlier draws from the same data set is a sum of floors, which Euclid's algorithm computes directly. It
determines the item: draw *n* is the next item in a random order of the data set, so no item is repeated before every
item has been drawn once.

The state of a sampler is therefore a single number, and a sampler can start at any draw. Several processes together
draw the same items as a single process would.
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
"""2**64 divided by the golden ratio, rounded to an odd integer."""

_ROUNDS = 4
_MIX = (0xBF58476D1CE4E5B9, 0x94D049BB133111EB)
"""Multipliers of splitmix64 (Steele, Lea and Flood, OOPSLA 2014)."""

_NEAR = 512
"""Maximum number of draws that are counted one by one. For more draws, the sum of floors is faster."""

MOST_DRAWS = 1 << 48
"""Maximum number of draws of a sampler. It is far above the number of samples in any training run."""


@dataclass(frozen=True, slots=True)
class MixtureDraw:
    """Draw from a mixture.

    Attributes:
        number: Number of the draw, from 0.
        part: Name of the data set.
        item: Index of the item in the data set.
        epoch: Number of completed passes over the data set.
    """

    number: int
    part: str
    item: int
    epoch: int


class MixtureSampler:
    """Iterator over the draws of a mixture, in an order that depends only on the seed.

    A new iteration continues where the last one stopped. Each training process creates a sampler with its own
    ``shard``. The processes then draw in turn from the same sequence of draws, for any number of processes.

    Args:
        parts: Data sets with their shares, as returned by :func:`~betterbench_calibration.mixture.shares_of`.
        seed: Seed of the order.
        shard: Index of this process, from 0.
        shards: Number of processes.
        draws: Total number of draws over all shards. If None, the iteration never ends.

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
        """Return the draw with a given number, counted over all shards."""
        require_between("draw", number, 0, MOST_DRAWS - 1)
        self._count_to(number)
        index = self._index(number)
        part = self._parts[index]
        epoch, turn = divmod(self._counts[index], part.items)
        return MixtureDraw(number, part.name, _permuted(turn, part.items, f"{self._seed} {epoch} {part.name}"), epoch)

    def own(self, index: int) -> MixtureDraw:
        """Return the draw with a given number, counted within this shard."""
        return self.draw(index * self._shards + self._shard)

    def counts(self, draws: int) -> dict[str, int]:
        """Return how many of the first ``draws`` draws, over all shards, are from each data set."""
        return {part.name: self._before(index, draws) for index, part in enumerate(self._parts)}

    def state_dict(self) -> dict[str, Any]:
        """Return the state: the number of draws so far over all shards, the mixture and the seed.

        If all shards have made the same number of draws, the state is valid for every shard and any number of shards.
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
        """Set the counts of earlier draws to their values before draw ``number``."""
        if not 0 <= number - self._counted <= _NEAR:
            self._counts = [self._before(index, number) for index in range(len(self._parts))]
            self._counted = number
        for passed in range(self._counted, number):
            self._counts[self._index(passed)] += 1
        self._counted = number

    def _before(self, index: int, number: int) -> int:
        """Return how many of the first ``number`` draws are from a data set."""
        low = self._borders[index - 1] if index else 0
        return self._below(self._borders[index], number) - self._below(low, number)

    def _below(self, border: int, number: int) -> int:
        """Return how many of the first ``number`` points are below a border."""
        whole = _floor_sum(number, _ONE, GOLDEN, self._offset + _ONE)
        return whole - _floor_sum(number, _ONE, GOLDEN, self._offset + _ONE - border)


def _floor_sum(n: int, m: int, a: int, b: int) -> int:
    """Return the sum of ``(a * i + b) // m`` for i from 0 to n - 1, with a method similar to Euclid's algorithm."""
    total = 0
    while n:
        total += n * (n - 1) // 2 * (a // m) + n * (b // m)
        a, b = a % m, b % m
        top = a * n + b
        n, b, m, a = top // m, top % m, a, m
    return total


def _permuted(turn: int, size: int, key: str) -> int:
    """Return element ``turn`` of a random permutation of ``range(size)``, by a cycle-walking Feistel network."""
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
