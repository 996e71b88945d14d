"""Power matrix: success rates that policies without the tested ability reach on each variation.

These policies are called pretenders. They are policies with faulty decision rules, blind probes, and replays of
demonstrations. A policy's success rate is evidence of the tested ability only if it exceeds the success rates of the
pretenders. The matrix is measured once (``better calibrate --power``) and is part of the package. This module reads it
without a simulator.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from typing import Any

from pydantic import TypeAdapter

from betterbench.diagnosis import modes as modes  # noqa: PLC0414 - registers the failure modes
from betterbench.diagnosis.failure_mode import exposed_labels
from betterbench.diagnosis.thresholds import FAILS_AT, REPLAY_LIMIT
from betterbench.errors import InvalidInputError, RecordError, UnknownNameError
from betterbench.json_form import open_form, open_seal, read_form, sealed_form
from betterbench.quoting import shell_word
from betterbench.statistics import Rate, chance_p, holm
from betterbench.statistics.power import DEFAULT_ALPHA
from betterbench.tasks import Expected, Label, Task, built_in_suite, get_task, suite_tasks
from betterbench.tasks.interventions import vary
from betterbench.tasks.suite_folder import POWER
from betterbench.tasks.user_files import options_for, suite_file, suite_folder_of
from betterbench.tasks.worlds.facts import OUR_SUITE

PACKAGED_MATRIX = "power.json"
"""Name of the packaged matrix file, in the folder ``data``."""
EXPERT = "expert"
STOPPING_AT_NEWS = "zoo:halt"
"""Name of the rule that stops at every combination of instruction and scene that is new. It fails every variation."""
BLIND = ("probe:no-language", "probe:no-images", "probe:replay")
"""Pretenders that lack images or the instruction. The last two move without any observation."""
FLOOR = ("random", "noop")
"""Pretenders that do not need demonstrations."""


_OF_TASK = ("task_version:", "conditions:")
"""Beginnings of the names of versions that concern a single task."""

Key = tuple[str, str]
"""Key of a variation: the task's name and the variation's name."""


def power_cure(tasks: Iterable[str]) -> str:
    """Return advice on how to measure the power matrix of the given tasks.

    It is worded as the last clause of a sentence.
    """
    chosen = tuple(tasks)
    folder = suite_folder_of(chosen)
    if folder is not None:
        suite = shell_word(str(folder))
        measured = f"measure it with better calibrate --power --suite {suite} --out runs/power"
        return f"{measured}, and copy runs/power/{POWER} into {suite}"
    if options_for(chosen):
        measured = "measure it with better calibrate --power --suite FOLDER"
        return f"write the task into a suite folder (docs/own-tasks.md), and {measured}"
    suite = built_in_suite(chosen)
    named = "" if suite == OUR_SUITE else f" --tasks {' '.join(suite_tasks(suite))}"
    return f"measure it again with better calibrate --power{named}"


@open_form
@dataclass(frozen=True, slots=True)
class PowerCell:
    """Results of one pretender (a policy without the tested ability) on one variation.

    Attributes:
        k: Number of trials that succeeded.
        n: Number of trials.
        right: Number of trials with a first grasp attempt at a requested object.
        shared: Number of trials that were not simulated, because the pretender makes the same decisions as the expert
            in them. The expert's outcome is used for these trials.
        wrong: Number of trials for each label of the first wrong decision. Empty for policies that do not report their
            decisions.
        failed: The same numbers, for trials that did not succeed.
    """

    k: int
    n: int
    right: int
    shared: int = 0
    wrong: dict[str, int] = field(default_factory=dict)
    failed: dict[str, int] = field(default_factory=dict)

    @property
    def rate(self) -> Rate:
        """Success rate."""
        return Rate(self.k, self.n)

    @property
    def fails(self) -> bool:
        """Whether the policy fails in at least half of its trials on the variation."""
        return self.n > 0 and self.k <= FAILS_AT * self.n

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict without the counts that are zero."""
        form: dict[str, Any] = {"k": self.k, "n": self.n, "right": self.right}
        optional = {"shared": self.shared, "wrong": self.wrong, "failed": self.failed}
        return form | {name: value for name, value in optional.items() if value}


