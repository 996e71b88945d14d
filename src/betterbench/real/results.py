"""Results of a protocol on a real arm: labels, diagnostic matrices, rater agreement, and a check of the trial order.

The matrices have the same form as in the report (``report.tables.matrices``). Their rates exclude trials without a
label, which are counted separately for each cell. A trial is damaged if its files are missing or differ from the
recorded files. A damaged trial is listed as unscored and excluded from all other numbers. If runs on the simulated twin
are given, each cell is compared with the same cell in simulation.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from betterbench.diagnosis import diagnose_run
from betterbench.diagnosis.verdict import Attempt, Evidence, RunDiagnosis, TrialDiagnosis
from betterbench.errors import InvalidInputError, RecordError
from betterbench.real.agreement import PairAgreement, agreements_of
from betterbench.real.labels import UNSCORED, Judged, RealLabel, label_trial
from betterbench.real.plan import PlannedTrial, RealPolicy
from betterbench.real.record import DamagedTrial, RealRun, RealTrial, read_run
from betterbench.real.signals import Closing, JointSignals
from betterbench.records import RunFolder
from betterbench.report.tables.cell_position import cell_of
from betterbench.report.tables.matrices import Cell, Matrix, matrices_of, outcomes_text
from betterbench.statistics import Rate
from betterbench.statistics.agreement import AgreementTable
from betterbench.statistics.difference import Difference, newcombe_difference
from betterbench.tasks.authoring.condition_matrix import State
from betterbench.tasks.interventions.resolve import resolve_condition
from betterbench.tasks.labels import Kind, Label
from betterbench.wording import plural


@dataclass(frozen=True, slots=True)
class JudgedTrial:
    """Finished trial with its label.

    Attributes:
        trial: Record of the trial.
        label: Label of the trial, with its evidence.
        signals: Joint signals, or None if there are too few samples.
        judged: Combined entries of the judges.
        ambiguous: Whether the scene of the condition contradicts its instruction, so that no behavior is considered a
            failure.
    """

    trial: RealTrial
    label: RealLabel
    signals: JointSignals | None
    judged: Judged
    ambiguous: bool

    @property
    def counted(self) -> bool:
        """Whether the trial is included in the success rates."""
        return self.label.label is not None and not self.ambiguous

    def to_json(self) -> dict[str, Any]:
        """Return the trial as a JSON-serializable dict."""
        planned, header, signals = self.trial.planned, self.trial.header, self.signals
        form: dict[str, Any] = {
            **asdict(planned),
            **self.label.to_json(),
            "ambiguous": self.ambiguous,
            "attempt": header.attempt,
            "judges": self.judged.votes,
            "operator": self.judged.operator,
            "steps": header.steps,
            "late_steps": header.late_steps,
            "held_steps": header.held_steps,
            "limited_steps": header.limited_steps,
        }
        if signals is not None:
            form["signals"] = {
                "duration_s": signals.duration_s,
                "reach_m": signals.reach_m,
                "path_m": signals.path_m,
                "freeze": None if signals.freeze is None else asdict(signals.freeze),
                "to_and_fro": None if signals.to_and_fro is None else asdict(signals.to_and_fro),
                "repeated": None if signals.repeated is None else asdict(signals.repeated),
                "load_known": signals.load_known,
                "closings": [asdict(closing) for closing in signals.closings],
            }
        return form


@dataclass(frozen=True, slots=True)
class Counts:
    """Numbers of planned trials of a policy, by result. The first five add up to the number of planned trials.

    Attributes:
        right: Number of trials with a correct outcome.
        failed: Number of failed trials.
        ambiguous: Number of labeled trials of conditions whose scene contradicts the instruction.
        unscored: Number of finished trials without a label, including damaged trials.
        open: Number of unfinished trials.
        contradictions: Number of unscored trials in which the judges' entries contradict the joint states.
        damaged: Number of unscored trials whose files are missing, damaged or different from the recorded files.
    """

    right: int
    failed: int
    ambiguous: int
    unscored: int
    open: int
    contradictions: int
    damaged: int

    @classmethod
    def of(cls, trials: Sequence[JudgedTrial], damaged: int, planned: int) -> Counts:
        """Count the planned trials of a policy by their result.

        Args:
            trials: Finished trials with their labels.
            damaged: Number of damaged trials.
            planned: Number of planned trials.
        """
        right = sum(t.counted and t.label.label is not None and t.label.label.kind is Kind.NONE for t in trials)
        counted = sum(t.counted for t in trials)
        unscored = sum(t.label.label is None for t in trials)
        return cls(
            right,
            counted - right,
            len(trials) - counted - unscored,
            unscored + damaged,
            planned - len(trials) - damaged,
            sum(bool(t.label.contradiction) for t in trials),
            damaged,
        )


@dataclass(frozen=True, slots=True)
class Lateness:
    """Rates of late control steps and late camera frames in the trials of a policy.

    Attributes:
        steps: Number of control steps.
        late: Rate of steps that began late.
        held: Rate of steps without an answer from the policy.
        limited: Rate of steps in which the safety limits changed the command.
        frames: Rate of late frames, by camera.
        dropped: Rate of control steps without a new frame, by camera.
    """

    steps: int
    late: Rate
    held: Rate
    limited: Rate
    frames: Mapping[str, Rate]
    dropped: Mapping[str, Rate]

    @classmethod
    def of(cls, trials: Sequence[RealTrial]) -> Lateness:
        """Compute the rates over all steps and frames of some trials."""
        headers = [trial.header for trial in trials]
        steps = sum(h.steps for h in headers)
        cameras = sorted({camera for h in headers for camera in h.films})
        films = {camera: [h.films[camera] for h in headers if camera in h.films] for camera in cameras}
        return cls(
            steps,
            Rate(sum(h.late_steps for h in headers), steps),
            Rate(sum(h.held_steps for h in headers), steps),
            Rate(sum(h.limited_steps for h in headers), steps),
            {c: Rate(sum(f.late for f in found), sum(f.frames for f in found)) for c, found in films.items()},
            {c: Rate(sum(f.dropped for f in found), sum(f.frames for f in found)) for c, found in films.items()},
        )


@dataclass(frozen=True, slots=True)
class PolicyResult:
    """Results of one policy on the task.

    Attributes:
        policy: Policy with its name and address.
        task: Name of the task.
        trials: Finished trials of the policy, without damaged trials.
        damaged: Finished but damaged trials of the policy.
        counts: Numbers of planned trials by result.
        lateness: Rates of late steps and frames.
        diagnosis: Labeled trials, converted to the diagnosis format of a simulated run.
        matrices: Short-horizon and long-horizon diagnostic matrix.
        unscored: Number of unscored trials by matrix name, row and column.
    """

    policy: RealPolicy
    task: str
    trials: tuple[JudgedTrial, ...]
    damaged: tuple[DamagedTrial, ...]
    counts: Counts
    lateness: Lateness
    diagnosis: RunDiagnosis
    matrices: tuple[Matrix, Matrix]
    unscored: Mapping[tuple[str, State, State], int]

    @property
    def labels(self) -> tuple[tuple[str, int], ...]:
        """Labels and the number of trials with each label, starting with the most frequent.

        Ambiguous trials are left out.
        """
        counts = Counter(t.label.name for t in self.trials if not t.ambiguous)
        counts.update(UNSCORED for t in self.damaged if not _is_ambiguous(t.planned, self.task))
        return tuple(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


@dataclass(frozen=True, slots=True)
class OrderCheck:
    """Check of the order in which trials were run, according to the journal.

    Attributes:
        follows_plan: Whether the finished trials were started in the order of the plan.
        longest_run: Largest number of consecutive trials of the same policy.
        expected_run: Largest number of consecutive trials of the same policy in the plan.
        middle: Mean position of each policy's trials in the order of execution, from 0 (first) to 1 (last).
        discarded: Number of attempts that were aborted or repeated, by policy.
    """

    follows_plan: bool
    longest_run: int
    expected_run: int
    middle: Mapping[str, float]
    discarded: Mapping[str, int]

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences that describe the result of the check."""
        found: list[str] = []
        if not self.longest_run:
            pass  # no trial is finished
        elif self.longest_run > self.expected_run:
            found.append(
                f"{self.longest_run} trials of one policy ran in a row, but the plan has at most {self.expected_run}. "
                f"A drift of the light or the calibration may look like an effect of this policy."
            )
        else:
            found.append(
                f"The policies took turns as planned: at most {plural(self.longest_run, 'trial')} of one policy ran "
                f"in a row."
            )
        if not self.follows_plan:
            found.append("Some trials were repeated later, so the order differs from the plan.")
        if len(self.middle) > 1:
            places = ", ".join(f"{name} {value:.2f}" for name, value in self.middle.items())
            found.append(f"Mean position of the trials of each policy, from 0 (first) to 1 (last): {places}.")
        counts = list(self.discarded.values())
        if any(counts):
            told = ", ".join(f"{name} {count}" for name, count in self.discarded.items())
            found.append(f"Attempts that were aborted or repeated: {told}.")
        return tuple(found)


