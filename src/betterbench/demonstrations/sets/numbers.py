"""Counts, episode lengths, value ranges and normalization statistics of a training set."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from betterbench.demonstrations.export.numbers import Stats, vector_stats
from betterbench.records import Record
from betterbench.tasks import TrialId

_Floats = npt.NDArray[np.float64]

STATE = (
    *(f"ee_position_{axis}_m" for axis in "xyz"),
    *(f"ee_quaternion_{part}" for part in "wxyz"),
    "finger_width_m",
    *(f"joint_{i}_rad" for i in range(1, 8)),
)
"""Names of the components of the state vector, in order."""


@dataclass(frozen=True, slots=True)
class ConditionCounts:
    """Number and lengths of the demonstrations of a condition."""

    task: str
    condition: str
    instruction: str
    demonstrations: int
    validation: int
    steps_min: int
    steps_median: int
    steps_max: int


class SetNumbers:
    """Accumulator for the statistics of a training set. Records are added one at a time."""

    def __init__(self, held_out: frozenset[int]) -> None:
        self._held_out = held_out
        self._components: tuple[str, ...] = ()
        self._actions: list[_Floats] = []
        self._states: list[_Floats] = []
        self._of_tasks: dict[str, list[int]] = {}
        self._lengths: dict[tuple[str, str, str], list[tuple[int, bool]]] = {}
        self._demonstrators: Counter[str] = Counter()

    def add(self, trial: TrialId, record: Record) -> None:
        """Add a record. Records held out for validation are counted but not used for the statistics."""
        meta = record.metadata
        held_out = trial.seed in self._held_out
        self._lengths.setdefault((trial.task, trial.condition, meta.instruction), []).append((record.n_steps, held_out))
        self._demonstrators[meta.demonstrator.kind if meta.demonstrator else "unknown"] += 1
        self._components = meta.action_components
        if held_out:
            return
        self._of_tasks.setdefault(trial.task, []).append(len(self._actions))
        self._actions.append(np.array(record.action[1:], dtype=np.float64))
        parts = (record.ee_position, record.ee_quaternion, record.finger_width[:, None], record.joint_positions)
        self._states.append(np.concatenate([part[:-1] for part in parts], axis=1))

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the action components."""
        return self._components

    @property
    def steps(self) -> int:
        """Total number of control steps in all records."""
        return sum(n for lengths in self._lengths.values() for n, _ in lengths)

    @property
    def demonstrators(self) -> Mapping[str, int]:
        """Number of demonstrations by kind of demonstrator."""
        return dict(sorted(self._demonstrators.items()))

    def counts(self) -> tuple[ConditionCounts, ...]:
        """Return the number and lengths of the demonstrations of each condition."""
        found = []
        for (task, condition, said), lengths in sorted(self._lengths.items()):
            steps = [n for n, _ in lengths]
            held_out = sum(is_held_out for _, is_held_out in lengths)
            middle = int(np.median(steps))
            found.append(ConditionCounts(task, condition, said, len(steps), held_out, min(steps), middle, max(steps)))
        return tuple(found)

    def statistics(self) -> dict[str, Any]:
        """Return the normalization statistics of actions and states, over all training frames and for each task.

        A frame is a state together with the action taken in this state. Raises ValueError if there are no frames.
        """
        return {
            "action": {"names": list(self._components), **_rounded(vector_stats(np.concatenate(self._actions)))},
            "state": {"names": list(STATE), **_rounded(vector_stats(np.concatenate(self._states)))},
            "tasks": {
                task: {
                    "action": _rounded(vector_stats(np.concatenate([self._actions[i] for i in chosen]))),
                    "state": _rounded(vector_stats(np.concatenate([self._states[i] for i in chosen]))),
                }
                for task, chosen in sorted(self._of_tasks.items())
            },
        }


def _rounded(stats: Stats) -> Stats:
    return {name: [round(float(v), 8) for v in values] for name, values in stats.items()}


def counts_form(counts: Sequence[ConditionCounts]) -> list[dict[str, Any]]:
    """Return the counts of all conditions as a JSON-serializable list."""
    return [asdict(count) for count in counts]
