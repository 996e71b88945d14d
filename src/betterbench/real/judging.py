"""Queue of a judge: videos in random order, without the condition, the policy or the entries of other people."""

from __future__ import annotations

import hashlib
import logging
from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError, RecordError
from betterbench.real.outcomes import outcome_named
from betterbench.real.plan import same_name
from betterbench.real.record import RealRun, RealTrial, enter, read_run
from betterbench.wording import plural

logger = logging.getLogger(__name__)


class JudgeDesk:
    """State of one judge's work: the queue of trials, the current trial and the judge's entries.

    The order depends on the seed of the plan and the name of the judge. A judge who runs the command again therefore
    continues in the same order, and each judge gets a different order. A judge sees only the videos, the instruction
    and the judge's own entries.

    Attributes:
        person: Name of the judge.
        trials: Finished trials, in this judge's order.
        index: Index of the current trial.
        message: Message to the judge about the result of the last command.
        is_problem: Whether this message reports a problem.
    """

    def __init__(self, folder: Path, person: str) -> None:
        """Read the finished trials and this judge's earlier entries.

        Raises:
            InvalidInputError: If no trial is finished, the person was an operator of the protocol, or the name is
                nearly the same as an earlier judge's name.
            RecordError: If the plan, the journal or the entries are missing, damaged or changed. Trials whose header is
                damaged are left out and logged.
        """
        run = read_run(folder)
        for damaged in run.damaged:
            logger.warning("%s", damaged.problem)
        if run.damaged and not run.trials:
            problem = (
                f"none of the {plural(len(run.damaged), 'trial')} that are finished can be shown: "
                f"{run.damaged[0].problem}"
            )
            raise RecordError(f"{folder}: {problem}")
        if not run.trials:
            raise InvalidInputError(
                str(folder), "the protocol has no finished trial", "Run trials with `better real run` first"
            )
        if any(same_name(person, other) for other in run.operators):
            problem = f"{person!r} is the operator of this protocol and knows conditions and policies"
            raise InvalidInputError(
                "--person", problem, "Ask another person to judge, and pass the name of that person"
            )
        other = next((name for name in sorted(run.judges) if name != person and same_name(name, person)), None)
        if other is not None and person not in run.judges:
            problem = f"{person!r} differs only in spelling from {other!r}, who already judged here"
            raise InvalidInputError("--person", problem, f"Use the name {other}, or a name that differs more clearly")
        self.folder, self.person = folder, person
        self.trials = _shuffled(run, person)
        self._mine = _entries_of(run, person)
        self._made: list[str] = []  # trials with an entry made in this session, for undo
        self.message, self.is_problem = "", False
        self.index = next((k for k, trial in enumerate(self.trials) if trial.code not in self._mine), 0)

    @property
    def at_hand(self) -> RealTrial:
        """The current trial."""
        return self.trials[self.index]

    @property
    def done(self) -> int:
        """Number of trials for which this judge has entered an outcome."""
        return len(self._mine)

    @property
    def chosen(self) -> str | None:
        """Outcome that this judge entered for the current trial, or None."""
        return self._mine.get(self.at_hand.code)

    def step(self, by: int) -> None:
        """Move forward or backward in the queue by a number of trials. The queue is circular."""
        self.index = (self.index + by) % len(self.trials)
        self._say("")

    def choose(self, outcome: str, note: str = "") -> None:
        """Enter an outcome for the current trial, and go to the next trial without an entry.

        If the operator has discarded the trial in the meantime, or its videos cannot be shown, nothing is entered. The
        message then states the problem.
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
        left = f"{plural(len(waiting), 'video')} left" if waiting else "this was the last video"
        if after:
            self.index = after[0]
        self._say(f"video {number}: {outcome_named(outcome).title}; {left}")

    def _require_shown(self, trial: RealTrial) -> None:
        """Raise InvalidInputError if the operator has discarded a trial, or its videos cannot be shown."""
        name = f"video {self.index + 1}"
        state = read_run(self.folder).states[trial.code]
        if state.state != "done" or state.attempt != trial.header.attempt:
            cure = "Choose another video; restart `better real judge` to see the repeated trial"
            raise InvalidInputError(name, "the operator has discarded this trial", cure)
        if not trial.header.films:
            raise InvalidInputError(name, "this trial has no video, so it cannot be judged", "Choose another trial")
        for camera in trial.header.films:
            self.film(self.index, camera)

    def undo(self) -> None:
        """Undo the last entry of this session. If there is none, undo the entry for the current video.

        The video of the undone entry is shown again.
        """
        if not self._made and self.chosen is None:
            self._say("There is no entry to undo. Go to a video with an entry first.", is_problem=True)
            return
        code = self._made.pop() if self._made else self.at_hand.code
        self.index = next(k for k, trial in enumerate(self.trials) if trial.code == code)
        trial = self.at_hand
        enter(self.folder, code, trial.header.attempt, author=self.person, role="judge", outcome=None)
        # An undo may restore an earlier entry.
        self._mine = _entries_of(read_run(self.folder), self.person)
        self._say(f"video {self.index + 1}: entry undone")

    def film(self, number: int, camera: str) -> bytes:
        """Return a video (MP4) of a trial.

        Args:
            number: Index of the trial in this judge's order.
            camera: Name of the camera.

        Raises:
            InvalidInputError: If the video is missing or was changed. Only the log names the trial, because judges must
                not know it.
        """
        try:
            return self.trials[number].film(camera).read_bytes()
        except (RecordError, OSError) as problem:
            logger.warning("%s", problem)
            told = "cannot be shown, because its file is missing or was changed; the terminal names the file"
            raise InvalidInputError(
                f"video {number + 1}", told, "Continue with another video, and tell the operator"
            ) from problem

    def _say(self, text: str, *, is_problem: bool = False) -> None:
        self.message, self.is_problem = text, is_problem


def _entries_of(run: RealRun, person: str) -> dict[str, str]:
    """Return the outcomes that a judge has entered, by trial code. Entries that were undone are left out."""
    return {
        trial.code: entry.decision.outcome
        for trial in run.trials
        for entry in trial.seen_by("judge")
        if entry.author == person and entry.decision.kind == "seen"
    }


def _shuffled(run: RealRun, person: str) -> tuple[RealTrial, ...]:
    """Return the finished trials in a judge's order.

    Trials that finish later do not change the order of earlier trials.
    """
    place = {code: k for k, code in enumerate(_order([t.code for t in run.plan.trials], run.plan.seed, person))}
    return tuple(sorted(run.trials, key=lambda trial: place[trial.code]))


def _order(codes: list[str], seed: int, person: str) -> list[str]:
    digest = hashlib.sha256(f"betterbench real|{seed}|judge {person}".encode()).digest()
    generator = np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "little")))
    return [codes[k] for k in generator.permutation(len(codes))]
