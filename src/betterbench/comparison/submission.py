"""Submissions, i.e. files with the outcomes and conventions of a run and the hashes of its records."""

from __future__ import annotations

import functools
import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from betterbench.comparison.conventions import side_conventions
from betterbench.diagnosis import Evidence, Kind, RunDiagnosis, TrialDiagnosis, diagnose_run
from betterbench.diagnosis.measures.metrics import compute_metrics
from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.jobs import OnCount
from betterbench.jobs.conflict import first_difference
from betterbench.json_form import Digest, dump_json, file_digest, form_errors, read_bounded, read_form, strict_form
from betterbench.ordinary_file import open_ordinary
from betterbench.quoting import json_text
from betterbench.records import RunFolder
from betterbench.tasks import TrialId
from betterbench.tasks.interventions.resolve import ResolvedCondition, resolve_condition
from betterbench.tasks.labels import Label, all_labels
from betterbench.version import __version__

SUBMISSION_FORMAT = "betterbench-submission"
SUBMISSION_SCHEMA_VERSION = 1
"""Version of the file format. It is increased when earlier versions of betterbench would misread a new file."""

_MAX_BYTES = 64 * 1024 * 1024
_CURE = "Pass the folder of a run, or a file written by `better export`"

Line = Annotated[str, Field(min_length=1, max_length=400, pattern=r"^[^\x00-\x1f\x7f-\x9f]+$")]
Text = Annotated[str, Field(max_length=400, pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")]
Count = Annotated[int, Field(ge=0, le=2**31)]


@strict_form
@dataclass(frozen=True, slots=True)
class SubmittedTrial:
    """Planned trial in a submission.

    Attributes:
        task: Name of the task.
        condition: Name of the variation or of the training condition.
        seed: Seed of the trial.
        status: "done" if there is a record, "broken" if an error prevented a record, "unfinished" if the trial has not
            been run yet.
        success: Whether the trial succeeded.
        label: Outcome label.
        progress: Fraction of the requested subgoals that were completed in a valid order.
        steps: Number of control steps.
        duration_s: Simulated time [s].
        record_sha256: SHA-256 of the record file, or None if there is no record.
    """

    task: Line
    condition: Line
    seed: Count
    status: Literal["done", "broken", "unfinished"]
    success: bool
    label: Line
    progress: Annotated[float, Field(ge=0.0, le=1.0)]
    steps: Count
    duration_s: Annotated[float, Field(ge=0.0)]
    record_sha256: Digest | None

    def __post_init__(self) -> None:
        """Check that the fields agree with each other.

        Raises:
            InvalidInputError: If two fields contradict each other.
        """
        if (self.status == "done") != (self.record_sha256 is not None):
            raise InvalidInputError(
                self.key,
                f"record_sha256 must be set if, and only if, the trial is done; its status is {self.status}",
                _CURE,
            )
        labels = {label.value: label for label in all_labels()}
        if self.label not in labels:
            raise InvalidInputError(self.key, f"{self.label!r} is not a label of this version of betterbench", _CURE)
        if self.success != (labels[self.label].kind is Kind.NONE):
            raise InvalidInputError(
                self.key, f"success is {self.success}, which contradicts the label {self.label}", _CURE
            )

    @property
    def key(self) -> str:
        """Key of the trial as a string ("fast_food/T1/3")."""
        return str(TrialId(self.task, self.condition, self.seed))


@strict_form
@dataclass(frozen=True, slots=True)
class Submission:
    """Outcomes of one run, as a file that can be published.

    Attributes:
        format: Name of the file format.
        schema_version: Version of the file format.
        name: Name of the policy.
        policy: Policy address.
        declared: Properties that the policy declared about itself.
        betterbench: Version of betterbench that judged the trials.
        conventions: Versions and other conventions in the plan and the records, by name.
        thresholds: Thresholds of the diagnosis, by name.
        plan_sha256: SHA-256 of the plan as canonical JSON.
        left_out: Number of trials that are left out. These are the ambiguous trials and, in a run with
            ``--until-decided``, the trials that were chosen because of earlier outcomes.
        trials: All other planned trials, in the order of the plan.
        sha256: SHA-256 of all other fields as canonical JSON. It detects damage, but does not prove who wrote the file.
    """

    format: Literal["betterbench-submission"]
    schema_version: Literal[1]
    name: Line
    policy: Line
    declared: dict[str, Any]
    betterbench: Line
    conventions: dict[Line, Text]
    thresholds: dict[Line, float]
    plan_sha256: Digest
    left_out: Count
    trials: Annotated[tuple[SubmittedTrial, ...], Field(max_length=1_000_000)]
    sha256: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")] = ""

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return asdict(self)

    def file_bytes(self) -> bytes:
        """Return the content of the file as JSON.

        Each line has one field or trial, so that two files are easy to compare.
        """
        form = self.to_json()
        trials, seal = form.pop("trials"), form.pop("sha256")
        fields = [f"{json_text(key)}: {json_text(value)}" for key, value in form.items()]
        listed = ",\n".join(json_text(trial) for trial in trials)
        text = ",\n".join([*fields, f'"trials": [\n{listed}\n]', f'"sha256": {json_text(seal)}'])
        return f"{{\n{text}\n}}\n".encode()

    def sealed(self) -> Submission:
        """Return the submission with ``sha256`` set to the hash of its content."""
        form = self.to_json()
        del form["sha256"]
        return replace(self, sha256=_hash_of(form))

    def diagnosis(self) -> RunDiagnosis:
        """Convert the outcomes to a diagnosis without attempts and without evidence.

        Raises:
            UnknownNameError: If this installation does not have a task or a condition of the submission.
        """
        trials = tuple(_diagnosed(t, self.policy) for t in self.trials)
        return RunDiagnosis(
            policy=self.policy, trials=trials, metrics=compute_metrics(trials), findings=(), notes=(),
            thresholds=self.thresholds, versions=self.conventions,
        )  # fmt: skip

    @property
    def unfinished(self) -> frozenset[str]:
        """Keys of the trials that have not been run."""
        return frozenset(t.key for t in self.trials if t.status == "unfinished")


_FORM = TypeAdapter(Submission)
_BEGINNING = b'{\n"format": "betterbench-submission"'


def submission_of(run: RunFolder, *, name: str | None = None, on_progress: OnCount | None = None) -> Submission:
    """Diagnose a run, and return its outcomes as a submission.

    Args:
        run: The run. If it was made with ``--until-decided``, only the trials of the first round are used.
        name: Name of the policy in the submission. By default, this is the name that the policy declared.
        on_progress: Called with the number of processed trials and the total number of trials.

    Raises:
        RecordError: If the run or a record cannot be read.
        RunConflictError: If the run mixes versions, engines or policies.
        InvalidInputError: If the name is empty, too long or not printable.
    """
    diagnosis = diagnose_run(run, whole=True, on_progress=on_progress)
    ended = {str(TrialId(e.task, e.variation or e.condition, e.seed)) for e in run.entries()}
    declared = run.context.get("policy")
    declared = dict(declared) if isinstance(declared, Mapping) else {}
    called = name if name is not None else str(declared.get("name") or diagnosis.policy)
    even = diagnosis.even_trials
    form = {
        "format": SUBMISSION_FORMAT,
        "schema_version": SUBMISSION_SCHEMA_VERSION,
        "name": called,
        "policy": diagnosis.policy,
        "declared": declared,
        "betterbench": __version__,
        "conventions": side_conventions(run.plan, diagnosis.versions),
        "thresholds": diagnosis.thresholds,
        "plan_sha256": _hash_of(run.plan),
        "left_out": len(diagnosis.trials) - len(even),
        "trials": [asdict(_submitted(run, t, ended=t.key in ended)) for t in even],
    }
    return read_form(
        _FORM,
        form,
        where=str(run.path),
        cure="Use a --name of 1 to 400 printable characters",
    ).sealed()


def is_submission(path: Path) -> bool:
    """Return whether a file looks like a submission of any version.

    Raises:
        OSError: If the file cannot be read.
    """
    with open_ordinary(path) as file:
        return file.read(len(_BEGINNING)) == _BEGINNING


def read_submission(path: Path) -> Submission:
    """Read a submission, and check that it is complete and unchanged.

    Raises:
        InvalidInputError: If the file cannot be read, if a field is malformed or contradicts another field, if a trial
            occurs twice, or if the content does not match its hash.
    """
    where = str(path)
    raw = read_bounded(path, max_bytes=_MAX_BYTES, cure=_CURE)
    with form_errors(where, _CURE):
        found = _FORM.validate_json(raw)
        whole = found.sealed()
    twice = [key for key, n in Counter(t.key for t in found.trials).items() if n > 1]
    if twice:
        raise InvalidInputError(f"{where}: trials", f"{twice[0]} occurs twice", _CURE)
    if whole.sha256 != found.sha256:
        raise InvalidInputError(
            where, "its content does not match its sha256, so it was changed after it was written", _CURE
        )
    return found


def require_same(run: RunFolder, submission: Submission, *, on_progress: OnCount | None = None) -> None:
    """Check that a submission agrees with the records of a run.

    Args:
        run: The run.
        submission: The submission.
        on_progress: Called as in :func:`submission_of`.

    Raises:
        RunConflictError: If the submission and the records disagree. The message names the first difference.
    """
    own = submission_of(run, name=submission.name, on_progress=on_progress).to_json()
    difference = first_difference(json.loads(dump_json(own)), json.loads(dump_json(submission.to_json())), "submission")
    if difference is not None:
        where, there, stated = difference
        raise RunConflictError(
            f"{where} is {there} according to the records of {run.path}, but the submission states {stated}. "
            "Export the run again, or ask for the original run."
        )


def _submitted(run: RunFolder, trial: TrialDiagnosis, *, ended: bool) -> SubmittedTrial:
    record = None if trial.record is None else file_digest(run.path / trial.record)
    return SubmittedTrial(
        task=trial.task, condition=trial.variation or trial.condition, seed=trial.seed,
        status="done" if record else "broken" if ended else "unfinished", success=trial.success,
        label=trial.label.value, progress=trial.progress, steps=trial.steps, duration_s=trial.duration_s,
        record_sha256=record,
    )  # fmt: skip


@functools.cache
def _resolved(task: str, condition: str) -> ResolvedCondition:
    return resolve_condition(task, condition)


def _diagnosed(trial: SubmittedTrial, policy: str) -> TrialDiagnosis:
    """Convert a submitted trial to a diagnosis with a label but without evidence."""
    resolved = _resolved(trial.task, trial.condition)
    # Before version 0.2, submissions labeled unfinished trials as policy errors.
    label = Label.UNFINISHED if trial.status == "unfinished" else Label(trial.label)
    text = "A submission contains only outcomes; the evidence is in the original run."
    return TrialDiagnosis(
        task=trial.task, variation=None if resolved.variation is None else trial.condition, condition=resolved.base,
        axis=resolved.axis, seed=trial.seed, policy=policy, instruction=resolved.condition.instruction.text,
        success=trial.success, expected=resolved.condition.expected.value, label=label,
        first_attempt=None, first_attempt_kind=None, first_slot=None, intended=None, intended_kind=None,
        intended_any=(), intention_correct=None, progress=trial.progress, attempts=(),
        evidence=Evidence("submission", text, 0.0, trial.duration_s), collisions=None, steps=trial.steps,
        duration_s=trial.duration_s, record=None if trial.record_sha256 is None else f"sha256:{trial.record_sha256}",
    )  # fmt: skip


def _hash_of(form: object) -> str:
    return hashlib.sha256(dump_json(form)).hexdigest()


def submission_lines(submission: Submission) -> Iterator[str]:
    """Yield sentences that summarize a submission."""
    counts = Counter(t.status for t in submission.trials)
    solved = sum(t.success for t in submission.trials)
    yield f"{submission.name}: {len(submission.trials)} trials, {solved} succeeded"
    for status in ("broken", "unfinished"):
        if counts[status]:
            yield f"{counts[status]} of them are {status} and count as failures"
    if submission.left_out:
        yield (
            f"{submission.left_out} trials are left out: trials after the first round of --until-decided, whose "
            f"selection depended on outcomes, and ambiguous trials"
        )
