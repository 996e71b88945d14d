"""Comparing what a LeRobot data set says beside states, actions and pictures with the records that it comes from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.export.frames import Numbers
from betterbench.export.lerobot import COUNTERS, SUBTASK
from betterbench.export.numbers import vector_stats
from betterbench.recording import Record

_CURE = "Export it again into another place"
_CLOSE = 1e-9
"""Largest difference of a statistic, as a share of it: another version of NumPy may add in another order."""


class LeRobotCheck:
    """Compares times, counters, instructions and subgoals of each episode, and then totals and statistics.

    Statistics of pictures and the language columns are not compared.
    """

    def __init__(
        self,
        path: Path,
        info: Mapping[str, Any],
        texts: Mapping[str, Mapping[int, str]],
        stats: Mapping[str, Any],
        episodes: Sequence[Mapping[str, Any]],
    ) -> None:
        """Prepare for a data set.

        Args:
            path: Its folder.
            info: Its ``meta/info.json``.
            texts: Per column of indices ("task_index", "subtask_index") the text of each number.
            stats: Its ``meta/stats.json``.
            episodes: What ``meta`` says of each episode: "tasks" and "length".
        """
        self._path, self._info, self._texts, self._stats, self._episodes = path, info, texts, stats, episodes
        self._seen: dict[str, list[np.ndarray]] = {}
        self._frames = 0

    def add(self, number: int, record: Record, numbers: Numbers, there: Mapping[str, np.ndarray]) -> None:
        """Compare the next episode; ``there`` has its columns of counters, each of shape (N, 1)."""
        rows, where = record.n_steps, f"{self._path}: episode {number}"
        rate = round(record.metadata.control_rate_hz)
        wanted: dict[str, np.ndarray] = {
            "timestamp": (np.arange(rows) / rate).astype(np.float32),
            "frame_index": np.arange(rows),
            "episode_index": np.full(rows, number),
            "index": np.arange(self._frames, self._frames + rows),
        }
        for name, values in wanted.items():
            if not np.array_equal(there[name].reshape(-1), values):
                raise InvalidInputError(where, f"its {name} is not what the record says", _CURE)
        said = {"task_index": (record.metadata.instruction,) * rows, SUBTASK: numbers.subgoals}
        for name, words in said.items():
            found = tuple(self._texts[name].get(int(index), "") for index in there[name].reshape(-1))
            row = next((i for i, (one, other) in enumerate(zip(found, words, strict=True)) if one != other), None)
            if row is not None:
                problem = f"its {name} says {found[row]!r} at frame {row}, and the record {words[row]!r}"
                raise InvalidInputError(where, problem, _CURE)
        about = self._episodes[number]
        if (list(about["tasks"]), about["length"]) != ([record.metadata.instruction], rows):
            problem = f"meta says {list(about['tasks'])} and {about['length']} frames of it"
            raise InvalidInputError(
                where, f"{problem}, and the record {record.metadata.instruction!r} and {rows}", _CURE
            )
        if self._info.get("fps") != rate:
            problem = f"its fps is {self._info.get('fps')}, and the records have {rate}"
            raise InvalidInputError(str(self._path / "meta/info.json"), problem, _CURE)
        for name, values in {**numbers.vectors, **{name: there[name] for name in COUNTERS}}.items():
            self._seen.setdefault(name, []).append(values)
        self._frames += rows

    def finish(self) -> None:
        """Compare totals, splits and statistics, after all episodes."""
        file, count = str(self._path / "meta/info.json"), len(self._episodes)
        for name, total in (("total_episodes", count), ("total_frames", self._frames)):
            if self._info.get(name) != total:
                raise InvalidInputError(file, f"its {name} is {self._info.get(name)}, and there are {total}", _CURE)
        splits = self._info.get("splits")
        train = str(splits.get("train", "")).removeprefix("0:") if isinstance(splits, dict) else ""
        ranges = {"train": f"0:{train}"} | ({} if train == str(count) else {"validation": f"{train}:{count}"})
        if not train.isdecimal() or not 0 < int(train) <= count or splits != ranges:
            raise InvalidInputError(file, f"its splits are {splits}, of {count} episodes", _CURE)
        for name, values in self._seen.items():
            stored = self._stats.get(name)
            for what, wanted in vector_stats(np.concatenate(values)).items():
                if what not in _ALWAYS and isinstance(stored, dict) and what not in stored:
                    continue  # version 2.1 keeps few quantiles
                found = stored.get(what) if isinstance(stored, dict) else None
                if not isinstance(found, list) or len(found) != len(wanted) or not all(map(_same, found, wanted)):
                    file = str(self._path / "meta/stats.json")
                    raise InvalidInputError(file, f"its {what} of {name} is not that of the frames", _CURE)


_ALWAYS = ("min", "max", "mean", "std", "count")


def _same(found: object, wanted: float) -> bool:
    number = isinstance(found, (int, float)) and not isinstance(found, bool)
    return number and math.isclose(float(found), wanted, rel_tol=_CLOSE, abs_tol=_CLOSE)  # type: ignore[arg-type]