@dataclass(frozen=True, slots=True)
class CellComparison:
    """One cell of a diagnostic matrix on the real arm, compared with the same cell in simulation.

    Attributes:
        matrix: Name of the matrix.
        row: Row of the cell.
        column: Column of the cell.
        conditions: Conditions that belong to the cell.
        real: Success rate on the real arm.
        simulated: Success rate in simulation.
        difference: Real minus simulated success rate, with its interval; None in an ambiguous cell.
        real_labels: String that lists the labels of the real trials with their counts.
        simulated_labels: String that lists the labels of the simulated trials with their counts.
        same_label: Fraction of the real trials that have the most frequent label of the simulated trials; None if there
            are no such trials.
    """

    matrix: str
    row: State
    column: State
    conditions: tuple[str, ...]
    real: Rate
    simulated: Rate
    difference: Difference | None
    real_labels: str
    simulated_labels: str
    same_label: Rate | None

    @property
    def comparable(self) -> bool:
        """Whether both the real arm and the simulation have counted trials in the cell."""
        return self.difference is not None and bool(self.real.n and self.simulated.n)

    @property
    def agrees(self) -> bool | None:
        """Whether the policy mostly succeeds both on the real arm and in simulation, or in neither.

        "Mostly" means in more than half of the trials. The value is None if the cell is not comparable.
        """
        return (2 * self.real.k > self.real.n) is (2 * self.simulated.k > self.simulated.n) if self.comparable else None

    @property
    def differs(self) -> bool:
        """Whether the interval of the difference in success excludes zero."""
        return self.comparable and self.difference is not None and self.difference.excludes_zero


