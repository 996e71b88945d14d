"""Description of the data of an audit: episodes, instructions, grippers and places that were read or left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from betterbench.statistics.wording import plural


@dataclass(frozen=True, slots=True)
class GripperReading:
    """Source, range and polarity of the values of one gripper.

    Attributes:
        arm: Arm that it belongs to, "" if there is one alone.
        source: Column and number that were read, and why these.
        low: Least value, without the lowest 1 %.
        high: Largest value, without the highest 1 %.
        closed: Side on which the gripper is closed: ``low`` or ``high``.
        because: Reason for that side.
        share_closed: Share of all frames in which it is closed.
        never: Episodes in which it never closes.
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
    """Source of the places of one arm.

    Attributes:
        arm: Arm that they belong to, "" if there is one alone.
        source: Columns and numbers that were read, and why these.
        space: Kind of the numbers of a place: ``position``, ``joints`` (two principal components of the joints),
            ``numbers`` (likewise, of numbers without names) or ``steps`` (sums of the actions).
    """

    arm: str
    source: str
    space: str


@dataclass(frozen=True, slots=True)
class DataReading:
    """Description of the data that an audit read.

    Attributes:
        episodes: Episodes that were read.
        of: Episodes that the data set says it has.
        observations: Unit of comparison: episodes, or segments of them with one instruction each.
        instruction: Source of the instructions, and their number.
        grippers: One per arm; of our own records none, because their states tell what was grasped.
        places: One per arm.
        about: Sentences on sources that need none of these.
        left_out: Data that were not read, with the reason.
        warnings: Possible reasons for wrong findings.
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
        """Yield the sentences of the paragraph with which every audit begins."""
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
        """The paragraph with which every audit begins."""
        return " ".join(self.sentences())


def _of(what: str, arm: str) -> str:
    return f"{what} of the {arm} arm" if arm else what


def how_many(count: int, one: str) -> str:
    """Return "1 episode", "1,200 episodes"."""
    return f"{count:,} {plural(count, one).partition(' ')[2]}"
