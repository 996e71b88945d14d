"""Journal of the scenarios that were proposed for a growing suite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from betterbench.errors import RecordError
from betterbench.generation.scenario import Scenario
from betterbench.generation.scenario_form import scenario_from_json
from betterbench.jobs.line_journal import LINK, LineJournal, link_after, linked_forms
from betterbench.json_form import NO_TRUTH, read_form, strict_form

FILE_NAME = "proposals.jsonl"
"""Name of the journal of proposals in the folder of a growing suite."""
_CURE = "Restore the file from a copy, or choose another folder"

Outcome = Literal["drawn", "near_duplicate", "refused"]
"""Outcome of a proposal.

drawn: the scenario is built. near_duplicate: it has the same goal as an earlier task. refused: it is not plausible.
"""


@strict_form
@dataclass(frozen=True, slots=True)
class Proposal:
    """Scenario proposed for a growing suite, with the decision whether to build it.

    Attributes:
        number: Number of the proposal, counted from 1.
        round: Round that proposed the scenario, counted from 1.
        template: Requested template.
        context: Requested context. Empty if any context was allowed.
        outcome: "drawn" if the scenario is built, or else the category of the problem.
        key: Key that is equal for near-duplicates of the scenario. Empty if it is unknown.
        task_id: Identifier of the task if the scenario is built.
        scenario: Scenario in its stored form. None if the author wrote none.
        problem: Reason why the scenario is not built: the earlier task with the same goal, or the first problem in the
            model's last answer.
    """

    number: Annotated[int, NO_TRUTH, Field(ge=1)]
    round: Annotated[int, NO_TRUTH, Field(ge=1)]
    template: str
    context: str
    outcome: Outcome
    key: str
    task_id: str
    scenario: dict[str, Any] | None
    problem: str

    @property
    def is_drawn(self) -> bool:
        """Whether the proposed scenario is built."""
        return self.outcome == "drawn"

    def read(self) -> Scenario:
        """Return the proposed scenario.

        Raises:
            InvalidInputError: If the proposal contains no scenario.
        """
        return scenario_from_json(self.scenario or {}, where=f"proposal {self.number}")


_PROPOSAL = TypeAdapter(Proposal)


class ProposalFile(LineJournal):
    """Append-only file of proposals. Each proposal is synced to disk before the next one is made.

    Raises:
        RecordError: If a line was changed.
    """

    def __init__(self, path: Path) -> None:
        self.stored: list[Proposal] = []
        self._link = ""
        super().__init__(path, alone=True)

    def _take_in(self, lines: list[bytes]) -> None:
        for number, (form, link) in enumerate(linked_forms(self._path, lines, cure=_CURE), start=1):
            where = f"{self._path}: line {number}"
            self.stored.append(_read(form, where))
            self._link = link

    def append(self, proposal: Proposal) -> None:
        """Append a proposal."""
        form = asdict(proposal)
        link = link_after(self._link, form)
        self._append_line({**form, LINK: link})
        self.stored.append(proposal)
        self._link = link


def _read(form: Mapping[str, Any], where: str) -> Proposal:
    return read_form(_PROPOSAL, dict(form), where=where, cure=_CURE, raises=RecordError)
