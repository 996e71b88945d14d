"""Folder of a protocol on a real arm, and the classes that read and write it.

::

    RUN/
      plan.json             immutable plan, with a seal
      journal.jsonl         one line per trial event: begun, ended, aborted, repeated; the only source for resuming
      trials/CODE/          the valid attempt of a finished trial
        samples.parquet     one row per control step (:class:`Samples`)
        CAMERA.mp4          H.264 at the rate of the plan, one frame per control step
        trial.json          :class:`TrialHeader`, with the digests of the other files and a seal; written last
      aborted/CODE-N/       files of attempt N, if it was aborted or repeated
      entries.jsonl         outcomes entered by people: one line per entry or undo

The lines of both journals are linked by hashes (:mod:`betterbench.jobs.line_journal`). An attempt that began but
neither ended nor was aborted was interrupted. :meth:`RealJournal.settle` marks it as aborted at the next start.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError, RecordError, UnknownNameError
from betterbench.jobs.decisions import Author, DecisionJournal, Time, Undo, histories, now, read_decisions
from betterbench.jobs.durable import on_disk, write_durably
from betterbench.jobs.line_journal import LINK, LineJournal, complete_lines, link_after, linked_forms, say_lost_tail
from betterbench.json_form import (
    Digest,
    content_digest,
    dump_json,
    file_digest,
    open_seal,
    read_bounded,
    read_form,
    sealed_form,
    strict_form,
)
from betterbench.real.outcomes import outcome_named
from betterbench.real.plan import PLAN_NAME, PlannedTrial, RealPlan, Unit, read_plan
from betterbench.records.arrays import array_bytes, read_arrays

JOURNAL_NAME, ENTRIES_NAME = "journal.jsonl", "entries.jsonl"
HEADER_NAME, SAMPLES_NAME = "trial.json", "samples.parquet"
TRIAL_VERSION: Literal[1] = 1

SAMPLE_COLUMNS = {
    "time_s": ("number", 0),
    "state": ("number", 6),
    "command": ("number", 6),
    "asked": ("number", 6),
    "load": ("number", 6),
    "late": ("boolean", 0),
    "limited": ("boolean", 0),
}
"""Columns of the samples: the type of each column, and the number of values per row (0 for a single value)."""

_CURE = "Restore the folder from a copy, or repeat the trial (`better real run --repeat`)"
_JOURNAL_CURE = "Restore the file from a copy"
_MAX_HEADER_BYTES = 1 << 20

Ending = Literal["time_limit", "operator", "policy_ended"]
"""Reason why a trial ended: the time limit, the operator, or the policy."""


# ------------------------------------------------------------------------------------------------------------ samples


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples of a trial, one row per control step, in the unit of the plan (gripper: 0 closed to 100 open).

    Attributes:
        time_s: (T,) time since the start of the trial [s].
        state: (T, 6) measured positions, read before the command was sent.
        command: (T, 6) commanded positions, with the safety limits applied.
        asked: (T, 6) positions requested by the policy; NaN if the policy did not answer in time and the arm held its
            position.
        load: (T, 6) signed load of each motor as a fraction of its maximum; NaN if the robot does not report it.
        late: (T,) whether any camera frame was older than one control step.
        limited: (T,) whether the safety limits changed the command.
    """

    time_s: np.ndarray
    state: np.ndarray
    command: np.ndarray
    asked: np.ndarray
    load: np.ndarray
    late: np.ndarray
    limited: np.ndarray

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time_s)

    @property
    def held(self) -> np.ndarray:
        """(T,) whether the arm held its position because the policy did not answer in time."""
        return np.asarray(np.isnan(self.asked).any(axis=1))

    def to_bytes(self) -> bytes:
        """Return the content of the Parquet file with the samples."""
        return array_bytes(SAMPLE_COLUMNS, {name: getattr(self, name) for name in SAMPLE_COLUMNS})

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read the samples of a trial from a Parquet file.

        Raises:
            RecordError: If the file is damaged, the time does not increase, or a state or command is not finite.
        """
        samples = cls(**read_arrays(path, SAMPLE_COLUMNS, cure=_CURE))
        if len(samples) and not (np.isfinite(samples.time_s).all() and (np.diff(samples.time_s) > 0.0).all()):
            raise RecordError(f"{path}: the values of column 'time_s' do not increase. {_CURE}.")
        for name in ("state", "command"):
            if not np.isfinite(getattr(samples, name)).all():
                raise RecordError(f"{path}: column {name!r} contains a non-finite value. {_CURE}.")
        return samples


@strict_form
@dataclass(frozen=True, slots=True)
class Film:
    """Metadata of the video recorded by a camera.

    Attributes:
        width: Width of the images [pixels].
        height: Height of the images [pixels].
        frames: Number of frames in the video, one per control step.
        late: Number of frames that were older than one control step.
        dropped: Number of control steps without a new frame, for which the video repeats the last frame.
    """

    width: Annotated[int, Field(ge=2)]
    height: Annotated[int, Field(ge=2)]
    frames: Annotated[int, Field(ge=0)]
    late: Annotated[int, Field(ge=0)] = 0
    dropped: Annotated[int, Field(ge=0)] = 0


@strict_form
@dataclass(frozen=True, slots=True)
class TrialHeader:
    """Header of one attempt at a trial, which is written after the other files of the attempt.

    Attributes:
        attempt: Number of the attempt, counted from 1.
        robot: Name of the robot, such as "so101_follower" or "mock".
        begun: Time of the first control step.
        ending: What ended the trial; None if the attempt was aborted.
        steps: Number of control steps, and of rows in the samples.
        late_steps: Number of steps that began more than half a period late.
        held_steps: Number of steps without an answer from the policy.
        limited_steps: Number of steps in which the safety limits changed the command.
        films: Metadata of the videos by camera.
        files: SHA-256 of each other file by name.
        agreement: Measured agreement between the scene and its simulated twin at the start, from 0 to 1; None if it was
            not measured.
        overridden: True if the operator started the trial although the scene did not match the twin.
    """

    version: Literal[1]
    code: str
    attempt: Annotated[int, Field(ge=1)]
    robot: str
    instruction: str
    unit: Unit
    rate_hz: Annotated[float, Field(gt=0.0)]
    begun: Time
    ending: Ending | None
    steps: Annotated[int, Field(ge=0)]
    late_steps: Annotated[int, Field(ge=0)]
    held_steps: Annotated[int, Field(ge=0)]
    limited_steps: Annotated[int, Field(ge=0)]
    films: dict[str, Film]
    files: dict[str, Digest]
    agreement: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    overridden: bool = False

    def to_bytes(self) -> bytes:
        """Return the content of the header file."""
        return (json.dumps(sealed_form(asdict(self)), indent=1, sort_keys=True) + "\n").encode()


_HEADER = TypeAdapter(TrialHeader)


def read_header(folder: Path) -> TrialHeader:
    """Read the header in the folder of an attempt. Raise RecordError if it is missing, damaged or changed."""
    path = folder / HEADER_NAME
    if not path.exists():
        raise RecordError(f"{path}: not found, so the attempt is incomplete. {_CURE}.")
    raw = read_bounded(path, max_bytes=_MAX_HEADER_BYTES, cure=_CURE, raises=RecordError)
    form = open_seal(raw, where=str(path), cure=_CURE, raises=RecordError)
    return read_form(_HEADER, form, where=str(path), cure=_CURE, raises=RecordError)


def write_attempt(folder: Path, header: TrialHeader, samples: Samples, films: Mapping[str, bytes]) -> TrialHeader:
    """Write the files of an attempt, and the header after all other files.

    Return the header, which now contains the digests of the files.
    """
    files = {SAMPLES_NAME: samples.to_bytes(), **{f"{camera}.mp4": data for camera, data in films.items()}}
    for name, data in files.items():
        write_durably(folder / name, data)
    form = asdict(header) | {"files": {name: file_digest(folder / name) for name in files}}
    full = read_form(_HEADER, form, where="trial", cure="Report this")
    write_durably(folder / HEADER_NAME, full.to_bytes())
    return full


# ------------------------------------------------------------------------------------------------------------ journal


@strict_form
@dataclass(frozen=True, slots=True)
class Event:
    """One line of the journal of a protocol.

    Attributes:
        event: "begun", "ended", "aborted" (the attempt is discarded, and the trial will be repeated) or "repeated" (a
            person discards a finished attempt).
        code: Code of the trial.
        attempt: Number of the attempt, counted from 1.
        time: Time of the event.
        reason: What ended the attempt; for "aborted" and "repeated", a sentence with the reason.
        person: Operator who started or discarded the attempt; empty for other events.
        record: SHA-256 of the attempt's ``trial.json``; only for "ended".
        plan: SHA-256 of ``plan.json``; only for "begun". None in journals of earlier versions.
    """

    event: Literal["begun", "ended", "aborted", "repeated"]
    code: str
    attempt: Annotated[int, Field(ge=1)]
    time: Time
    reason: Annotated[str, Field(max_length=500)] = ""
    person: Annotated[str, Field(max_length=80)] = ""
    record: Digest | None = None
    plan: Digest | None = None


_EVENT = TypeAdapter(Event)

TrialState = Literal["open", "running", "done"]
"""State of a trial: open (not run yet), running, or done (finished)."""


@dataclass(frozen=True, slots=True)
class TrialProgress:
    """Progress of a trial.

    Attributes:
        state: State of the trial.
        attempt: Number of the last attempt; 0 if there was none.
        record: SHA-256 of the header of the finished attempt.
        ending: What ended the finished attempt.
    """

    state: TrialState = "open"
    attempt: int = 0
    record: str | None = None
    ending: str = ""

    def after(self, event: Event, where: str) -> TrialProgress:
        """Return the progress after an event. Raise RecordError if the event is not possible in the current state."""
        begins = event.event == "begun"
        expected: TrialState = {"begun": "open", "repeated": "done"}.get(event.event, "running")  # type: ignore[assignment]
        if self.state != expected or event.attempt != self.attempt + begins:
            problem = f"attempt {event.attempt} of {event.code} is {event.event}, but attempt {self.attempt} is"
            raise RecordError(f"{where}: {problem} {self.state}. {_JOURNAL_CURE}.")
        if event.event == "ended":
            return TrialProgress("done", event.attempt, event.record, event.reason)
        return TrialProgress("running" if begins else "open", event.attempt)


def _events(path: Path, lines: list[bytes]) -> tuple[list[Event], str]:
    """Parse the lines of a journal. Return the events, and the hash that links the next line to the last line."""
    found, link = [], ""
    for number, (form, after) in enumerate(linked_forms(path, lines, cure=_JOURNAL_CURE), start=1):
        where = f"{path}: line {number}"
        found.append(read_form(_EVENT, form, where=where, cure=_JOURNAL_CURE, raises=RecordError))
        link = after
    return found, link


def _progress(plan: RealPlan, events: list[Event], path: Path) -> dict[str, TrialProgress]:
    """Compute the progress of every planned trial from the events in a journal."""
    states = {trial.code: TrialProgress() for trial in plan.trials}
    here = file_digest(path.parent / PLAN_NAME)
    for number, event in enumerate(events, start=1):
        where = f"{path}: line {number}"
        if event.plan not in (None, here):
            problem = f"the trial was started under a plan other than {path.parent / PLAN_NAME}"
            raise RecordError(f"{where}: {problem}. Restore the plan from a copy, or plan into a new folder.")
        if event.code not in states:
            raise RecordError(f"{where}: the plan has no trial {event.code!r}. {_JOURNAL_CURE}.")
        states[event.code] = states[event.code].after(event, where)
    return states


def _recorded(folder: Path, plan: RealPlan) -> set[str]:
    """Return the codes of all trials whose folder contains a header file."""
    return {trial.code for trial in plan.trials if (folder / "trials" / trial.code / HEADER_NAME).exists()}


def _require_lines(folder: Path, recorded: set[str], states: Mapping[str, TrialProgress]) -> None:
    """Raise RecordError if a recorded trial is missing from the journal, because the journal has then lost lines.

    Without this check, the trial would be repeated and its record moved away. An attempt is listed in the journal
    before its folder is created. ``recorded`` has the codes of the trials that had a header before the journal was
    read.
    """
    for code in recorded:
        place = folder / "trials" / code
        if states[code].state == "done":  # a header of another attempt is reported later as damage to this trial
            continue
        try:
            header = read_header(place)
        except RecordError:
            continue
        if header.code == code and header.attempt > states[code].attempt:
            problem = f"the journal has no line about attempt {header.attempt} of {code}, which is recorded in {place}"
            cure = f"{_JOURNAL_CURE}, or move {place} to another place to run the trial again"
            raise RecordError(f"{folder / JOURNAL_NAME}: {problem}. {cure}.")


class RealJournal(LineJournal):
    """Journal of a protocol, open for appending. While it is open, the folder is locked for this process.

    Raises:
        RunConflictError: If another process is running the protocol.
        RecordError: If a line is damaged or does not match the plan, or the line about a recorded trial is missing.
    """

    def __init__(self, folder: Path) -> None:
        """Open the journal of a protocol folder."""
        self.folder, self.plan = folder, read_plan(folder)
        self._link, self._states = "", dict[str, TrialProgress]()
        super().__init__(folder / JOURNAL_NAME)

    def _take_in(self, lines: list[bytes]) -> None:
        events, self._link = _events(self._path, lines)
        self._states = _progress(self.plan, events, self._path)
        _require_lines(self.folder, _recorded(self.folder, self.plan), self._states)

    def state(self, code: str) -> TrialProgress:
        """Return the progress of a trial."""
        return self._states[code]

    @property
    def next_trial(self) -> PlannedTrial | None:
        """First unfinished trial of the plan, or None if all trials are finished."""
        return next((t for t in self.plan.trials if self._states[t.code].state != "done"), None)

    def _append(self, event: Event) -> None:
        after = self._states[event.code].after(event, str(self._path))
        form = asdict(event)
        read_form(_EVENT, form, where="event", cure="Use a different value")
        link = link_after(self._link, form)
        self._append_line({**form, LINK: link})
        self._link, self._states[event.code] = link, after

    def begin(self, code: str, person: str = "") -> Path:
        """Record the start of the next attempt at a trial, and return an empty folder for the files of the attempt.

        Raise StorageError if the folder cannot be created.
        """
        self._put_away(code)  # left over from an attempt that the journal does not list
        plan = file_digest(self.folder / PLAN_NAME)
        self._append(Event("begun", code, self._states[code].attempt + 1, now(), person=person, plan=plan))
        folder = self.attempt_folder(code)
        with on_disk(folder):
            folder.mkdir(parents=True)
        return folder

    def end(self, code: str, ending: Ending) -> None:
        """Record the end of the running attempt. The files of the attempt must already be written."""
        record = file_digest(self.attempt_folder(code) / HEADER_NAME)
        self._append(Event("ended", code, self._states[code].attempt, now(), ending, record=record))

    def abort(self, code: str, reason: str) -> None:
        """Record that the running attempt was aborted, and move its files to the folder ``aborted``."""
        self._append(Event("aborted", code, self._states[code].attempt, now(), reason[:500]))
        self._put_away(code)

    def repeat(self, code: str, reason: str, person: str) -> None:
        """Discard a finished attempt, so that its trial is repeated.

        Raises:
            InvalidInputError: If the trial is not finished, or the reason is empty.
        """
        if self._states[code].state != "done":
            raise InvalidInputError("repeat", f"{code} is not finished", "Choose a finished trial")
        if not reason.strip():
            raise InvalidInputError("repeat", f"{code} needs a reason", "State why the record of the trial is invalid")
        self._append(Event("repeated", code, self._states[code].attempt, now(), reason[:500], person))
        self._put_away(code)

    def settle(self) -> list[str]:
        """Mark interrupted attempts as aborted, and return the codes of their trials."""
        cut = [code for code, progress in self._states.items() if progress.state == "running"]
        for code in cut:
            self.abort(code, "the program ended before the trial did")
        for code, progress in self._states.items():
            # If the trial is open, the program was killed after writing the line, but before moving the files.
            if progress.state == "open":
                self._put_away(code)
        return cut

    def attempt_folder(self, code: str) -> Path:
        """Return the folder with the files of a trial's valid or current attempt."""
        return self.folder / "trials" / code

    def _put_away(self, code: str) -> None:
        there = self.attempt_folder(code)
        # A broken symbolic link counts as existing.
        if not (there.exists() or there.is_symlink()):
            return
        away = self.folder / "aborted" / f"{code}-{self._states[code].attempt}"
        number = 1
        while away.exists():  # a person created this folder, so it must not be overwritten
            number += 1
            away = away.with_name(f"{code}-{self._states[code].attempt}.{number}")
        with on_disk(away):
            away.parent.mkdir(exist_ok=True)
            there.rename(away)


