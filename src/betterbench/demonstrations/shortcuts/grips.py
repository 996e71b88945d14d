"""Detection of closings and openings of a gripper, and of the end of its range that means "closed"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from betterbench.demonstrations.shortcuts.lerobot_choice import Grip, polarity_of
from betterbench.demonstrations.shortcuts.lerobot_files import runs
from betterbench.demonstrations.shortcuts.numbers import tokens
from betterbench.errors import InvalidInputError

SHORTEST_S = 0.3
"""Minimum duration of a closed or open phase [s]. Shorter commands by teleoperators are not grasps."""
AGREEING = 0.9
"""Minimum fraction of the episodes that must begin at one end of the range for this end to count as open."""
WIDTH_M = (0.005, 0.15)
"""Minimum range and maximum value of gripper values that are interpreted as widths in meters [m]."""
IDLE_SHARE = 0.1
"""Minimum range of a gripper's values. A smaller range counts as noise of an idle arm.

The range is given as a fraction of the largest range of any gripper in the same column.
"""
_BETWEEN = 0.1
"""Maximum fraction of frames in the middle third of the range of a gripper that switches between two positions."""
_LEAST_RANGE = 1e-6

_Floats = npt.NDArray[np.float64]
_Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Jaws:
    """Range of a gripper's values, the threshold between open and closed, and the closed end of the range.

    Attributes:
        low: Smallest value, without the lowest 1 %.
        high: Largest value, without the highest 1 %.
        between: Threshold between open and closed.
        closed: The closed end of the range, ``low`` or ``high``.
        because: Reason for choosing this end.
        warning: Evidence against this choice; "" if there is none.
    """

    low: float
    high: float
    between: float
    closed: str
    because: str
    warning: str = ""


@dataclass(frozen=True, slots=True)
class Still:
    """Range of values of a gripper that never moves, with the evidence that it never moves.

    The evidence is "" if all values are equal.
    """

    low: float
    high: float
    reason: str = ""

    @property
    def told(self) -> str:
        """Text with the range and the evidence."""
        return f"which never moves (range {self.low:.3g} to {self.high:.3g}{self.reason})"


def still_ones(grips: Sequence[tuple[Grip, Sequence[_Floats]]], shortest: int) -> list[Still | None]:
    """Find the grippers that never move. Their values are constant, or vary only by the noise of an idle arm.

    Values are recognized as noise by comparison with another gripper. The other gripper must be in the same column, or
    in a column whose name differs only in the side (left or right). The values are noise in two cases. First, their
    range is less than :data:`IDLE_SHARE` of the other gripper's range. A gripper that switches between two positions is
    an exception, because its values may just have a different unit. Second, their range is smaller than the other
    gripper's range, and they change faster than a gripper can move.

    Args:
        grips: Each gripper with its values (T,) by episode.
        shortest: Minimum number of consecutive rows for which a gripper must be closed or open.

    Returns:
        The range of each gripper that never moves, and None for each gripper that moves.
    """
    ends = [_ends(np.concatenate(episodes)) for _, episodes in grips]
    found: list[Still | None] = []
    for (grip, episodes), (low, high) in zip(grips, ends, strict=True):
        beside = [
            (other_high - other_low, other.number.shown)
            for (other, _), (other_low, other_high) in zip(grips, ends, strict=True)
            if other is not grip and _sideless(other.number.column) == _sideless(grip.number.column)
        ]
        widest, shown = max(beside, default=(0.0, ""))
        if high - low < _LEAST_RANGE * max(1.0, abs(high)):
            found.append(Still(low, high))
        elif high - low >= widest:
            found.append(None)
        else:
            middle = (low + high) / 2.0
            sides = [(episode > middle).astype(np.int64) for episode in episodes]
            stays = [b - a for side in sides if side.min() < side.max() for a, b in runs(side)]
            stay = float(np.median(stays)) if stays else 0.0
            third = (high - low) / 6.0
            between = float(np.mean(np.abs(np.concatenate(episodes) - middle) < third))
            if high - low < IDLE_SHARE * widest and not (stay >= shortest and between < _BETWEEN):
                found.append(Still(low, high, f", under {100.0 * IDLE_SHARE:.0f} % of that of {shown}"))
            elif stays and stay < shortest:
                found.append(Still(low, high, f", smaller than that of {shown}, and it alternates as fast as noise"))
            else:
                found.append(None)
    return found


def _sideless(column: str) -> tuple[str, ...]:
    return tuple(word for word in tokens(column) if word not in ("left", "right", "l", "r") and not word.isdigit())


def _ends(values: _Floats) -> tuple[float, float]:
    """Return the range without the lowest and highest 1 %, or the full range if nearly all values are equal."""
    low, high = (float(value) for value in np.quantile(values, [0.01, 0.99]))
    if high - low < _LEAST_RANGE:
        low, high = float(values.min()), float(values.max())
    return low, high


def jaws_of(grip: Grip, episodes: Sequence[_Floats], side: str | None, where: str) -> Jaws:
    """Determine the range, the threshold and the closed end of a moving gripper.

    The closed end is inferred from the gripper's name ("width", "closed") and from values that look like widths in
    meters. If neither of them gives an answer, it is inferred from LeRobot's convention for ``gripper.pos`` (0 closed,
    100 open) and from the values at the beginning of the episodes. The two sources used in either step must not
    contradict each other.

    Args:
        grip: The gripper.
        episodes: Values of the gripper (T,), by episode.
        side: Closed end given by the user, ``low`` or ``high``.
        where: File name for error messages.

    Raises:
        InvalidInputError: If the closed end cannot be determined, or two sources disagree.
    """
    values = np.concatenate(episodes)
    low, high = _ends(values)
    between = _between(values, low, high)
    share = float(np.mean([episode[0] > between for episode in episodes]))
    begins = "high" if share >= AGREEING else "low" if share <= 1.0 - AGREEING else ""
    most = max(share, 1.0 - share)
    if side is not None:
        return Jaws(low, high, between, side, "--closed")
    strong = [told for told in (polarity_of(grip.number), _width(low, high)) if told is not None]
    if strong:
        if len({closed for closed, _ in strong}) > 1:
            told = " and ".join(f"{closed} ({why})" for closed, why in strong)
            raise InvalidInputError(where, f"{grip.number.shown} is closed at its {told} end", _cure(strong[0][0]))
        closed, why = strong[0]
        warning = ""
        if begins == closed:
            warning = f"{100.0 * most:.0f} % of the episodes begin with a closed gripper; is {closed} the closed end?"
        return Jaws(low, high, between, closed, why, warning)
    weak = []
    if begins:
        weak.append(("low" if begins == "high" else "high", f"{100.0 * most:.0f} % of the episodes begin open"))
    if _is_percent(grip, low, high):
        weak.append(("low", "LeRobot's gripper.pos is 0 when closed"))
    if len({closed for closed, _ in weak}) != 1:
        told = f"{low:.3g} to {high:.3g}, and {100.0 * share:.0f} % of the episodes begin at the high end"
        if len(weak) > 1:
            told = f"{weak[1][0]} by LeRobot's convention, but {weak[0][0]} if episodes begin open ({weak[0][1]})"
        problem = f"the closed end of {grip.number.shown} cannot be determined ({told})"
        raise InvalidInputError(where, problem, _cure("low"))
    return Jaws(low, high, between, weak[0][0], "; ".join(why for _, why in weak))


def _cure(side: str) -> str:
    return f"Pass --closed low or --closed high, for example --closed {side} if 0 means closed and 1 means open"


def _width(low: float, high: float) -> tuple[str, str] | None:
    """Return "low" as the closed end, with the reason, if the values look like widths in meters.

    Return None for other values.
    """
    least, most = WIDTH_M
    ok = high <= most and low >= -0.01 and high - low >= least
    return ("low", "the values are widths in meters") if ok else None


def _is_percent(grip: Grip, low: float, high: float) -> bool:
    """Return whether the values are LeRobot's ``gripper.pos``, i.e. percentages of the calibrated range."""
    return tokens(grip.number.name)[-2:] == ["gripper", "pos"] and low >= -1.0 and 2.0 < high <= 101.0


