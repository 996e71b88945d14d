"""Premise checks of the scenes in the installed LIBERO.

A premise is a relation between objects that an instruction assumes. It should hold in every initial state of the task.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import index
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, TypeAdapter

from betterbench.json_form import open_sealed_lines, parse_json, read_bounded, read_form, sealed_lines, strict_form
from betterbench.ordinary_file import open_ordinary
from betterbench.sim.worlds.process import WorldProcess, as_agreed, sent_text, sent_texts
from betterbench.tasks.worlds.libero import PLUS_SUITES, SEED, SETTLING_STEPS
from betterbench.tasks.worlds.libero_plus import MOVING_AXES, read_variant

_MAX_BYTES = 1 << 26

JUMP_M = 0.03
"""Sideways motion while settling above which an object is reported as having jumped [m]."""


_MOST_LINE = 1 << 20


@strict_form
@dataclass(frozen=True, slots=True)
class PremiseEntry:
    """Result of checking the premises of one task.

    Attributes:
        task: Index of the task in the suite.
        instruction: Instruction of the task.
        states: Number of initial states that were checked.
        broken: For each premise, the initial states in which it is false after settling. A premise is a relation
            between objects that the instruction assumes to hold.
        jumps: For each object, the initial states in which it moves by more than :data:`JUMP_M` while settling.
        engine: Versions of the simulator and of its packages.
        bddl_sha256: SHA-256 of the task's file.
        variant: Name of the LIBERO-Plus variant. It is empty for a task that is not a variant.
    """

    suite: str
    task: Annotated[int, Field(ge=0, lt=1 << 31)]
    instruction: str
    states: Annotated[int, Field(ge=0, lt=1 << 31)]
    broken: dict[str, list[int]]
    jumps: dict[str, list[int]]
    engine: dict[str, str]
    bddl_sha256: str
    variant: str = ""

    @property
    def broken_states(self) -> tuple[int, ...]:
        """Initial states in which at least one premise is false."""
        return tuple(sorted({state for states in self.broken.values() for state in states}))

    def to_json(self) -> dict[str, Any]:
        """Return the entry in JSON form."""
        return {name: getattr(self, name) for name in self.__slots__}


def check_premises(process: WorldProcess, suite: str, *, known: Sequence[PremiseEntry] = ()) -> Iterator[PremiseEntry]:
    """Yield the entry of every task in a suite. Known entries with the same task file and engine are reused.

    For LIBERO-Plus, only variants that move objects or the robot are checked, and only in the state that a run uses.
    Variants that merely change images or language have the premises of the base suite.

    Raises:
        WorldError: If the simulator fails or sends an invalid answer.
    """
    said = process.suite(suite)
    with as_agreed(f"sent a description of {suite}"):
        tasks = [_AskedTask.of(suite, number, task) for number, task in enumerate(said["tasks"])]
        if not tasks:
            raise ValueError("the suite has no tasks")
        versions = json.dumps(sent_texts(said["versions"]), sort_keys=True)
    done = {(e.suite, e.task, e.bddl_sha256, json.dumps(e.engine, sort_keys=True)): e for e in known}
    for task in tasks:
        key = (suite, task.number, task.bddl_sha256, versions)
        if key in done:
            yield done[key]
            continue
        if task.variant and (task.needs or read_variant(task.variant).axis not in MOVING_AXES):
            continue
        request: dict[str, Any] = {"suite": suite, "task": task.number, "settle": SETTLING_STEPS, "seed": SEED}
        request |= {"variant": task.variant, "states": 1} if task.variant else {}
        document, arrays = process.premises(request)
        with as_agreed("sent an answer about its premises"):
            holds, moved = arrays["holds"], arrays["moved"]
            names = [tuple(sent_text(name) for name in document[key]) for key in ("premises", "objects")]
            due = tuple((len(moved), len(listed)) for listed in names)
            if (holds.shape, moved.shape) != due or holds.dtype != bool or not np.isfinite(moved).all():
                raise ValueError(
                    f"unexpected arrays: holds {holds.dtype} {holds.shape}, moved {moved.dtype} {moved.shape}"
                )
            broken = {name: _where(~holds[:, k]) for k, name in enumerate(names[0])}
            jumps = {name: _where(moved[:, k] > JUMP_M) for k, name in enumerate(names[1])}
            engine = sent_texts(document["engine"])
        yield PremiseEntry(
            suite,
            task.number,
            task.instruction,
            len(moved),
            {name: states for name, states in broken.items() if states},
            {name: states for name, states in jumps.items() if states},
            engine,
            task.bddl_sha256,
            task.variant,
        )


@dataclass(frozen=True, slots=True)
class _AskedTask:
    """Task of a suite, as described by the simulator. ``variant`` and ``needs`` are used only for LIBERO-Plus."""

    number: int
    instruction: str
    bddl_sha256: str
    variant: str
    needs: bool

    @classmethod
    def of(cls, suite: str, number: int, said: Mapping[str, Any]) -> _AskedTask:
        """Read a task from the simulator's description.

        Raises LookupError, TypeError or ValueError if it is malformed.
        """
        plus = suite in PLUS_SUITES
        return cls(
            index(said["task"] if plus else said.get("task", number)),
            sent_text(said["instruction"]),
            sent_text(said["bddl_sha256"]),
            sent_text(said["name"]) if plus else "",
            plus and bool(said["needs"]),
        )


def _where(flags: Any) -> list[int]:  # noqa: ANN401 - a row of flags
    return [int(i) for i in flags.nonzero()[0]]


def is_premise_file(path: Path) -> bool:
    """Return whether a file exists and its first line is a premise entry. Raises OSError if it cannot be read."""
    try:
        with open_ordinary(path) as file:
            return isinstance(PremiseEntry(**parse_json(file.readline(_MOST_LINE))), PremiseEntry)
    except FileNotFoundError:
        return False
    except (ValueError, TypeError):
        return False


def read_entries(path: Path) -> tuple[PremiseEntry, ...]:
    """Read the entries from a JSON lines file. If the file does not exist, there are no entries.

    Raises:
        InvalidInputError: If a line is not an entry.
    """
    if not path.exists():
        return ()
    cure = "Pass a different file with --out to start the check again in that file"
    data = read_bounded(path, max_bytes=_MAX_BYTES, cure=cure)
    lines = enumerate(open_sealed_lines(data, where=str(path), cure=cure), start=1)
    return tuple(read_form(_ENTRY, line, where=f"{path}, line {number}", cure=cure) for number, line in lines)


def entries_bytes(entries: Iterable[PremiseEntry]) -> bytes:
    """Serialize the entries to bytes in the file format that :func:`read_entries` reads."""
    return sealed_lines("".join(json.dumps(entry.to_json()) + "\n" for entry in entries).encode())


_ENTRY = TypeAdapter(PremiseEntry)