# ------------------------------------------------------------------------------------------------------------ entries


@strict_form
@dataclass(frozen=True, slots=True)
class Seen:
    """Outcome that a person entered for a trial.

    Attributes:
        outcome: Name of the outcome (:mod:`betterbench.real.outcomes`).
        note: Note of the person.
    """

    outcome: Annotated[str, Field(max_length=40)]
    note: Annotated[str, Field(max_length=500)] = ""
    kind: Literal["seen"] = "seen"

    def __post_init__(self) -> None:
        """Check that the outcome exists, and that the outcome "other" has a note."""
        try:
            outcome_named(self.outcome)
        except UnknownNameError as problem:  # the caller adds the file and the line
            raise ValueError(str(problem)) from problem
        if self.outcome == "other" and not self.note.strip():
            raise ValueError("outcome 'other' needs a note")


Role = Literal["operator", "judge"]
"""Role of a person who enters outcomes: the operator at the arm, or a judge who sees only the video."""


@strict_form
@dataclass(frozen=True, slots=True)
class Entry:
    """One line of ``entries.jsonl``: the entry of one person about one attempt.

    Attributes:
        code: Code of the trial.
        attempt: Number of the attempt.
        author: Name of the person.
        role: Role of the person.
        time: Time of the entry.
        decision: Outcome that was entered, or the undo of the same person's earlier entry about the same attempt.
    """

    code: Annotated[str, Field(max_length=10)]
    attempt: Annotated[int, Field(ge=1)]
    author: Author
    role: Role
    time: Time
    decision: Annotated[Seen | Undo, Field(discriminator="kind")]

    @property
    def content(self) -> str:
        """Hash of the trial code, the attempt, the person's name and the role.

        A later entry with the same hash replaces an earlier entry.
        """
        subject = [self.code, self.attempt, self.author, self.role]
        return content_digest("betterbench real entry", dump_json(subject))

    @property
    def subject(self) -> str:
        """String that names the trial, the person and the role."""
        return f"{self.code} by {self.author} ({self.role})"

    def misfit(self, changes: int) -> str:
        """Return an empty string, because an entry is always allowed: it replaces the person's earlier entry."""
        del changes
        return ""