@dataclass(frozen=True, slots=True)
class TwinComparison:
    """Comparison of a policy's diagnostic matrices on the real arm with its matrices in simulation.

    Attributes:
        policy: Name of the policy.
        run: Folder of the simulated run.
        cells: Cells that have trials on the real arm or in simulation.
        same_side: Fraction of cells in which the policy mostly succeeds both on the real arm and in simulation, or in
            neither.
        table: Two-by-two table that counts the cells in which the policy mostly succeeds or mostly fails, on the real
            arm (rows) and in simulation (columns).
        same_label: Fraction of real trials that have the most frequent label of the simulated trials in the cell.
    """

    policy: str
    run: str
    cells: tuple[CellComparison, ...]
    same_side: Rate
    table: AgreementTable
    same_label: Rate

    @property
    def sentence(self) -> str:
        """Sentences about the agreement between the simulated twin and the real arm."""
        k, n = self.same_side.k, self.same_side.n
        if not n:
            return "No cell has trials on both sides."
        text = (
            f"In {k} of {n} cells, real arm and twin are both mostly right or both mostly wrong (95 % interval "
            f"{self.same_side.low:.0%} to {self.same_side.high:.0%})"
        )
        kappa, interval = self.table.kappa, self.table.interval()
        if kappa is not None and interval is not None:
            text += f"; kappa over cells {kappa:.2f} ({interval.low:.2f} to {interval.high:.2f})"
        apart = [cell for cell in self.cells if cell.differs]
        text += f". {plural(len(apart), 'cell')} differ{'s' if len(apart) == 1 else ''} by more than chance explains"
        return f"{text}. {self.same_label.k} of {self.same_label.n} real trials have the twin's most frequent label."


