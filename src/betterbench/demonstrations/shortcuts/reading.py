"""Description of the data of an audit: episodes, instructions, grippers and positions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from betterbench.statistics.wording import plural


@dataclass(frozen=True, slots=True)
class GripperReading:
    """Source, range and polarity of a gripper's values.

    Attributes:
        arm: Arm of the gripper; "" if there is only one.
        source: Column and component that were read, with the reason.
        low: Smallest value, without the lowest 1 %.
        high: Largest value, without the highest 1 %.
        closed: Closed end of the range: ``low`` or ``high``.
        because: Reason for this end.
        share_closed: Fraction of frames in which the gripper is closed.
        never: Number of episodes in which the gripper never closes.
    """

    arm: str
    source: str
    low: float
    high: float
    closed: str
    because: str
    share_closed: float
    never: int


@dataclass(frozen=True, slots=True)
class PlaceReading:
    """Source of one arm's positions.

    Attributes:
        arm: Arm; "" if there is only one.
        source: Columns and components that were read, with the reason.
        space: Kind of position values: ``position``, ``joints`` (two principal components of the joints), ``numbers``
            (two principal components of unnamed values) or ``steps`` (sums of the actions).
    """

    arm: str
    source: str
    space: str


@dataclass(frozen=True, slots=True)
class DataReading:
    """Description of the data that an audit read.

    Attributes:
        episodes: Number of episodes that were read.
        of: Number of episodes that the data set declares.
        observations: Description of the compared units, if these are segments with one instruction each.
        instruction: Source and number of the instructions.
        grippers: One entry per arm; empty for records of betterbench, whose states contain the grasps.
        places: One entry per arm.
        about: Additional sentences about the sources.
        left_out: Data that were not read, with the reason.
        warnings: Problems in the data that may cause wrong findings.
    """

    episodes: int
    of: int
    observations: str
    instruction: str
    grippers: tuple[GripperReading, ...] = ()
    places: tuple[PlaceReading, ...] = ()
    about: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def sentences(self) -> Iterator[str]:
        """Yield the sentences of the audit's first paragraph."""
        yield f"Read: {self.episodes:,} of {how_many(self.of, 'episode')}{self.observations}."
        yield f"Instruction: {self.instruction}."
        for found in self.grippers:
            yield (
                f"{_of('Gripper', found.arm)}: {found.source}; {found.low:.3g} to {found.high:.3g}, closed at the "
                f"{found.closed} end ({found.because}), closed in {100.0 * found.share_closed:.0f} % of the frames."
            )
        for place in self.places:
            yield f"{_of('Places', place.arm)}: {place.source}."
        yield from (f"{sentence}." for sentence in self.about)
        yield f"Left out: {'; '.join(self.left_out) or 'nothing'}."
        yield from (f"Warning: {warning}." for warning in self.warnings)

    @property
    def paragraph(self) -> str:
        """First paragraph of the audit."""
        return " ".join(self.sentences())


def _of(what: str, arm: str) -> str:
    return f"{what} of the {arm} arm" if arm else what


def how_many(count: int, one: str) -> str:
    """Return "1 episode", "1,200 episodes"."""
    return f"{count:,} {plural(count, one).partition(' ')[2]}"