_ENTRY = TypeAdapter(Entry)


class EntryJournal(DecisionJournal[Entry]):
    """File with the entries of people, open for appending by one process."""

    adapter = _ENTRY

    def last(self, code: str, attempt: int, author: str, role: Role) -> tuple[int, Entry] | None:
        """Return a person's current entry about an attempt, with its line number. Return None if there is no entry."""
        key = Entry(code, attempt, author, role, now(), Seen("done"))
        return self.history(key.content).last


def enter(
    folder: Path, code: str, attempt: int, *, author: str, role: Role, outcome: str | None, note: str = ""
) -> None:
    """Append the outcome that a person enters for an attempt. If the outcome is None, undo the person's last entry.

    The file is open only during the call, so that the operator and judges can work in separate processes.

    Raises:
        UnknownNameError: If the outcome does not exist.
        InvalidInputError: If there is nothing to undo, or a field is invalid.
        RunConflictError: If another process is writing an entry.
    """
    with EntryJournal(folder / ENTRIES_NAME) as journal:
        if outcome is None:
            last = journal.last(code, attempt, author, role)
            if last is None:
                raise InvalidInputError("undo", f"{author} has no entry about {code}", "Enter an outcome first")
            decision: Seen | Undo = Undo(last[0])
        else:
            outcome_named(outcome)
            if outcome == "other" and not note.strip():
                raise InvalidInputError("note", "outcome 'other' needs a note", "Describe what was seen")
            decision = Seen(outcome, note)
        journal.append(Entry(code, attempt, author, role, now(), decision))


