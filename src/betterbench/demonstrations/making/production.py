"""Production of a demonstration set: workers make attempts from the planned initial states and write a run folder.

``RUN/journal.jsonl`` lists the demonstrations, and ``RUN/attempts/journal.jsonl`` lists every attempt. If no attempt at
an initial state is accepted, the initial state is kept in the plan and marked as an error, and a replacement is added.
The attempts at an initial state depend only on its seed and on the source demonstrations. The records are therefore the
same for any number of workers, and also after interruptions.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from betterbench.certification.certificate import CertificateVersions
from betterbench.certification.journal import CURE, VersionedJournal, forms_after_header
from betterbench.certification.runner import versions_in_use
from betterbench.demonstrations.making.amplifier import AmplifierSettings, SourceChoice
from betterbench.demonstrations.making.attempt import (
    AMPLIFIED,
    EXPERT,
    TELEOPERATED,
    AttemptNote,
    DemonstrationAttempt,
    amplify_attempt,
    collect_attempt,
)
from betterbench.demonstrations.making.sources import Library, load_library
from betterbench.demonstrations.making.starts import (
    FIRST_AMPLIFIED_SEED,
    MOST_STARTS,
    Start,
    planned_starts,
    replacement,
    shared_out,
    twin_starts,
)
from betterbench.errors import InvalidInputError, RecordError, require_between
from betterbench.evaluation.planning.manifest import run_context
from betterbench.evaluation.planning.plan import Plan
from betterbench.evaluation.running.lost import reopen_lost
from betterbench.interface.actions import EE_DELTA, USUAL_ROBOT
from betterbench.jobs import JobProgress, in_processes, run_items
from betterbench.jobs.durable import on_disk
from betterbench.jobs.line_journal import complete_lines, say_lost_tail
from betterbench.json_form import file_digest, open_form, read_form, strict_form
from betterbench.quoting import shell_word
from betterbench.records import Journal, JournalEntry, RunFolder, TrialStatus
from betterbench.sim.scenes import Scene, engine_version
from betterbench.sim.scenes.appearance import look_set_of
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Task, TrialId, get_task
from betterbench.tasks.demonstrated import demonstrated
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.interventions.regimes import Regime, in_regime
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED
from betterbench.tasks.trial import Trial
from betterbench.tasks.user_files import TaskFile, load_sources, loaded_files, options_for

logger = logging.getLogger(__name__)

ATTEMPTS = "attempts"
"""Folder in a run of demonstrations that contains the journal of attempts."""
METHOD_VERSIONS = {EXPERT: 1, TELEOPERATED: 1, AMPLIFIED: 2}
"""Version of each demonstrator's method. A run can only be resumed with the version that started it."""
MOST_ATTEMPTS = 100
MOST_WORKERS = 256