@dataclass(frozen=True, slots=True)
class BlindCell:
    """Results of a policy that lacks an input, such as the images, on a variation that requires the robot to act.

    Attributes:
        pretender: Name of the policy.
        task: Name of the task.
        variation: Name of the variation.
        rate: Success rate of the policy.
        chance: Success rate expected from guessing the instruction, or from replaying demonstrations with jittered
            poses.
        p_value: p-value of a two-sided exact binomial test against the expected rate.
        p_adjusted: The p-value after Holm's correction over all cells.
    """

    pretender: str
    task: str
    variation: str
    rate: Rate
    chance: float
    p_value: float
    p_adjusted: float

    @property
    def above(self) -> bool:
        """Whether the policy succeeds more often than expected by chance."""
        return self.rate.k > self.chance * self.rate.n

    @property
    def flagged(self) -> bool:
        """Whether the rate is significantly higher than chance (5 % level, after Holm's correction)."""
        return self.above and self.p_adjusted < DEFAULT_ALPHA

    @property
    def speechless(self) -> bool:
        """Whether the instruction is redundant because only one instruction makes sense in the variation's scene."""
        return self.chance >= 1.0


@dataclass(frozen=True, slots=True)
class Ceiling:
    """Best success rate on a variation among the policies without the tested ability (pretenders)."""

    pretender: str
    rate: Rate