@dataclass(frozen=True, slots=True)
class RealResults:
    """Results of a protocol.

    Attributes:
        run: Content of the protocol folder. Here, ``run.damaged`` also includes trials with damage in files other than
            the header.
        policies: Results of each policy.
        agreements: Agreement of each pair of raters.
        order: Check of the order in which trials were run.
        twins: Comparisons with simulated runs.
    """

    run: RealRun
    policies: tuple[PolicyResult, ...]
    agreements: tuple[PairAgreement, ...]
    order: OrderCheck
    twins: tuple[TwinComparison, ...]

    @property
    def trials(self) -> tuple[JudgedTrial, ...]:
        """All finished trials that are not damaged, in the order of the plan."""
        place = {trial.code: k for k, trial in enumerate(self.run.plan.trials)}
        return tuple(sorted((t for p in self.policies for t in p.trials), key=lambda t: place[t.trial.code]))

    def to_json(self) -> dict[str, Any]:
        """Return the JSON document of ``better real report --json``."""
        task = self.run.plan.task
        forms = {t.trial.code: t.to_json() for t in self.trials}
        forms |= {t.code: _damaged_form(t, task) for t in self.run.damaged}
        return {
            "task": task,
            "repeats": self.run.plan.repeats,
            "planned": len(self.run.plan.trials),
            "trials": [forms[planned.code] for planned in self.run.plan.trials if planned.code in forms],
            "damaged": [{"code": t.code, "problem": t.problem} for t in self.run.damaged],
            "policies": [
                {
                    "policy": p.policy.name,
                    "address": p.policy.address,
                    "counts": asdict(p.counts),
                    "labels": dict(p.labels),
                    "matrices": [_matrix_form(m, p.unscored) for m in p.matrices],
                    "lateness": {
                        "steps": p.lateness.steps,
                        "late": p.lateness.late.to_json(),
                        "held": p.lateness.held.to_json(),
                        "limited": p.lateness.limited.to_json(),
                        "late_frames": {c: r.to_json() for c, r in p.lateness.frames.items()},
                        "dropped_frames": {c: r.to_json() for c, r in p.lateness.dropped.items()},
                    },
                }
                for p in self.policies
            ],
            "agreements": [agreement.to_json() for agreement in self.agreements],
            "order": {**asdict(self.order), "sentences": list(self.order.sentences)},
            "twins": [_twin_form(twin) for twin in self.twins],
        }


def results_of(folder: Path, sims: Sequence[Path] = ()) -> RealResults:
    """Return the results of a protocol, including comparisons with runs on the simulated twin.

    Each simulated run is compared with the policy that has the same address. If the protocol has only one policy, every
    run is compared with this policy.

    Raises:
        RecordError: If the plan, the journal or the entries are missing, damaged or changed. If only the files of one
            trial are damaged, this trial is listed in ``run.damaged`` instead.
        InvalidInputError: If a simulated run belongs to no policy of the protocol, or has a different task.
    """
    run, judged = _judged_run(read_run(folder))
    policies = tuple(_policy_result(run, policy, judged) for policy in run.plan.policies)
    twins = tuple(_compared(path, run, policies) for path in sims)
    return RealResults(run, policies, agreements_of(run.trials), _order_check(run), twins)


def _judged_run(run: RealRun) -> tuple[RealRun, list[JudgedTrial]]:
    """Label the trials of a protocol.

    Return the content of the protocol, including all damaged trials, and the labeled trials.
    """
    judged, damaged = [], {trial.code: trial for trial in run.damaged}
    for trial in run.trials:
        try:
            trial.check()
            judged.append(_judged(trial, run.plan.task))
        except RecordError as problem:
            damaged[trial.code] = DamagedTrial(trial.planned, trial.header.attempt, trial.folder, str(problem))
    ordered = tuple(damaged[planned.code] for planned in run.plan.trials if planned.code in damaged)
    return replace(run, trials=tuple(t.trial for t in judged), damaged=ordered), judged


def _judged(trial: RealTrial, task: str) -> JudgedTrial:
    label, signals, judged = label_trial(trial, task)
    return JudgedTrial(trial, label, signals, judged, _is_ambiguous(trial.planned, task))


def _is_ambiguous(planned: PlannedTrial, task: str) -> bool:
    return resolve_condition(task, planned.condition).condition.expected.value == "ambiguous"


def _damaged_form(trial: DamagedTrial, task: str) -> dict[str, Any]:
    """Return a damaged trial as a JSON-serializable dict, without any values from the trial's files."""
    steps = ("steps", "late_steps", "held_steps", "limited_steps")
    return {
        **asdict(trial.planned),
        **RealLabel(None, "damaged", trial.problem, 0.0, 0.0, "nothing").to_json(),
        "ambiguous": _is_ambiguous(trial.planned, task),
        "attempt": trial.attempt,
        "judges": {},
        "operator": None,
        **dict.fromkeys(steps),
    }