@dataclass(frozen=True, slots=True)
class Method:
    """Method that makes the demonstrations of a run. Instances can be pickled and sent to workers.

    Attributes:
        policy: Policy name in the records: the name of the expert or of the amplifier.
        first_seed: First seed of the initial states.
        attempts: Maximum number of attempts per initial state.
        sources: Run folder with the source demonstrations; "" for the expert.
        sources_hash: Hash of the source demonstrations; "" for the expert.
        source_tasks: Tasks whose source demonstrations are included in ``sources_hash``; empty for the expert.
        settings: Settings for adapting source demonstrations to new initial states.
        quality: Render preset of the stored scenes.
        task_files: User files that workers load first.
        regime: Training distribution whose conditions are demonstrated.
        twins: Whether conditions with the same scene share their seeds and the expert's motion styles, so that
            demonstrations with the same seed differ only in the instruction.
        robot: Name of the robot.
    """

    policy: str
    first_seed: int
    attempts: int
    sources: str = ""
    sources_hash: str = ""
    settings: AmplifierSettings = field(default_factory=AmplifierSettings)
    quality: str = "standard"
    task_files: tuple[TaskFile, ...] = field(default_factory=loaded_files)
    regime: Regime = "training"
    twins: bool = False
    source_tasks: tuple[str, ...] = ()
    robot: str = USUAL_ROBOT

    def task(self, name: str) -> Task:
        """Return a task in which the conditions of the chosen training distribution replace the training conditions."""
        return in_regime(get_task(name), self.regime)

    def starts(self, name: str, demos: int) -> tuple[Start, ...]:
        """Return the initial states for the demonstrations of a task.

        There are ``demos`` initial states per training condition of the task. If another training distribution is used,
        the same total is divided among its conditions.

        Raises InvalidInputError if a number is out of range, or the task does not define the training distribution.
        """
        task = self.task(name)
        require_between("--demos", demos, 1, MOST_STARTS)
        numbers = shared_out(demos * len(get_task(name).training), len(task.training))
        return (twin_starts if self.twins else planned_starts)(task, numbers, first_seed=self.first_seed)

    def replacement(self, start: Start, round_: int) -> Start | None:
        """Return the initial state that replaces an abandoned initial state, or None if no replacement is left.

        Initial states are not replaced if ``twins`` is set, i.e. if conditions share their seeds.
        """
        return None if self.twins else replacement(self.task(start.task), start, round_, first_seed=self.first_seed)

    def to_json(self) -> dict[str, Any]:
        """Return the settings that must not change when a run is resumed.

        The planned trials are compared separately.
        """
        form: dict[str, Any] = {
            "method_version": METHOD_VERSIONS[self.policy],
            "first_seed": self.first_seed,
            "attempts": self.attempts,
        }
        form |= {} if self.regime == "training" else {"regime": self.regime}
        form |= {"twins": True} if self.twins else {}
        return form if not self.sources_hash else {**form, "sources": self.sources_hash, **asdict(self.settings)}


@open_form
@dataclass(frozen=True, slots=True)
class _MethodForm:
    method_version: int
    first_seed: int
    attempts: int
    select: SourceChoice = "nearest_object"
    action_noise: float = 0.0
    sources: str = ""
    regime: Regime = "training"
    twins: bool = False


_METHOD = TypeAdapter(_MethodForm)


def method_of(run: RunFolder) -> Method:
    """Return the method that made the demonstrations of a run.

    Raises RecordError if the run does not contain demonstrations.
    """
    where, cure = f"{run.path}: plan.demonstrations", "Use a run folder of `better collect` or of `better amplify`"
    form = read_form(_METHOD, run.plan.get("demonstrations"), where=where, cure=cure, raises=RecordError)
    quality = run.plan.get("quality")
    return Method(
        str(run.plan.get("policy")),
        form.first_seed,
        form.attempts,
        str(run.context.get("sources", "")),
        form.sources,
        AmplifierSettings(form.select, form.action_noise),
        str(quality.get("name")) if isinstance(quality, dict) else "standard",
        regime=form.regime,
        twins=form.twins,
        robot=str(run.plan.get("robot", USUAL_ROBOT)),
        source_tasks=tuple(dict.fromkeys(trial.task for trial in run.planned)) if form.sources else (),
    )


@strict_form
@dataclass(frozen=True, slots=True)
class StartOutcome:
    """Outcomes of the attempts at one initial state.

    Attributes:
        notes: One outcome per attempt, in order. Only the last attempt can be accepted.
    """

    task: str
    condition: str
    seed: int
    notes: tuple[AttemptNote, ...]

    @property
    def trial(self) -> TrialId:
        """Trial that starts from this initial state."""
        return TrialId(self.task, self.condition, self.seed)

    @property
    def accepted(self) -> bool:
        """Whether there is a demonstration for this initial state."""
        return bool(self.notes) and self.notes[-1].accepted

    @property
    def why_not(self) -> str:
        """Reason why there is no demonstration for this initial state, in one line."""
        kinds = dict.fromkeys(note.failure for note in self.notes)
        return f"given up after {len(self.notes)} attempts ({', '.join(kinds)}): {self.notes[-1].reason}"


