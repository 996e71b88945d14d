"""Content of a data set in memory, from which the writers of all file formats generate their files."""

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
    """Question about an image of an episode, with its answer."""

    row: int
    camera: str
    question: str
    answer: str


@dataclass(frozen=True, slots=True)
class DatasetEpisode:
    """Episode of a data set.

    Attributes:
        folder: Folder with the data of the episode.
        about: Metadata of the episode.
        record: SHA-256 of the record that the episode was made from.
        questions: Questions about frames of the episode.
    """

    folder: Path
    about: Mapping[str, Any]
    record: str
    questions: tuple[FrameQuestion, ...] = ()

    def __len__(self) -> int:
        return int(self.about["rows"])


@dataclass(frozen=True, slots=True)
class Dataset:
    """Episodes of a data set in order, with their layout and image format.

    Attributes:
        train: Number of training episodes, which come before the validation episodes.
        language: Whether LeRobot's language columns are written.
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
        """Distinct instructions. The index of an instruction in this tuple is its task index in the data set."""
        return tuple(dict.fromkeys(str(episode.about["instruction"]) for episode in self.episodes))

    @property
    def subgoals(self) -> tuple[str, ...]:
        """Distinct subgoals. The index of a subgoal in this tuple is its subtask index in the data set."""
        return tuple(dict.fromkeys(name for episode in self.episodes for name in episode.about["subgoals"]))

    def parts(self) -> Iterator[Part]:
        """Yield the content of each episode. Raises RecordError if the stored content of an episode is damaged."""
        for episode in self.episodes:
            part = read_part(episode.folder, self.layout)
            if part is None:
                raise RecordError(f"{episode.folder}: this episode is damaged or incomplete. Run the export again.")
            yield part


def splits(dataset: Dataset) -> dict[str, str]:
    """Return the ranges of training and validation episodes in LeRobot's notation. An empty range is left out."""
    total = len(dataset.episodes)
    ranges = {"train": f"0:{dataset.train}"}
    return ranges if dataset.train == total else ranges | {"validation": f"{dataset.train}:{total}"}


def starts(episodes: Sequence[DatasetEpisode]) -> list[int]:
    """Return, for each episode, the index of its first frame in the data set."""
    found, begun = [], 0
    for episode in episodes:
        found.append(begun)
        begun += len(episode)
    return found