def _policy_result(run: RealRun, policy: RealPolicy, judged: Sequence[JudgedTrial]) -> PolicyResult:
    task = run.plan.task
    trials = [t for t in judged if t.trial.planned.policy == policy.name]
    damaged = tuple(t for t in run.damaged if t.planned.policy == policy.name)
    labeled = tuple(_diagnosed(t, t.label.label, run) for t in trials if t.label.label is not None)
    diagnosis = RunDiagnosis(policy.name, labeled, (), (), (), {}, {}, address=policy.address)
    unscored: Counter[tuple[str, State, State]] = Counter()
    for planned in (*(t.trial.planned for t in trials if t.label.label is None), *(t.planned for t in damaged)):
        at = cell_of(resolve_condition(task, planned.condition))
        if at is not None:
            unscored[f"{at.horizon.value}_horizon_matrix", at.row, at.column] += 1
    count = sum(t.policy == policy.name for t in run.plan.trials)
    return PolicyResult(
        policy,
        task,
        tuple(trials),
        damaged,
        Counts.of(trials, len(damaged), count),
        Lateness.of([t.trial for t in trials]),
        diagnosis,
        matrices_of(diagnosis),
        unscored,
    )


def _diagnosed(judged: JudgedTrial, label: Label, run: RealRun) -> TrialDiagnosis:
    """Convert a real trial to the format of a diagnosed simulated trial, which the matrices of the report need."""
    planned, found = judged.trial.planned, judged.label
    resolved = resolve_condition(run.plan.task, planned.condition)
    right = label.kind is Kind.NONE
    attempts = judged.signals.attempts if judged.signals is not None else ()
    return TrialDiagnosis(
        task=run.plan.task,
        variation=None if resolved.variation is None else planned.condition,
        condition=resolved.base,
        axis=resolved.axis,
        seed=planned.scene_seed,
        policy=planned.policy,
        instruction=judged.trial.header.instruction,
        success=right,
        expected=resolved.condition.expected.value,
        label=label,
        first_attempt=None,
        first_attempt_kind=None,
        first_slot=None,
        intended=None,
        intended_kind=None,
        intended_any=(),
        intention_correct=None,
        progress=float(right),
        attempts=tuple(_attempt(closing) for closing in attempts),
        evidence=Evidence(found.rule, found.text, found.start_s, found.end_s),
        collisions=None,
        steps=judged.trial.header.steps,
        duration_s=0.0 if judged.signals is None else judged.signals.duration_s,
        record=None,
    )


def _attempt(closing: Closing) -> Attempt:
    lifted = closing.holds and closing.lost_s is None
    return Attempt(closing.start_s, closing.over_s, None, None, "null" if not closing.holds else "target", lifted)


def _order_check(run: RealRun) -> OrderCheck:
    """Check the order of all finished trials, including damaged ones.

    Trials are ordered by the start of their last attempt.
    """
    begun = {e.code: k for k, e in enumerate(run.events) if e.event == "begun"}
    done = [planned for planned in run.plan.trials if run.states[planned.code].state == "done"]
    order = sorted(done, key=lambda planned: begun[planned.code])
    names = [policy.name for policy in run.plan.policies]
    last = max(1, len(order) - 1)
    middle = {
        name: sum(k / last for k, p in enumerate(order) if p.policy == name) / count
        for name in names
        if (count := sum(p.policy == name for p in order))
    }
    policy_of = {planned.code: planned.policy for planned in run.plan.trials}
    discarded = Counter(policy_of[event.code] for event in run.aborted)
    return OrderCheck(
        order == done,
        _longest([p.policy for p in order]),
        _longest([p.policy for p in run.plan.trials]),
        middle,
        {name: discarded[name] for name in names},
    )


def _longest(names: Sequence[str]) -> int:
    """Return the largest number of consecutive equal names in a sequence."""
    return max((len(list(group)) for _, group in itertools.groupby(names)), default=0)


# --------------------------------------------------------------------------------------------------------------- twin