def _between(values: _Floats, low: float, high: float) -> float:
    """Return the threshold that minimizes the variance within the values below it and above it (Otsu's method)."""
    counts, edges = np.histogram(np.clip(values, low, high), bins=64, range=(low, high))
    middles = (edges[:-1] + edges[1:]) / 2.0
    below = np.cumsum(counts)[:-1].astype(np.float64)
    above = len(values) - below
    sums = np.cumsum(counts * middles)
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = below * above * (sums[:-1] / below - (sums[-1] - sums[:-1]) / above) ** 2
    spread = np.nan_to_num(spread, nan=0.0)
    best = np.flatnonzero(spread >= spread.max() * (1.0 - 1e-9))
    cut = float(edges[1:-1][best].mean())  # if all thresholds in a gap are equally good, use the center of the gap
    return min(max(cut, low + 0.25 * (high - low)), low + 0.75 * (high - low))


def held(values: _Floats) -> _Floats:
    """Replace each command 0 with the previous nonzero command if all commands (T,) are -1, 0 or 1.

    In such data sets, 0 means that the gripper keeps its last command.
    """
    if not np.isin(values, (-1.0, 0.0, 1.0)).all() or not (values == 0.0).any() or not (values < 0.0).any():
        return np.array(values)
    last = np.maximum.accumulate(np.where(values != 0.0, np.arange(len(values)), -1))
    first = values[np.flatnonzero(values)[0]]
    return np.where(last >= 0, values[np.maximum(last, 0)], -first)


def closed_in(values: _Floats, jaws: Jaws, shortest: int) -> _Bools:
    """Return whether the gripper is closed in each row, as a (T,) mask.

    Phases shorter than ``shortest`` rows are ignored, except at the beginning and the end of an episode.
    """
    closed = (values < jaws.between) if jaws.closed == "low" else (values > jaws.between)
    for begin, end in runs(closed.astype(np.int64)):
        if begin and end < len(closed) and end - begin < shortest:
            closed[begin:end] = closed[begin - 1]
    return np.asarray(closed, dtype=np.bool_)


def edges_of(closed: _Bools) -> tuple[list[int], list[int]]:
    """Return the rows in which a gripper closes, and the rows in which it opens.

    If the gripper is closed at the end of the episode, the last row counts as an opening.
    """
    edges = (np.flatnonzero(closed[1:] != closed[:-1]) + 1).tolist()
    closings = [edge for edge in edges if closed[edge]]
    openings = [edge for edge in edges if not closed[edge]]
    if closings and closed[-1]:
        openings.append(len(closed) - 1)
    return closings, openings