@dataclass(frozen=True, slots=True)
class _Produced:
    outcome: StartOutcome
    digest: str | None
    scene: str | None
    wall: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class SetProgress:
    """Progress of a set: finished and planned demonstrations, number of attempts, and the last outcome."""

    done: int
    planned: int
    attempts: int
    last: StartOutcome | None


_OUTCOME = TypeAdapter(StartOutcome)


class AttemptJournal(VersionedJournal):
    """Journal of all attempts in a run.

    If several lines are about the same initial state, only the last of these lines is used. Raises the same errors as
    :class:`VersionedJournal`.
    """

    form = "betterbench attempts journal"

    def __init__(self, path: Path, versions: CertificateVersions) -> None:
        self.found: dict[TrialId, StartOutcome] = {}
        super().__init__(path, versions, renews=True)

    def append(self, outcome: StartOutcome) -> None:
        """Append the outcome of an initial state, and sync the journal to disk."""
        self._append_form(asdict(outcome))
        self.found[outcome.trial] = outcome

    def _take_in_line(self, form: dict[str, Any], where: str) -> None:
        outcome = _read_line(form, where)
        self.found[outcome.trial] = outcome


def _read_line(form: dict[str, Any], where: str) -> StartOutcome:
    return read_form(_OUTCOME, form, where=where, cure=CURE, raises=RecordError)


def attempts_of(run: Path) -> dict[TrialId, StartOutcome]:
    """Return the outcomes of all initial states that were attempted so far.

    Raises RecordError if the journal is corrupt.
    """
    path = run / ATTEMPTS / "journal.jsonl"
    lines, _ = complete_lines(path)
    if lines:
        say_lost_tail(path)
    forms = forms_after_header(path, lines) if lines else ()
    found = [_read_line(form, f"{path}: line {i} is corrupt") for i, (form, _) in enumerate(forms, start=2)]
    return {outcome.trial: outcome for outcome in found}


def collect(
    tasks: Sequence[str],
    out: Path,
    *,
    demos: int,
    first_seed: int = FIRST_DEMONSTRATION_SEED,
    attempts: int = 4,
    regime: Regime = "training",
    twins: bool = False,
    robot: str | None = None,
    workers: int = 1,
    on_progress: Callable[[SetProgress], None] | None = None,
) -> RunFolder:
    """Collect demonstrations by running the expert in various motion styles.

    If the run was interrupted, calling this function again resumes it.

    Args:
        tasks: Names of the tasks.
        out: Run folder.
        demos: Demonstrations per training condition. If another training distribution is chosen, the same total is
            divided among its conditions.
        first_seed: First seed of the initial states.
        attempts: Maximum number of attempts per initial state, each in a different motion style.
        regime: Training distribution whose conditions are demonstrated.
        twins: Whether conditions with the same scene get the same seeds and motion styles, so that demonstrations with
            the same seed differ only in the instruction.
        robot: Name of the robot. The default is the robot that the first task is designed for.
        workers: Number of worker processes.
        on_progress: Called at the start and after every initial state.

    Raises:
        InvalidInputError: If a number is out of range, the training distribution of a task was not measured, or a task
            does not define the chosen training distribution.
        UnknownNameError: If a task does not exist.
        RunConflictError: If the folder contains another run, or another process writes to it.
        StorageError: If the disk is full.
        WorkerError: If worker processes keep dying.
    """
    arm = robot or (get_task(tasks[0]).robot if tasks else USUAL_ROBOT)
    method = Method(EXPERT, first_seed, attempts, regime=regime, twins=twins, robot=arm)
    return _produce(method, tasks, out, demos=demos, workers=workers, on_progress=on_progress)