@dataclass(frozen=True, slots=True)
class PowerMatrix:
    """Measured success rates of policies without the tested ability (pretenders) on every variation.

    Attributes:
        cells: Results on each variation, for each pretender and for the expert as a reference.
        chances: For each variation, the success rate of a policy that executes one of the instructions that make sense
            in the scene, chosen at random.
        versions: Versions of the package, the suite, the engine and the tasks, and a digest of each task's conditions.
    """

    cells: dict[str, dict[Key, PowerCell]]
    chances: dict[Key, float]
    versions: dict[str, str]

    @property
    def pretenders(self) -> tuple[str, ...]:
        """Names of all measured policies except the expert. These policies lack the tested ability (pretenders)."""
        return tuple(name for name in self.cells if name != EXPERT)

    @property
    def rules(self) -> tuple[str, ...]:
        """Names of the measured policies that follow a faulty decision rule."""
        return tuple(name for name in self.pretenders if name not in (*BLIND, *FLOOR))

    @property
    def variations(self) -> tuple[Key, ...]:
        """All variations in the matrix, in the order of the suite."""
        return tuple(dict.fromkeys(key for row in self.cells.values() for key in row))

    def cell(self, pretender: str, key: Key) -> PowerCell | None:
        """Return the results of a policy on a variation, or None if they were not measured."""
        return self.cells.get(pretender, {}).get(key)

    def backed(self, key: Key) -> frozenset[Label]:
        """Return the labels of the wrong decisions that cause policies with a faulty rule to fail a variation."""
        found: set[Label] = set()
        for name in self.rules:
            cell = self.cell(name, key)
            if cell is not None and cell.fails:
                found |= {Label(label) for label, failed in cell.failed.items() if failed > FAILS_AT * cell.n}
        return frozenset(found)

    def exposed(self, key: Key) -> tuple[str, ...]:
        """Return the faulty rules that fail a variation because of a wrong decision that it is designed to expose.

        A rule that passes the variation with a needless step is not included, because its success rate does not expose
        it.
        """
        claims = {label.value for label in exposed_labels(*key)}
        return tuple(name for name in self.failing(key) if claims & self.cells[name][key].wrong.keys())

    def passing_wrongly(self, key: Key) -> tuple[str, ...]:
        """Return the faulty rules that pass a variation despite wrong decisions, such as needless steps."""
        rows = ((name, self.cell(name, key)) for name in self.rules)
        return tuple(name for name, cell in rows if cell is not None and cell.n and cell.wrong and not cell.fails)

    def failing(self, key: Key) -> tuple[str, ...]:
        """Return the names of the faulty decision rules that fail a variation."""
        return tuple(name for name in self.rules if (cell := self.cell(name, key)) is not None and cell.fails)

    def control(self, key: Key) -> bool:
        """Return whether a variation is a control, on which even the policies without the tested ability succeed.

        The rule that stops in every new scene is not considered, because it fails every variation.
        """
        return any(self.cell(name, key) is not None for name in self.rules) and not (
            set(self.failing(key)) - {STOPPING_AT_NEWS}
        )

    def ceiling(self, key: Key) -> Ceiling | None:
        """Return the shortcut ceiling of a variation, or None if the variation was not measured.

        The shortcut ceiling is the best success rate among the rules that the variation is designed to expose, the
        blind probes and the replays.
        """
        cells = {name: self.cell(name, key) for name in (*self.exposed(key), *BLIND)}
        known = {name: cell for name, cell in cells.items() if cell is not None and cell.n}
        if not known:
            return None
        best = max(known, key=lambda name: known[name].k / known[name].n)
        return Ceiling(best, known[best].rate)

    def blind_cells(self) -> tuple[BlindCell, ...]:
        """Test whether policies that lack an input succeed more often than expected by chance.

        Variations in which the policy should stay still are left out, because a policy that does not move passes
        them.
        """
        found = []
        for name in (*BLIND, *FLOOR):
            for key, cell in self.cells.get(name, {}).items():
                if _expected(key) is not Expected.SUCCEED or not cell.n:
                    continue
                chance = self.chances.get(key, 1.0) if name == BLIND[0] else REPLAY_LIMIT
                p = chance_p(cell.rate, chance=chance) if chance < 1.0 else 1.0
                found.append(BlindCell(name, *key, cell.rate, chance, p, p))
        corrected = holm([cell.p_value for cell in found])
        return tuple(replace(cell, p_adjusted=p) for cell, p in zip(found, corrected, strict=True))

    def without(self, tasks: Iterable[str]) -> PowerMatrix:
        """Return a copy of the matrix that does not contain the given tasks."""
        left_out = set(tasks)
        cells = {
            name: {key: cell for key, cell in row.items() if key[0] not in left_out} for name, row in self.cells.items()
        }
        chances = {key: chance for key, chance in self.chances.items() if key[0] not in left_out}
        return PowerMatrix(cells, chances, self.versions)

    def with_kept(self, earlier: PowerMatrix) -> PowerMatrix:
        """Return this matrix with additional tasks from an earlier matrix, in the order of the earlier matrix.

        Only tasks that this matrix lacks are added.

        Raises:
            InvalidInputError: If one of the added tasks has changed since the earlier measurement, or if the earlier
                matrix was measured with other pretenders or another suite, engine, appearance or protocol.
        """
        cure = "Measure the whole power matrix with `better calibrate --power`"
        kept = earlier.without({task for task, _ in self.variations})
        if stale := kept.stale_tasks():
            raise InvalidInputError("power matrix", f"{stale[0]} has changed since it was measured", cure)
        for name in sorted({key for key in (*earlier.versions, *self.versions) if not key.startswith(_OF_TASK)}):
            then, now = earlier.versions.get(name), self.versions.get(name)
            if then != now:
                raise InvalidInputError(
                    "power matrix", f"{name} was {then} when the matrix was measured, and is now {now}", cure
                )
        if list(earlier.cells) != list(self.cells):
            other = sorted(earlier.cells.keys() ^ self.cells.keys()) or ["another order"]
            raise InvalidInputError("power matrix", f"the compared policies have changed: {', '.join(other)}", cure)
        order = dict.fromkeys((*earlier.variations, *self.variations))
        rows = {name: {**kept.cells[name], **row} for name, row in self.cells.items()}
        chances = {**kept.chances, **self.chances}
        return PowerMatrix(
            {name: {key: row[key] for key in order if key in row} for name, row in rows.items()},
            {key: chances[key] for key in order if key in chances},
            {**earlier.versions, **self.versions},
        )

    def stale_tasks(self, versions: Mapping[str, str] | None = None) -> tuple[str, ...]:
        """Return the tasks that have changed since the matrix was measured.

        Args:
            versions: Versions in the records of a run (``task_version:NAME``). A task is also returned if its version
                there differs from that in the matrix.
        """
        stale = []
        for name in dict.fromkeys(task for task, _ in self.variations):
            try:
                now = task_versions(get_task(name))
            except UnknownNameError:
                stale.append(name)
                continue
            recorded = (versions or {}).get(f"task_version:{name}")
            measured = self.versions.get(f"task_version:{name}")
            same = all(self.versions.get(key) == value for key, value in now.items())
            if not same or (recorded is not None and recorded != measured):
                stale.append(name)
        return tuple(stale)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "versions": self.versions,
            "chances": {"/".join(key): chance for key, chance in self.chances.items()},
            "cells": {
                name: {"/".join(key): cell.to_json() for key, cell in row.items()} for name, row in self.cells.items()
            },
        }

    def to_text(self) -> str:
        """Return the matrix as a JSON document with one cell per line, so that diffs are readable."""
        form = sealed_form({"version": 2, **self.to_json()})
        rows = [
            f"  {json.dumps(name)}: {{\n"
            + ",\n".join(f"   {json.dumps(key)}: {json.dumps(cell)}" for key, cell in row.items())
            + "\n  }"
            for name, row in form.pop("cells").items()
        ]
        head = json.dumps(form, indent=1)[:-2]
        return head + ',\n "cells": {\n' + ",\n".join(rows) + "\n }\n}\n"

    @classmethod
    def from_json(cls, raw: bytes, *, where: str = PACKAGED_MATRIX) -> PowerMatrix:
        """Read the matrix from a JSON document.

        Args:
            raw: Content of the document.
            where: Name of the document in error messages.

        Raises:
            RecordError: If a field is missing or malformed, or the checksum does not match.
        """
        cure = "Measure it again with `better calibrate --power`"
        form = open_seal(raw, where=where, cure=cure, raises=RecordError, since=("version", 2))
        file = read_form(_FILE, form, where=where, cure=cure, raises=RecordError)
        cells = {name: {_key(k, where): cell for k, cell in row.items()} for name, row in file.cells.items()}
        return cls(cells, {_key(k, where): chance for k, chance in file.chances.items()}, file.versions)


