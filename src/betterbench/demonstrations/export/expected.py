"""Expected content of a data set, computed from the records in the same way as during the export."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from betterbench.demonstrations.export.comparing import CURE, LEVEL
from betterbench.demonstrations.export.episodes import Dataset, DatasetEpisode
from betterbench.demonstrations.export.frames import Numbers
from betterbench.demonstrations.export.job import is_split
from betterbench.demonstrations.export.layout import DatasetLayout
from betterbench.demonstrations.export.lerobot import Totals, counters, episode_stats
from betterbench.demonstrations.export.numbers import Stats, sampled_rows
from betterbench.demonstrations.export.part import ImageForm, Part, about
from betterbench.errors import InvalidInputError
from betterbench.records import Record
from betterbench.tasks import TrialId


class ExpectedDataset:
    """Expected episodes of a data set, without images and questions. Records are added one at a time."""

    def __init__(self, path: Path, layout: DatasetLayout, form: ImageForm) -> None:
        self.path, self.layout, self.form = path, layout, form
        self.language = False
        self.dataset = Dataset((), layout, form, 0, 0)
        self._counted: dict[str, np.ndarray] = {}
        self._totals = Totals()
        self._first: list[int] = [0]

    def add(self, record: Record, digest: str, numbers: Numbers, pairs: Sequence[str] | None) -> Part:
        """Add the next episode, and return its expected content without images.

        Raises InvalidInputError if the record has a different control rate than the earlier records.

        Args:
            record: Record of the episode.
            digest: SHA-256 of the record.
            numbers: Numeric columns of the episode, i.e. all columns except the images.
            pairs: Ids of the pairs of twins (demonstrations with the same initial state and different instructions)
                that the episode belongs to; None if the data set does not list pairs.
        """
        rate, before = round(record.metadata.control_rate_hz), self.dataset.episodes
        if before and rate != self.dataset.rate_hz:
            problem = f"its record has a control rate of {rate} Hz, but earlier records have {self.dataset.rate_hz} Hz"
            raise InvalidInputError(f"{self.path}: episode {len(before)}", problem, CURE)
        told = about(record, numbers.subgoals) | ({} if pairs is None else {"pairs": list(pairs)})
        episodes = (*before, DatasetEpisode(self.path, told, digest))
        self.dataset = Dataset(episodes, self.layout, self.form, rate, len(episodes), self.language)
        images, rows = self.layout.all_images, record.n_steps
        pngs = dict.fromkeys(images, (b"",) * rows) if self.form == "png" else {}
        levels = {name: np.ones((3, 256), np.int64) for name in images}
        part = Part(numbers.vectors, numbers.subgoals, {}, pngs, levels, len(sampled_rows(rows)), told)
        self._counted = counters(self.dataset, len(before), part, first=self._first[-1])
        self._totals.add(part, self._counted)
        self._first.append(self._first[-1] + rows)
        return part

    def first(self, number: int) -> int:
        """Return the index of an episode's first frame in the data set."""
        return self._first[number]

    def divided(self, train: int, where: str, said: str) -> Dataset:
        """Return the expected data set with the first ``train`` episodes for training and the others for validation.

        Raises InvalidInputError if no validation fraction leads to this split.

        Args:
            train: Number of training episodes.
            where: File that contains this number.
            said: Text that quotes this number from the file, for the error message.
        """
        trials = [TrialId(e.about["task"], e.about["condition"], e.about["seed"]) for e in self.dataset.episodes]
        if not is_split(trials, train):
            problem = f"{said}, but no validation fraction splits {len(trials)} episodes in this way"
            raise InvalidInputError(where, problem, CURE)
        return replace(self.dataset, train=train)

    def episode_stats(self, part: Part) -> dict[str, Stats]:
        """Return the statistics of the episode that was added last, with placeholders for image statistics."""
        return self._open(episode_stats(self.dataset, part, self._counted))

    def stats(self) -> dict[str, Stats]:
        """Return the statistics over all episodes, with placeholders for image statistics."""
        return self._open(self._totals.stats())

    def _open(self, stats: dict[str, Stats]) -> dict[str, Stats]:
        """Replace image statistics by placeholders.

        Without images, only their shapes and the image counts are known.
        """
        levels: Any = [[[LEVEL]]] * 3
        opened = {
            name: {what: value if what == "count" else levels for what, value in stats[name].items()}
            for name in self.layout.all_images
        }
        return stats | opened