def amplify(
    sources: Path,
    out: Path,
    *,
    tasks: Sequence[str] = (),
    demos: int = 50,
    first_seed: int = FIRST_AMPLIFIED_SEED,
    attempts: int = 6,
    settings: AmplifierSettings | None = None,
    workers: int = 1,
    on_progress: Callable[[SetProgress], None] | None = None,
) -> RunFolder:
    """Generate demonstrations for new initial states from the demonstrations of a run, in a new run folder.

    If the run was interrupted, calling this function again resumes it.

    Args:
        sources: Run folder with the source demonstrations.
        out: Output run folder.
        tasks: Names of the tasks. The default is all tasks that the sources demonstrate.
        demos: Demonstrations per training condition.
        first_seed: First seed of the initial states.
        attempts: Maximum number of attempts per initial state, each with a different primary source demonstration.
        settings: Settings for the transfer to new scenes.
        workers: Number of worker processes.
        on_progress: Called at the start and after every initial state.

    Raises:
        InvalidInputError: If a number is out of range, or the source demonstrations are missing or use test seeds.
        RecordError: If a source demonstration cannot be read.
        RunConflictError: If the output folder contains another run, or another process writes to it.
        StorageError: If the disk is full.
        WorkerError: If worker processes keep dying.
    """
    chosen = settings or AmplifierSettings()
    require_between("--noise", chosen.action_noise, 0.0, 0.5)
    run = RunFolder.open(sources)
    if out.absolute() == run.path:
        raise InvalidInputError("--out", "it is the folder of the source demonstrations", "Choose another folder")
    known = tuple(dict.fromkeys(e.task for e in run.entries() if e.status == "done"))
    named = tuple(dict.fromkeys(tasks or known))
    if not named:
        raise InvalidInputError(
            str(sources), "it contains no demonstrations", "Collect demonstrations with `better collect`"
        )
    regime = method_of(run).regime if "demonstrations" in run.plan else "training"
    for name in named:
        _check_sources(run, in_regime(get_task(name), regime))
    hashed = set_hash(run, named)
    robot = str(run.plan.get("robot", USUAL_ROBOT))
    method = Method(
        AMPLIFIED, first_seed, attempts, str(run.path), hashed, chosen, regime=regime, source_tasks=named, robot=robot
    )
    return _produce(method, named, out, demos=demos, workers=workers, on_progress=on_progress)


def _check_sources(run: RunFolder, task: Task) -> None:
    """Raise InvalidInputError if a training condition of a task has no source demonstration."""
    library = load_library(run, task.id)
    for condition in task.training:
        if not library.of_condition(condition.name):
            chosen = f"{options_for([task.id])} --tasks {task.id}"
            cure = f"Collect demonstrations: better collect{chosen} --out RUN"
            if run.plan["policy"] == TELEOPERATED:
                cure = f"Demonstrate this condition too: better teleop{chosen} --out {shell_word(run.path)}"
            raise InvalidInputError(str(run.path), f"it contains no demonstration of {condition.id}", cure)


def set_hash(run: RunFolder, tasks: Iterable[str] | None = None) -> str:
    """Return the SHA-256 of the names and contents of a set's records, as 64 hex digits.

    Args:
        run: Folder of the run with the set.
        tasks: Tasks whose records are included; None for all tasks.
    """
    chosen = None if tasks is None else set(tasks)
    done = [e for e in run.entries() if e.status == "done" and (chosen is None or e.task in chosen)]
    lines = sorted(f"{entry.key} {entry.record}\n" for entry in done)
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _produce(
    method: Method,
    tasks: Sequence[str],
    out: Path,
    *,
    demos: int,
    workers: int,
    on_progress: Callable[[SetProgress], None] | None,
) -> RunFolder:
    """Make a demonstration set in rounds, until each initial state has a demonstration or no replacement is left."""
    require_between("--attempts", method.attempts, 1, MOST_ATTEMPTS)
    require_between("--workers", workers, 1, MOST_WORKERS)
    chosen = [get_task(name) for name in dict.fromkeys(tasks)]
    wanted = [s for task in chosen for s in method.starts(task.id, demos)]
    for task in chosen:
        demonstrated(task, engine=engine_version())  # raise an error early if the training support was not measured
    versions = versions_in_use([task.id for task in chosen], robot=method.robot)
    out = out.absolute()
    found = attempts_of(out) if (out / "run.json").exists() else {}
    while True:
        chains = _chains(wanted, found, method)
        with on_disk(out), ExitStack() as stack:
            plan, context = _plan(method, [s for chain in chains for s in chain], workers)
            run = RunFolder.start(out, plan, context=context)
            journal = stack.enter_context(run.journal(renews=True))
            attempts = stack.enter_context(AttemptJournal(out / ATTEMPTS / "journal.jsonl", versions))
            _say_lost(journal, attempts)
            reopen_lost(run, journal)
            run_items(
                [chain[-1] for chain in chains],
                is_done=functools.partial(_is_settled, found=attempts.found, journal=journal),
                work=functools.partial(_produced, run, method, workers),
                keep=functools.partial(_note, journal=journal, attempts=attempts),
                on_progress=None if on_progress is None else _teller(on_progress, chains, attempts),
            )
            # Write files again that were removed during the run.
            changed = [run.restore(), journal.restore(), attempts.restore()]
            is_whole = not any(changed) or not reopen_lost(run, journal)
            found = dict(attempts.found)
        if is_whole and chains == _chains(wanted, found, method):
            return run


