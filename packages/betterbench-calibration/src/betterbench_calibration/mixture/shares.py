"""Shares of the data sets in a mixture, computed from the weights of groups and a rule inside each group.

The number of draws from a group is proportional to its weight, regardless of its size, as in the paper and in Being-H.
The paper uses a weight of 8.0 for all actions and of 0.5 for each set of questions, which gives 80 % and 5 % of the
draws. In the mixtures of Open X-Embodiment and GR00T, each weight is instead multiplied by the number of items. The
rule ``weights-times-items`` does the same inside a group.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from betterbench.errors import InvalidInputError

Within = Literal["items", "equal", "weights", "weights-times-items"]
"""Rule that divides the draws of a group among its data sets."""


@dataclass(frozen=True, slots=True)
class MixturePart:
    """Data set in a mixture.

    Attributes:
        name: Name of the data set, which is unique in the mixture.
        group: Name of the group.
        items: Number of frames or questions.
        weight: Weight inside the group, for rules that use weights.
        share: Fraction of all draws.
    """

    name: str
    group: str
    items: int
    weight: float = 1.0
    share: float = 0.0


@dataclass(frozen=True, slots=True)
class WeightedGroup:
    """Group of data sets with a common weight. The rule ``within`` divides the draws of the group among them."""

    name: str
    weight: float
    parts: tuple[MixturePart, ...]
    within: Within = "items"


def shares_of(groups: Sequence[WeightedGroup]) -> tuple[MixturePart, ...]:
    """Return the data sets of all groups with their shares, which add up to 1.

    Raises:
        InvalidInputError: If there are no data sets, if a name occurs twice, if a data set is empty, or if weights are
            negative, not finite or all 0.
    """
    named = Counter(part.name for group in groups for part in group.parts)
    for name, times in named.items():
        if times > 1:
            raise InvalidInputError(
                name, f"{times} data sets of the mixture have this name", "Give each data set a different name"
            )
    total = _total("weight", [(group.name, group.weight) for group in groups])
    found: list[MixturePart] = []
    for group in groups:
        amounts = [(part.name, _amount(group.within, part)) for part in group.parts]
        inside = _total(f"weights inside {group.name}", amounts)
        for part, (_, amount) in zip(group.parts, amounts, strict=True):
            share = group.weight / total * (amount / inside)
            found.append(MixturePart(part.name, group.name, part.items, part.weight, share))
    return tuple(found)


def _amount(within: Within, part: MixturePart) -> float:
    if part.items < 1:
        raise InvalidInputError(part.name, "it has no items to draw", "Leave out this data set, or name another file")
    match within:
        case "items":
            return float(part.items)
        case "equal":
            return 1.0
        case "weights":
            return part.weight
        case "weights-times-items":
            return part.weight * part.items


def _total(what: str, amounts: Sequence[tuple[str, float]]) -> float:
    """Return the sum of amounts. Raises InvalidInputError for an invalid amount or a sum of 0."""
    for name, amount in amounts:
        if not math.isfinite(amount) or amount < 0.0:
            raise InvalidInputError(f"{name}: weight", f"{amount:g} is not a weight", "Give a number ≥ 0")
    total = math.fsum(amount for _, amount in amounts)
    if total <= 0.0:
        raise InvalidInputError(what, "they add up to 0, so nothing can be drawn", "Give at least one above 0")
    return total
