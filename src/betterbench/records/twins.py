"""Twin demonstrations of a run: two records that agree bit for bit until their instructions have an effect."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Annotated

from pydantic import Field, TypeAdapter

from betterbench.errors import RecordError
from betterbench.json_form import open_sealed_lines, read_bounded, read_form, sealed_lines, strict_form
from betterbench.quoting import json_text
from betterbench.records.run import RunFolder
from betterbench.tasks.trial_id import TrialId

PAIRS_FILE = "pairs.jsonl"
"""File within a run of demonstrations that lists its pairs, one a line."""
_MAX_BYTES = 256 * 1024 * 1024
_CURE = "Give the command that made the set again, which writes this list anew from the records"

_Rows = Annotated[int, Field(ge=1)]


@strict_form
@dataclass(frozen=True, slots=True)
class TwinPair:
    """Two demonstrations from the same start with different instructions.

    Attributes:
        pair: Its id, "TASK/SEED/CONDITION+CONDITION".
        task: Their task.
        seed: Their seed.
        conditions: Their conditions.
        instructions: Their instructions, which differ.
        shared_rows: Rows that are the same in both, bit for bit: the state at reset and after each shared action.
        rows: Rows of each.
    """

    pair: str
    task: str
    seed: int
    conditions: tuple[str, str]
    instructions: tuple[str, str]
    shared_rows: _Rows
    rows: tuple[_Rows, _Rows]

    @property
    def trials(self) -> tuple[TrialId, TrialId]:
        """The two trials."""
        a, b = self.conditions
        return TrialId(self.task, a, self.seed), TrialId(self.task, b, self.seed)


_FORM = TypeAdapter(TwinPair)


def pairs_bytes(pairs: Iterable[TwinPair]) -> bytes:
    """Return the file that lists pairs, a line each, and their seal in the last line."""
    lines = "".join(json_text(asdict(pair)) + "\n" for pair in pairs).encode()
    return sealed_lines(lines)


def read_pairs(run: RunFolder) -> tuple[TwinPair, ...]:
    """Return the pairs of a run, none if it lists none; RecordError if the list is corrupt."""
    path = run.path / PAIRS_FILE
    if not path.exists():
        return ()
    data = read_bounded(path, max_bytes=_MAX_BYTES, cure=_CURE, raises=RecordError)
    lines = open_sealed_lines(data, where=str(path), cure=_CURE, raises=RecordError)
    return tuple(
        read_form(_FORM, line, where=f"{path}: line {i}", cure=_CURE, raises=RecordError)
        for i, line in enumerate(lines, start=1)
    )