# ------------------------------------------------------------------------------------------------------------ reading


@dataclass(frozen=True, slots=True)
class RealTrial:
    """Finished trial of a protocol.

    Attributes:
        planned: Entry of the trial in the plan.
        header: Header of the valid attempt.
        folder: Folder of the trial.
        entries: Current entries about the valid attempt, the last one of each person and role, in the order of the
            file.
    """

    planned: PlannedTrial
    header: TrialHeader
    folder: Path
    entries: tuple[Entry, ...] = ()

    @property
    def code(self) -> str:
        """Code of the trial."""
        return self.planned.code

    def samples(self) -> Samples:
        """Read the samples of the trial. Raise RecordError if the file is missing, changed or damaged."""
        samples = Samples.read(self._checked(SAMPLES_NAME))
        if len(samples) != self.header.steps:
            problem = f"the file has {len(samples)} rows, but {HEADER_NAME} states {self.header.steps}"
            raise RecordError(f"{self.folder / SAMPLES_NAME}: {problem}. {_CURE}.")
        return samples

    def check(self) -> None:
        """Raise RecordError if a file listed in the header is missing or changed, or if the samples are not listed."""
        for name in dict.fromkeys((SAMPLES_NAME, *self.header.files)):
            self._checked(name)

    def film(self, camera: str) -> Path:
        """Return the path of a camera's video after checking its digest.

        Raise RecordError if the video is missing or was changed.
        """
        return self._checked(f"{camera}.mp4")

    def seen_by(self, role: Role) -> tuple[Entry, ...]:
        """Return the current entries of the people with the given role."""
        return tuple(entry for entry in self.entries if entry.role == role)

    def _checked(self, name: str) -> Path:
        path = self.folder / name
        told = self.header.files.get(name)
        if told is None:
            raise RecordError(f"{path}: the file is not listed in {HEADER_NAME}. {_CURE}.")
        if not path.is_file():
            raise RecordError(f"{path}: not found. {_CURE}.")
        if file_digest(path) != told:
            raise RecordError(f"{path}: the file was changed after it was recorded. {_CURE}.")
        return path