@open_form
@dataclass(frozen=True, slots=True)
class _File:
    versions: dict[str, str]
    chances: dict[str, float]
    cells: dict[str, dict[str, PowerCell]]


_FILE = TypeAdapter(_File)


def _key(text: str, where: str) -> Key:
    task, _, name = text.rpartition("/")
    if not task or not name:
        raise RecordError(
            f"{where}: {text!r} is not the name of a variation. "
            "Measure the power matrix with `better calibrate --power`."
        )
    return task, name


def _expected(key: Key) -> Expected:
    try:
        return get_task(key[0]).variation(key[1]).expected
    except UnknownNameError:
        return Expected.SUCCEED


def task_versions(task: Task) -> dict[str, str]:
    """Return the version of a task, and a digest of its conditions and slots.

    Both affect the task's results in the matrix.
    """
    kept, versions = _VERSIONS.get(id(task), (None, {}))
    if kept is task:
        return dict(versions)
    conditions = [*task.training, *(vary(task, v)[0] for v in task.variations)]
    form = [[c.to_json() for c in conditions], [repr(slot) for slot in task.slots], [v.base for v in task.variations]]
    digest = hashlib.sha256(json.dumps(form, sort_keys=True).encode()).hexdigest()[:12]
    versions = {f"task_version:{task.id}": str(task.version), f"conditions:{task.id}": digest}
    _VERSIONS[id(task)] = task, versions
    return dict(versions)


_VERSIONS: dict[int, tuple[Task, dict[str, str]]] = {}
"""Versions of the tasks that were asked about, by the identity of the task, which is kept so that it stays unique."""


def power_matrix_of(tasks: Iterable[str]) -> PowerMatrix | None:
    """Return the power matrix of the given tasks. It is read from the folder of their suite, or from the package.

    Raises:
        RecordError: If the file is corrupt.
    """
    tasks = tuple(tasks)
    own = suite_file(tasks, POWER)
    if own is not None:
        return PowerMatrix.from_json(own.read_bytes(), where=str(own))
    return packaged_power_matrix(built_in_suite(tasks))


def measured_on(tasks: Iterable[str]) -> PowerMatrix | None:
    """Return the power matrix of the given tasks, or None if it contains no policy that lacks an input (blind probe).

    If no tasks are given, the packaged matrix is returned.

    Raises:
        RecordError: If the file is corrupt.
    """
    chosen = set(tasks)
    matrix = power_matrix_of(chosen)
    if matrix is None or not chosen:
        return matrix
    matrix = matrix.without({task for task, _ in matrix.variations} - chosen)
    return matrix if matrix.blind_cells() else None


@cache
def packaged_power_matrix(suite: str = OUR_SUITE) -> PowerMatrix | None:
    """Return the power matrix of a built-in suite, or None if this build of the package does not contain it.

    Raises:
        RecordError: If the packaged file is corrupt.
    """
    file = resources.files("betterbench.diagnosis").joinpath("data", packaged_matrix_name(suite))
    return PowerMatrix.from_json(file.read_bytes(), where=file.name) if file.is_file() else None


def packaged_matrix_name(suite: str) -> str:
    """Return the name of the file with the packaged power matrix of a built-in suite."""
    return PACKAGED_MATRIX if suite == OUR_SUITE else f"power_{suite}.json"
