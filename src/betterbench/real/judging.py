"""Queue of a judge: the films of a protocol in random order, without condition, policy and entries of other people."""

from __future__ import annotations

import hashlib
import logging
from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError, RecordError
from betterbench.real.outcomes import outcome_named
from betterbench.real.plan import same_name
from betterbench.real.record import RealRun, RealTrial, enter, read_run
from betterbench.statistics.wording import plural

logger = logging.getLogger(__name__)


class JudgeDesk:
    """State of one judge's work, as the page shows it.

    The order is derived from the plan's seed and the person's name, so that the same command resumes, and no two
    judges see the same order. A judge sees films, the instruction, and the judge's own entries: nothing else.

    Attributes:
        person: Name of the judge.
        trials: Trials that are done, in the order of this judge.
        index: Number of the trial at hand.
        message: Note to the judge about the last command.
        is_problem: Whether the message is a problem.
    """

    def __init__(self, folder: Path, person: str) -> None:
        """Read the protocol.

        Raises:
            InvalidInputError: If no trial is done, the person was an operator of the protocol, or the name is another
                spelling of an earlier judge's name.
            RecordError: If the plan, the journal or the entries are missing, damaged or changed. A trial with such a
                header is left out, and the log contains its name.
        """
        run = read_run(folder)
        for damaged in run.damaged:
            logger.warning("%s", damaged.problem)
        if run.damaged and not run.trials:
            problem = (
                f"none of the {plural(len(run.damaged), 'trial')} that are done can be shown: {run.damaged[0].problem}"
            )
            raise RecordError(f"{folder}: {problem}")
        if not run.trials:
            raise InvalidInputError(str(folder), "has no trial that is done", "Run some with better real run")
        if any(same_name(person, other) for other in run.operators):
            problem = f"{person!r} is the operator of this protocol and knows conditions and policies"
            raise InvalidInputError("--person", problem, "Let another person judge, and give that name")
        other = next((name for name in sorted(run.judges) if name != person and same_name(name, person)), None)
        if other is not None and person not in run.judges:
            problem = f"{person!r} is nearly {other!r}, who judged here: one person would count as two"
            raise InvalidInputError("--person", problem, f"Give {other}, or a name that differs more")
        self.folder, self.person = folder, person
        self.trials = _shuffled(run, person)
        self._mine = _entries_of(run, person)
        self._made: list[str] = []  # trials entered in this session, for undo
        self.message, self.is_problem = "", False
        self.index = next((k for k, trial in enumerate(self.trials) if trial.code not in self._mine), 0)

    @property
    def at_hand(self) -> RealTrial:
        """The trial at hand."""
        return self.trials[self.index]

    @property
    def done(self) -> int:
        """Number of trials with an entry of this judge."""
        return len(self._mine)

    @property
    def chosen(self) -> str | None:
        """This judge's outcome of the trial at hand, or None."""
        return self._mine.get(self.at_hand.code)

    def step(self, by: int) -> None:
        """Go to another trial; the last one is followed by the first."""
        self.index = (self.index + by) % len(self.trials)
        self._say("")

    def choose(self, outcome: str, note: str = "") -> None:
        """Enter an outcome of the trial at hand, and go to the next one without an entry.

        A trial that was discarded meanwhile, or whose films cannot be shown, gets no entry; the message says so.
        """
        trial = self.at_hand
        try:
            self._require_shown(trial)
            enter(
                self.folder,
                trial.code,
                trial.header.attempt,
                author=self.person,
                role="judge",
                outcome=outcome,
                note=note.strip(),
            )
        except InvalidInputError as problem:
            self._say(str(problem), is_problem=True)
            return
        self._mine[trial.code] = outcome
        self._made = [code for code in self._made if code != trial.code] + [trial.code]
        number = self.index + 1
        waiting = [k for k, other in enumerate(self.trials) if other.code not in self._mine]
        after = [k for k in waiting if k > self.index] or waiting
        left = f"{plural(len(waiting), 'film')} left" if waiting else "that was the last film"
        if after:
            self.index = after[0]
        self._say(f"film {number}: {outcome_named(outcome).title}; {left}")

    def _require_shown(self, trial: RealTrial) -> None:
        """Raise InvalidInputError if the operator discarded a trial, or its films cannot be shown."""
        name = f"film {self.index + 1}"
        state = read_run(self.folder).states[trial.code]
        if state.state != "done" or state.attempt != trial.header.attempt:
            cure = "Go on with another film; start better real judge again for the new one"
            raise InvalidInputError(name, "was discarded by the operator meanwhile", cure)
        if not trial.header.films:
            raise InvalidInputError(name, "this trial has no film, so that nothing can be judged", "Go to another one")
        for camera in trial.header.films:
            self.film(self.index, camera)

    def undo(self) -> None:
        """Take back the last entry of this session, else that of the film at hand, and show its film."""
        if not self._made and self.chosen is None:
            self._say("There is no entry to take back. Go to a film with an entry first.", is_problem=True)
            return
        code = self._made.pop() if self._made else self.at_hand.code
        self.index = next(k for k, trial in enumerate(self.trials) if trial.code == code)
        trial = self.at_hand
        enter(self.folder, code, trial.header.attempt, author=self.person, role="judge", outcome=None)
        self._mine = _entries_of(read_run(self.folder), self.person)  # an earlier entry may stand again
        self._say(f"film {self.index + 1}: taken back")

    def film(self, number: int, camera: str) -> bytes:
        """Return a film of a trial by its number in this judge's order, MP4.

        Raises:
            InvalidInputError: If the film is missing or was changed. The message does not name the trial; the log does.
        """
        try:
            return self.trials[number].film(camera).read_bytes()
        except (RecordError, OSError) as problem:
            logger.warning("%s", problem)
            told = "its file is missing or was changed; the terminal of better real judge names it"
            raise InvalidInputError(
                f"film {number + 1}", told, "Go to another film, and tell the operator"
            ) from problem

    def _say(self, text: str, *, is_problem: bool = False) -> None:
        self.message, self.is_problem = text, is_problem


def _entries_of(run: RealRun, person: str) -> dict[str, str]:
    """Return the standing outcomes of a judge by trial."""
    return {
        trial.code: entry.decision.outcome
        for trial in run.trials
        for entry in trial.seen_by("judge")
        if entry.author == person and entry.decision.kind == "seen"
    }


def _shuffled(run: RealRun, person: str) -> tuple[RealTrial, ...]:
    """Return the trials that are done in the order of a judge; later trials do not change the order of the others."""
    place = {code: k for k, code in enumerate(_order([t.code for t in run.plan.trials], run.plan.seed, person))}
    return tuple(sorted(run.trials, key=lambda trial: place[trial.code]))


def _order(codes: list[str], seed: int, person: str) -> list[str]:
    digest = hashlib.sha256(f"betterbench real|{seed}|judge {person}".encode()).digest()
    generator = np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))
    return [codes[k] for k in generator.permutation(len(codes))]
