"""Twin demonstrations in a run: pairs of records with different instructions and an identical beginning.

The two records of a pair are identical until the instructions take effect.
"""

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
"""Name of the file in a run of demonstrations that lists its pairs, one per line."""
_MAX_BYTES = 256 * 1024 * 1024
_CURE = "Repeat the command that made the demonstrations. It writes this list again from the records"

_Rows = Annotated[int, Field(ge=1)]


@strict_form
@dataclass(frozen=True, slots=True)
class TwinPair:
    """Two demonstrations that start from the same state and have different instructions.

    Attributes:
        pair: Id of the pair, "TASK/SEED/CONDITION+CONDITION".
        task: Task of both demonstrations.
        seed: Seed of both demonstrations.
        conditions: The two conditions.
        instructions: The two instructions, which differ.
        shared_rows: Number of rows at the beginning that are identical in both records: the state at reset, and the
            state after each shared action.
        rows: Number of rows of each record.
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
        """Trials of the two demonstrations in this pair."""
        a, b = self.conditions
        return TrialId(self.task, a, self.seed), TrialId(self.task, b, self.seed)


_FORM = TypeAdapter(TwinPair)


def pairs_bytes(pairs: Iterable[TwinPair]) -> bytes:
    """Return the content of the file that lists the pairs, one per line, with a checksum in the last line."""
    lines = "".join(json_text(asdict(pair)) + "\n" for pair in pairs).encode()
    return sealed_lines(lines)


def read_pairs(run: RunFolder) -> tuple[TwinPair, ...]:
    """Read the pairs of a run. A run without a list has no pairs. Raises RecordError if the list is corrupt."""
    path = run.path / PAIRS_FILE
    if not path.exists():
        return ()
    data = read_bounded(path, max_bytes=_MAX_BYTES, cure=_CURE, raises=RecordError)
    lines = open_sealed_lines(data, where=str(path), cure=_CURE, raises=RecordError)
    return tuple(
        read_form(_FORM, line, where=f"{path}: line {i}", cure=_CURE, raises=RecordError)
        for i, line in enumerate(lines, start=1)
    )
