"""Ordered episodes and description of a data set, the input of the writers for all formats."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from betterbench.demonstrations.export.layout import DatasetLayout
from betterbench.demonstrations.export.part import ImageForm, Part, read_part
from betterbench.errors import RecordError


@dataclass(frozen=True, slots=True)
class FrameQuestion:
    """A question about one frame of an episode, with its answer."""

    row: int
    camera: str
    question: str
    answer: str


@dataclass(frozen=True, slots=True)
class DatasetEpisode:
    """One episode of a data set: the folder of its part, its description, and the digest of its record."""

    folder: Path
    about: Mapping[str, Any]
    record: str
    questions: tuple[FrameQuestion, ...] = ()

    def __len__(self) -> int:
        return int(self.about["rows"])


@dataclass(frozen=True, slots=True)
class Dataset:
    """Episodes of a data set in order, with the layout and format in which they are written.

    Attributes:
        train: Number of training episodes, which come first; the others are for validation.
        language: Whether to write LeRobot's language columns.
        source: Origin of the data: runs, versions, omitted trials, and the evaluation command.
    """

    episodes: tuple[DatasetEpisode, ...]
    layout: DatasetLayout
    form: ImageForm
    rate_hz: int
    train: int
    language: bool = False
    source: Mapping[str, Any] = field(default_factory=dict)

    @property
    def frames(self) -> int:
        """Total number of frames in all episodes."""
        return sum(map(len, self.episodes))

    @property
    def instructions(self) -> tuple[str, ...]:
        """The distinct instructions, which task indices refer to."""
        return tuple(dict.fromkeys(str(episode.about["instruction"]) for episode in self.episodes))

    @property
    def subgoals(self) -> tuple[str, ...]:
        """The distinct subgoals, which subtask indices refer to."""
        return tuple(dict.fromkeys(name for episode in self.episodes for name in episode.about["subgoals"]))

    def parts(self) -> Iterator[Part]:
        """Yield the content of each episode; raise RecordError if it was damaged after it was made."""
        for episode in self.episodes:
            part = read_part(episode.folder, self.layout)
            if part is None:
                raise RecordError(f"{episode.folder}: this part was damaged during the export. Run the command again.")
            yield part


def splits(dataset: Dataset) -> dict[str, str]:
    """Return the episode ranges for training and, if there are any, for validation, in LeRobot's notation."""
    total = len(dataset.episodes)
    ranges = {"train": f"0:{dataset.train}"}
    return ranges if dataset.train == total else ranges | {"validation": f"{dataset.train}:{total}"}


def starts(episodes: Sequence[DatasetEpisode]) -> list[int]:
    """Return the index of each episode's first frame in the data set."""
    found, begun = [], 0
    for episode in episodes:
        found.append(begun)
        begun += len(episode)
    return found