def _compared(path: Path, run: RealRun, policies: Sequence[PolicyResult]) -> TwinComparison:
    """Compare a run on the simulated twin with the real trials of the same policy."""
    diagnosis = diagnose_run(RunFolder.open(path))
    tasks = {trial.task for trial in diagnosis.trials}
    if run.plan.task not in tasks:
        problem = f"the run has no trial of {run.plan.task}; its tasks are: {', '.join(sorted(tasks)) or 'no task'}"
        raise InvalidInputError(f"--sim {path}", problem, "Pass a simulated run of the same task")
    mine = [p for p in policies if p.policy.address == diagnosis.address]
    if not mine and len(policies) == 1:
        mine = list(policies)
    if not mine:
        known = ", ".join(p.policy.address for p in policies)
        problem = f"this is a run of {diagnosis.address}, but the protocol has {known}"
        raise InvalidInputError(f"--sim {path}", problem, "Evaluate the same policy on the twin with `better eval`")
    return compare_matrices(mine[0].policy.name, mine[0].matrices, matrices_of(diagnosis), run=str(path))


def compare_matrices(policy: str, real: Sequence[Matrix], twin: Sequence[Matrix], *, run: str = "") -> TwinComparison:
    """Compare a policy's diagnostic matrices on the real arm with its matrices in simulation, cell by cell."""
    cells = []
    for ours, theirs in zip(real, twin, strict=True):
        for row, other in zip(ours.cells, theirs.cells, strict=True):
            cells += [_cell(ours.name, a, b) for a, b in zip(row, other, strict=True) if not (a.empty and b.empty)]
    both = [cell for cell in cells if cell.comparable]
    sides = [("right" if 2 * c.real.k > c.real.n else "not", "right" if 2 * c.simulated.k > c.simulated.n else "not")
             for c in both]  # fmt: skip
    labels = [cell.same_label for cell in cells if cell.same_label is not None]
    return TwinComparison(
        policy,
        run,
        tuple(cells),
        Rate(sum(bool(cell.agrees) for cell in both), len(both)),
        AgreementTable.of_pairs(sides, ("right", "not")),
        Rate(sum(rate.k for rate in labels), sum(rate.n for rate in labels)),
    )


def _cell(matrix: str, real: Cell, twin: Cell) -> CellComparison:
    ambiguous = real.ambiguous or twin.ambiguous
    usual = twin.labels[0][0] if twin.labels else None
    same = None
    if usual is not None and not real.empty:
        same = Rate(dict(real.labels).get(usual, 0), real.success.n)
    return CellComparison(
        matrix,
        real.row,
        real.column,
        tuple(dict.fromkeys(source.id for cell in (real, twin) for source in cell.sources)),
        real.success,
        twin.success,
        None if ambiguous else newcombe_difference(real.success, twin.success),
        outcomes_text(real.labels),
        outcomes_text(twin.labels),
        same,
    )


def _matrix_form(matrix: Matrix, unscored: Mapping[tuple[str, State, State], int]) -> dict[str, Any]:
    return {
        "name": matrix.name,
        "cells": [
            {
                "row": cell.row.value,
                "column": cell.column.value,
                "conditions": [source.id for source in cell.sources],
                "ambiguous": cell.ambiguous,
                **cell.success.to_json(),
                "labels": {label.value: count for label, count in cell.labels},
                "unscored": unscored.get((matrix.name, cell.row, cell.column), 0),
                "paper": cell.paper,
            }
            for row in matrix.cells
            for cell in row
        ],
    }


def _twin_form(twin: TwinComparison) -> dict[str, Any]:
    interval = twin.table.interval()
    return {
        "policy": twin.policy,
        "run": twin.run,
        "sentence": twin.sentence,
        "same_side": twin.same_side.to_json(),
        "kappa": twin.table.kappa,
        "kappa_low": None if interval is None else interval.low,
        "kappa_high": None if interval is None else interval.high,
        "same_label": twin.same_label.to_json(),
        "cells": [
            {
                "matrix": cell.matrix,
                "row": cell.row.value,
                "column": cell.column.value,
                "conditions": list(cell.conditions),
                "real": cell.real.to_json(),
                "simulated": cell.simulated.to_json(),
                "difference": None if cell.difference is None else cell.difference.to_json(),
                "agrees": cell.agrees,
                "real_labels": cell.real_labels,
                "simulated_labels": cell.simulated_labels,
            }
            for cell in twin.cells
        ],
    }
