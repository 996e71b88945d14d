"""Description of the data that an audit read: episodes, instructions, grippers and positions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from betterbench.wording import plural


@dataclass(frozen=True, slots=True)
class GripperReading:
    """Source and range of a gripper's values, and the closed end of the range.

    Attributes:
        arm: Arm of the gripper; "" if there is only one arm.
        source: Column and component that were read, with the reason for this choice.
        low: Smallest value, without the lowest 1 %.
        high: Largest value, without the highest 1 %.
        closed: Closed end of the range: ``low`` or ``high``.
        because: Reason for choosing this end.
        share_closed: Fraction of the frames in which the gripper is closed.
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
    """Source of the positions of one arm.

    Attributes:
        arm: Arm; "" if there is only one arm.
        source: Columns and components that were read, with the reason for this choice.
        space: Kind of values: ``position``, ``joints`` (two principal components of the joints), ``numbers`` (two
            principal components of unnamed values) or ``steps`` (sums of the actions).
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
        observations: Description of the segments if the audit compares segments with one instruction each; "" if it
            compares complete episodes.
        instruction: Source of the instructions, and number of different instructions.
        grippers: One entry per arm; empty for records of betterbench, where grasps are read from the states.
        places: One entry per arm.
        about: Additional sentences about the sources.
        left_out: Data that were not read, with the reasons.
        warnings: Problems in the data that may lead to wrong findings.
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
    """Format a count with its noun, e.g. "1 episode" or "1,200 episodes"."""
    return f"{count:,} {plural(count, one).partition(' ')[2]}"