@dataclass(frozen=True, slots=True)
class DamagedTrial:
    """Finished trial whose files are missing, damaged or different from the recorded files.

    Attributes:
        planned: Entry of the trial in the plan.
        attempt: Number of the attempt, counted from 1.
        folder: Folder of the trial.
        problem: Description of the damage, with the file and a remedy.
    """

    planned: PlannedTrial
    attempt: int
    folder: Path
    problem: str

    @property
    def code(self) -> str:
        """Code of the trial."""
        return self.planned.code


@dataclass(frozen=True, slots=True)
class RealRun:
    """Content of a protocol folder: the plan, and the trials that have been run so far.

    Attributes:
        folder: Folder of the protocol.
        plan: Plan of the protocol.
        events: Lines of the journal.
        states: Progress of each trial by code.
        trials: Finished trials with an intact header, in the order of the plan.
        damaged: All other finished trials, in the order of the plan.
        operators: Names of all operators, including the operators of invalid attempts and undone entries.
        judges: Names of all people who entered an outcome as a judge.
    """

    folder: Path
    plan: RealPlan
    events: tuple[Event, ...]
    states: Mapping[str, TrialProgress]
    trials: tuple[RealTrial, ...]
    damaged: tuple[DamagedTrial, ...] = ()
    operators: frozenset[str] = frozenset()
    judges: frozenset[str] = frozenset()

    @property
    def aborted(self) -> tuple[Event, ...]:
        """Events about discarded attempts: those that were aborted, and those that a person discarded later."""
        return tuple(event for event in self.events if event.event in ("aborted", "repeated"))

    def trial(self, code: str) -> RealTrial:
        """Return a finished trial.

        Raises:
            InvalidInputError: If the trial is not finished.
            RecordError: If the trial is damaged.
        """
        for trial in self.trials:
            if trial.code == code:
                return trial
        for damaged in self.damaged:
            if damaged.code == code:
                raise RecordError(damaged.problem)
        self.plan.trial(code)
        raise InvalidInputError("trial", f"{code} is not finished", "Run it with `better real run`")


