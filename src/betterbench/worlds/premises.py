"""Whether the scenes of LIBERO still show what their sentences presuppose, on the engine at hand."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from betterbench.json_form import (
    open_ordinary,
    open_sealed_lines,
    parse_json,
    read_bounded,
    read_form,
    sealed_lines,
    strict_form,
)
from betterbench.worlds.libero import PLUS_SUITES, SEED, SETTLING_STEPS
from betterbench.worlds.libero_plus import MOVING_AXES, read_variant
from betterbench.worlds.process import WorldError, WorldProcess

_MAX_BYTES = 1 << 26

JUMP_M = 0.03
"""Distance sideways from which an object that moves while settling has jumped."""


_MOST_LINE = 1 << 20


@strict_form
@dataclass(frozen=True, slots=True)
class PremiseEntry:
    """The premises of one task.

    Attributes:
        task: Its place in the suite.
        instruction: Its sentence.
        states: Number of its initial states.
        broken: Relation to the initial states in which it does not hold after settling.
        jumps: Object to the initial states in which it moves by more than :data:`JUMP_M` while settling.
        engine: Versions of what ran it.
        bddl_sha256: Fingerprint of its file.
        variant: Name of the variant of LIBERO-Plus; empty for another task.
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
        """The initial states in which some premise does not hold."""
        return tuple(sorted({state for states in self.broken.values() for state in states}))

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {name: getattr(self, name) for name in self.__slots__}


def check_premises(process: WorldProcess, suite: str, *, known: Sequence[PremiseEntry] = ()) -> Iterator[PremiseEntry]:
    """Yield the entry of every task of a suite; one that is known for the same file and engine is not run again.

    Of LIBERO-Plus, the variants whose objects or robot move otherwise than in the base suite are checked, in the one
    state that they are run from; those that change what is seen or said alone have the premises of the base suite.

    Raises:
        WorldError: If the simulator fails or answers nonsense.
    """
    said = process.suite(suite)
    done = {(e.suite, e.task, e.bddl_sha256, json.dumps(e.engine, sort_keys=True)): e for e in known}
    for i, task in enumerate(said["tasks"]):
        key = (suite, int(task.get("task", i)), str(task["bddl_sha256"]), json.dumps(said["versions"], sort_keys=True))
        if key in done:
            yield done[key]
            continue
        request: dict[str, Any] = {"suite": suite, "task": i, "settle": SETTLING_STEPS, "seed": SEED}
        variant = str(task["name"]) if suite in PLUS_SUITES else ""
        if variant:
            if task["needs"] or read_variant(variant).axis not in MOVING_AXES:
                continue
            request |= {"task": int(task["task"]), "variant": variant, "states": 1}
        document, arrays = process.premises(request)
        try:
            holds, moved = arrays["holds"], arrays["moved"]
            broken = {str(name): _where(~holds[:, k]) for k, name in enumerate(document["premises"])}
            jumps = {str(name): _where(moved[:, k] > JUMP_M) for k, name in enumerate(document["objects"])}
            engine = {str(name): str(found) for name, found in document["engine"].items()}
        except (KeyError, IndexError, TypeError, AttributeError) as error:
            raise WorldError(f"the world does not answer for its premises as agreed: {error}") from error
        yield PremiseEntry(
            suite,
            int(request["task"]),
            str(task["instruction"]),
            len(moved),
            {name: states for name, states in broken.items() if states},
            {name: states for name, states in jumps.items() if states},
            engine,
            str(task["bddl_sha256"]),
            variant,
        )


def _where(flags: Any) -> list[int]:  # noqa: ANN401 - a row of flags
    return [int(i) for i in flags.nonzero()[0]]


def is_premise_file(path: Path) -> bool:
    """Tell whether the first line of a file is an entry; raises OSError unless it is missing."""
    try:
        with open_ordinary(path) as file:
            return isinstance(PremiseEntry(**parse_json(file.readline(_MOST_LINE))), PremiseEntry)
    except FileNotFoundError:
        return False
    except (ValueError, TypeError):
        return False


def read_entries(path: Path) -> tuple[PremiseEntry, ...]:
    """Return the entries that a file of JSON lines holds, none if there is no file.

    Raises:
        InvalidInputError: If a line is no entry.
    """
    if not path.exists():
        return ()
    cure = "Name another file with --out, and the premises are checked anew"
    data = read_bounded(path, max_bytes=_MAX_BYTES, cure=cure)
    lines = enumerate(open_sealed_lines(data, where=str(path), cure=cure), start=1)
    return tuple(read_form(_ENTRY, line, where=f"{path}, line {number}", cure=cure) for number, line in lines)


def entries_bytes(entries: Iterable[PremiseEntry]) -> bytes:
    """Return the file that :func:`read_entries` reads."""
    return sealed_lines("".join(json.dumps(entry.to_json()) + "\n" for entry in entries).encode())


_ENTRY = TypeAdapter(PremiseEntry)
