"""Pairs of twins in a run, which are demonstrations with the same initial state and different instructions."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from betterbench.records import Record, RunFolder
from betterbench.records.twins import TwinPair
from betterbench.tasks import TrialId, get_task
from betterbench.tasks.authoring.training_distribution import pairing
from betterbench.tasks.interventions.regimes import Regime, conditions_of


def twin_pairs(run: RunFolder, regime: Regime) -> Iterator[TwinPair]:
    """Yield the pairs of twins in a run in which conditions share their seeds, ordered by task, seed and condition.

    The two demonstrations of a pair have the same initial state and different instructions. Demonstrations from
    attempts with different indices do not form a pair, because they have different motion styles.
    """
    done = {entry.key for entry in run.entries() if entry.status == "done"}
    for task in sorted({trial.task for trial in done}):
        scenes: dict[object, list[str]] = {}
        for condition in conditions_of(get_task(task), regime):
            scenes.setdefault(pairing(condition)[1], []).append(condition.name)
        for seed in sorted({trial.seed for trial in done if trial.task == task}):
            for names in scenes.values():
                trials = [TrialId(task, name, seed) for name in names if TrialId(task, name, seed) in done]
                yield from _pairs_of(run, trials)


def _pairs_of(run: RunFolder, trials: Sequence[TrialId]) -> Iterator[TwinPair]:
    if len(trials) < 2:
        return
    records = {trial: run.read_record(trial.task, trial.condition, trial.seed) for trial in trials}
    for a, b in itertools.combinations(trials, 2):
        first, second = records[a], records[b]
        shared = shared_rows(first, second)
        said = (first.metadata.instruction, second.metadata.instruction)
        if shared < 1 or said[0] == said[1] or first.metadata.demonstrator != second.metadata.demonstrator:
            continue
        name = f"{a.task}/{a.seed}/{a.condition}+{b.condition}"
        rows = (len(first), len(second))
        yield TwinPair(name, a.task, a.seed, (a.condition, b.condition), said, shared, rows)


def shared_rows(first: Record, second: Record) -> int:
    """Return the number of initial rows in which two records have the same states, commands and actions."""
    rows = min(len(first), len(second))
    same = np.ones(rows, dtype=bool)
    for name in ("qpos", "qvel", "ctrl", "action"):
        mine, theirs = getattr(first, name), getattr(second, name)
        if mine.shape[1:] != theirs.shape[1:]:
            return 0
        equal = (mine[:rows] == theirs[:rows]) | (np.isnan(mine[:rows]) & np.isnan(theirs[:rows]))
        same &= equal.all(axis=1)
    return rows if same.all() else int(same.argmin())


def pairs_by_task(pairs: Iterable[TwinPair]) -> Mapping[str, list[TwinPair]]:
    """Group pairs of twins (demonstrations with the same initial state and different instructions) by task."""
    found: dict[str, list[TwinPair]] = {}
    for pair in pairs:
        found.setdefault(pair.task, []).append(pair)
    return found