def read_run(folder: Path) -> RealRun:
    """Read the folder of a protocol. Samples and videos are read only when they are needed.

    A trial whose header is missing, damaged or changed is listed in :attr:`RealRun.damaged`, so that one bad file does
    not hide the other trials. Damage to the plan, the journal or the entries affects all trials and is an error.

    Raises:
        RecordError: If the plan, the journal or the entries are missing, damaged or changed. The message names the
            file.
    """
    plan = read_plan(folder)
    path = folder / JOURNAL_NAME
    recorded = _recorded(folder, plan)
    lines, _ = complete_lines(path)
    if lines:
        say_lost_tail(path)
    events, _ = _events(path, lines)
    states = _progress(plan, events, path)
    _require_lines(folder, recorded, states)
    entries = _entries(folder / ENTRIES_NAME, states)
    standing = _standing(entries, folder / ENTRIES_NAME)
    trials, damaged = [], []
    for planned in plan.trials:
        progress = states[planned.code]
        if progress.state != "done":
            continue
        place = folder / "trials" / planned.code
        try:
            header = _header_of(planned.code, progress, place, path)
        except RecordError as problem:
            damaged.append(DamagedTrial(planned, progress.attempt, place, str(problem)))
            continue
        seen = tuple(e for e in standing if (e.code, e.attempt) == (planned.code, progress.attempt))
        trials.append(RealTrial(planned, header, place, seen))
    operators = {e.person for e in events if e.person} | {e.author for e in entries if e.role == "operator"}
    judges = frozenset(e.author for e in entries if e.role == "judge")
    return RealRun(folder, plan, tuple(events), states, tuple(trials), tuple(damaged), frozenset(operators), judges)