def _say_lost(journal: Journal, attempts: AttemptJournal) -> None:
    """Warn about initial states that are in only one of the two journals, because they are attempted again."""
    lost = [entry.key for entry in journal.entries if entry.key not in attempts.found]
    lost += [key for key, outcome in attempts.found.items() if outcome.accepted and not journal.is_done(key)]
    if lost:
        logger.warning(
            "%d initial states are in only one of the journals of demonstrations and attempts (first: %s), because a "
            "journal was truncated or the command was killed. They are attempted again",
            len(lost),
            lost[0],
        )


def _chains(wanted: Sequence[Start], found: Mapping[TrialId, StartOutcome], method: Method) -> list[list[Start]]:
    """Return one list for each planned initial state. It contains the initial state, followed by its replacements."""
    chains = []
    for start in wanted:
        chain = [start]
        while (outcome := found.get(chain[-1].trial)) is not None and not outcome.accepted:
            other = method.replacement(start, len(chain))
            if other is None:
                break
            chain.append(other)
        chains.append(chain)
    return chains


def _is_settled(start: Start, *, found: Mapping[TrialId, StartOutcome], journal: Journal) -> bool:
    outcome = found.get(start.trial)
    return outcome is not None and (not outcome.accepted or journal.is_done(start.trial))


def _plan(method: Method, starts: Sequence[Start], workers: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the plan and the context of a run, as stored in ``run.json``."""
    trials = tuple(_trial(s) for s in sorted(starts, key=lambda s: (s.task, s.condition, s.number, s.round)))
    plan = Plan(method.policy, trials, EE_DELTA.name, "state_only", method.quality, method.robot)
    policy = {"address": method.policy, "name": method.policy, "needs_images": False}
    engine = {"name": "local", "workers": workers, "envs": 1}
    context = {**run_context(plan, policy=policy, engine=engine), "sources": method.sources}
    return {**plan.to_json(), "demonstrations": method.to_json()}, context


def _trial(start: Start) -> Trial:
    found = resolve_condition(start.task, start.condition)
    varied = found.variation is not None
    name, base = (start.condition, found.base) if varied else (None, None)
    return Trial(start.task, start.condition, name, found.axis, base, start.seed, found.condition.expected.value)


def _teller(
    on_progress: Callable[[SetProgress], None], chains: Sequence[Sequence[Start]], attempts: AttemptJournal
) -> Callable[[JobProgress[_Produced]], None]:
    def tell(progress: JobProgress[_Produced]) -> None:
        found, last = attempts.found, progress.last
        done = sum(any(s.trial in found and found[s.trial].accepted for s in chain) for chain in chains)
        tried = sum(len(o.notes) for o in found.values())
        on_progress(SetProgress(done, len(chains), tried, None if last is None else last.outcome))

    return tell


def _produced(run: RunFolder, method: Method, workers: int, due: Iterable[Start]) -> Iterator[_Produced]:
    """Yield outcomes as workers finish.

    Initial states that share a compiled scene are processed one after the other.
    """
    order = sorted((s.trial for s in due), key=lambda t: (t.task, look_set_of(t.task, t.seed), t.condition, t.seed))
    return in_processes(order, functools.partial(_work, str(run.path), method), workers=workers)


def _note(produced: _Produced, *, journal: Journal, attempts: AttemptJournal) -> None:
    """Append the outcome of an initial state to both journals.

    If the process is killed between the two writes, the initial state is attempted again.
    """
    outcome, trial = produced.outcome, produced.outcome.trial
    varied = None if resolve_condition(trial.task, trial.condition).variation is None else trial.condition
    if not journal.is_done(trial):
        status: TrialStatus = "done" if outcome.accepted else "error"
        why = None if outcome.accepted else outcome.why_not
        journal.append(
            JournalEntry(
                trial.task,
                trial.condition,
                varied,
                trial.seed,
                status,
                why,
                produced.wall,
                {},
                produced.digest,
                produced.scene,
            )
        )
    attempts.append(outcome)


def _work(out: str, method: Method, trial: TrialId) -> _Produced:
    """Attempt one initial state until an attempt is accepted, and write its record. Called in a worker process."""
    load_sources(method.task_files)
    run = RunFolder(Path(out), {}, {})  # do not read run.json, because the main process may be writing to it
    began = time.perf_counter()
    scene = scene_of(trial, method.quality, method.robot)
    setup_s = time.perf_counter() - began
    notes: list[AttemptNote] = []
    digest: str | None = None
    stored: str | None = None
    for number in range(method.attempts):
        attempt = attempt_at(scene, number, method)
        notes.append(attempt.note)
        if attempt.note.accepted:
            digest, stored = _write(run, scene, attempt)
            break
    wall = {
        "setup_s": round(setup_s, 6),
        "total_s": round(time.perf_counter() - began, 6),
        "steps": float(sum(note.steps for note in notes)),
    }
    return _Produced(StartOutcome(trial.task, trial.condition, trial.seed, tuple(notes)), digest, stored, wall)


def scene_of(trial: TrialId, quality: str, robot: str) -> Scene:
    """Open the scene of a demonstration, at its initial state."""
    found = resolve_condition(trial.task, trial.condition)
    return Scene(
        found.task,
        found.condition,
        seed=trial.seed,
        action_space=EE_DELTA,
        quality=quality_preset(quality),
        robot_name=robot,
    )


def attempt_at(scene: Scene, number: int, method: Method) -> DemonstrationAttempt:
    """Make one attempt at an initial state.

    Args:
        scene: Scene at the initial state.
        number: Index of the attempt.
        method: Method that makes the demonstrations.
    """
    if method.policy == EXPERT:
        return collect_attempt(scene, number, twins=method.twins)
    library = _library(method.sources, method.sources_hash, method.source_tasks, scene.task.id)
    return amplify_attempt(scene, number, library, method.settings)


@functools.lru_cache(maxsize=4)
def _library(sources: str, sha256: str, tasks: tuple[str, ...], task: str) -> Library:
    """Load the source demonstrations of a task.

    Raises RecordError if their hash has changed, for example because demonstrations were added.
    """
    run = RunFolder.open(Path(sources))
    library = load_library(run, task)
    if (
        set_hash(run, tasks) != sha256
    ):  # checked after loading, so that demonstrations added in the meantime are noticed
        raise RecordError(
            f"{sources}: its demonstrations have changed since the amplification began. Wait until no process writes "
            "to this folder, and then run the same command with another --out folder."
        )
    return library


def _write(run: RunFolder, scene: Scene, attempt: DemonstrationAttempt) -> tuple[str, str]:
    """Write the record of an accepted attempt and, once per scene, the scene. Return the digests of both."""
    with on_disk(run.path):
        path = run.write_record(attempt.record)
        return file_digest(path), run.keep_scene(scene)