def repeat_damaged(folder: Path, codes: Sequence[str], person: str) -> None:
    """Schedule damaged trials for repetition, and move their remaining files to ``aborted``.

    Raises:
        InvalidInputError: If a trial is unfinished or undamaged. An undamaged trial must not be repeated because of its
            result.
        RunConflictError: If another process is running the protocol.
        RecordError: If the plan, the journal or the entries are damaged.
    """
    with RealJournal(folder) as journal:
        problems = {code: _damage(read_run(folder), code) for code in codes}
        for code, problem in problems.items():
            if not problem:
                cure = "Leave out the code; an invalid trial is discarded when its outcome is entered"
                raise InvalidInputError("--repeat", f"{code} is not damaged", cure)
        for code, problem in problems.items():
            journal.repeat(code, problem, person)


def _damage(run: RealRun, code: str) -> str:
    """Return a description of the damage to a trial's files; empty if there is none."""
    try:
        trial = run.trial(code)
        trial.check()
        trial.samples()
    except RecordError as problem:
        return str(problem)
    return ""


def _header_of(code: str, progress: TrialProgress, place: Path, journal: Path) -> TrialHeader:
    """Read the header of a finished trial. Raise RecordError if it is not the header that the journal lists."""
    header = read_header(place)
    if file_digest(place / HEADER_NAME) != progress.record:
        raise RecordError(f"{place / HEADER_NAME}: this is not the file that {journal} lists. {_CURE}.")
    if (header.code, header.attempt) != (code, progress.attempt):
        problem = f"this is the header of attempt {header.attempt} of {header.code}, not {progress.attempt} of"
        raise RecordError(f"{place / HEADER_NAME}: {problem} {code}. {_CURE}.")
    return header


def _entries(path: Path, states: Mapping[str, TrialProgress]) -> tuple[Entry, ...]:
    """Read all lines of an entries file. Raise RecordError for an entry about an attempt that was never started."""
    entries = read_decisions(_ENTRY, path) if path.exists() else ()
    for number, entry in enumerate(entries, start=1):
        known = states.get(entry.code)
        if known is None:
            problem = f"the plan has no trial {entry.code!r}, so this file belongs to another protocol"
            raise RecordError(f"{path}: line {number}: {problem}. {_JOURNAL_CURE}.")
        if entry.attempt > known.attempt:
            problem = f"attempt {entry.attempt} of {entry.code} never began"
            raise RecordError(f"{path}: line {number}: {problem}. {_JOURNAL_CURE}.")
    return entries


def _standing(entries: Sequence[Entry], path: Path) -> list[Entry]:
    """Return the last entry of each person, role and attempt, in the order of the file.

    Entries that were undone are left out.
    """
    lasts = [history.last for history in histories(entries, str(path)).values()]
    return [last[1] for last in sorted((last for last in lasts if last is not None), key=lambda last: last[0])]
