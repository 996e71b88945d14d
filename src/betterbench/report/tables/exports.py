"""Tables of a report as CSV for programs, and as LaTeX for papers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.diagnosis.verdict import RunDiagnosis
from betterbench.report.outcomes import variation_rows
from betterbench.report.tables.latex import paper_table_to_latex, table_to_latex
from betterbench.report.tables.matrices import matrices_of, plain_matrix
from betterbench.report.tables.paper import PaperTable, plain_paper_table
from betterbench.report.tables.table import Table, to_csv
from betterbench.report.task_views import task_views
from betterbench.tasks.labels import Kind
from betterbench.tasks.worlds.facts import facts_of_task

OF_CAUSES = (Kind.REASONING, Kind.EXECUTION)
"""Kinds of failure that are unknown if only the outcome of each trial is judged."""


@dataclass(frozen=True, slots=True)
class Export:
    """Table as CSV and as LaTeX, with its number of rows. ``name`` is the file name without extension."""

    name: str
    title: str
    csv: str
    latex: str
    rows: int


def exports_of(diagnoses: Sequence[RunDiagnosis], paper_tables: Sequence[PaperTable]) -> tuple[Export, ...]:
    """Return all tables of a report as CSV and LaTeX."""
    exports = []
    for table in paper_tables:
        plain = plain_paper_table(table)
        exports.append(Export(table.name, table.title, to_csv(plain), paper_table_to_latex(table), len(table.rows)))
    for pair in zip(*map(matrices_of, diagnoses), strict=True):
        if any(m.measured for m in pair):
            plain = plain_matrix(pair)
            exports.append(Export(plain.name, pair[0].title, to_csv(plain), table_to_latex(plain), len(plain.rows)))
    for title, plain, short in (
        ("Tasks: success, illusion gap, leading failure", task_table(diagnoses), None),
        ("Variations: success of trials and twins, outcomes", variation_table(diagnoses), None),
        ("All metrics with their intervals", metric_table(diagnoses), None),
        ("All trials with label and evidence", trial_table(diagnoses), short_trial_table(diagnoses)),
    ):
        exports.append(Export(plain.name, title, to_csv(plain), table_to_latex(short or plain), len(plain.rows)))
    return tuple(exports)


def task_table(diagnoses: Sequence[RunDiagnosis]) -> Table:
    """Return one row per task and policy: success of training twins and variations, illusion gap, and main failure.

    The columns whose names begin with ``training_`` count the training twins (the training trials with the same seeds),
    or all training trials if there are no pairs of trials. The gap is ``training_success_rate`` minus
    ``paired_success_rate``.
    """
    rows = []
    for view in task_views(diagnoses):
        for line in view.lines:
            training, variation, gap, grasps = line.training, line.variation, line.gap, line.grasps
            failure = line.failure
            sides = gap.sides
            paired = (None,) * 3 if sides is None else (sides[1].k, sides[1].n, sides[1].value)
            rows.append(
                (
                    line.policy, view.task, training.k, training.n, training.value, variation.k, variation.n,
                    variation.value, variation.low, variation.high, gap.value, gap.low, gap.high, gap.p_value,
                    grasps.k, grasps.n, grasps.value, None if failure is None else failure.label.value,
                    None if failure is None else failure.count, *paired,
                )
            )  # fmt: skip
    columns = (
        "policy", "task", "training_k", "training_n", "training_success_rate", "k", "n", "success_rate", "low", "high",
        "illusion_gap", "gap_low", "gap_high", "p_value", "distractor_grasps", "grasps", "distractor_grasp_rate",
        "leading_failure", "leading_failure_trials", "paired_k", "pairs", "paired_success_rate",
    )  # fmt: skip
    return Table(
        "tasks",
        "Success rates per task with 95 % intervals. The training column counts the twins, one per pair.",
        columns,
        tuple(rows),
    )


def variation_table(diagnoses: Sequence[RunDiagnosis]) -> Table:
    """Return one row per policy and variation: outcomes, and success rates of the trials and their training twins.

    A training twin is the training trial with the same seed. The counts of reasoning and execution failures are empty
    if the causes of failures are not judged.
    """
    rows = []
    for diagnosis in diagnoses:
        for row in variation_rows(diagnosis):
            trial, twin = row.trial, row.twin
            causes = facts_of_task(row.task).judges_causes
            families = {
                family: row.count_of(family) if causes or Kind(family) not in OF_CAUSES else None
                for family in ("reasoning", "execution", "system", "unfinished")
            }
            rows.append(
                (
                    diagnosis.policy, row.id, row.axis, row.title, trial.k, trial.n, trial.value, trial.low, trial.high,
                    twin.k, twin.n, twin.value, row.gap.value, row.gap.low, row.gap.high, row.gap.p_value,
                    *families.values(), row.verdict,
                )
            )  # fmt: skip
    columns = (
        "policy", "variation", "axis", "title", "k", "n", "success_rate", "low", "high", "twin_k", "twin_n",
        "twin_success_rate", "illusion_gap", "gap_low", "gap_high", "p_value", "reasoning", "execution", "system",
        "unfinished", "verdict",
    )  # fmt: skip
    return Table("variations", "Success rates per variation with 95 % intervals.", columns, tuple(rows))


def metric_table(diagnoses: Sequence[RunDiagnosis]) -> Table:
    """Return one row per policy and metric."""
    rows = tuple(
        (d.policy, m.name, m.scope, m.k, m.n, m.value, m.low, m.high, m.p_value, m.method)
        for d in diagnoses
        for m in d.metrics
    )
    columns = ("policy", "metric", "scope", "k", "n", "value", "low", "high", "p_value", "method")
    return Table("metrics", "All metrics with 95 % intervals; rates and differences are fractions.", columns, rows)


def trial_table(diagnoses: Sequence[RunDiagnosis]) -> Table:
    """Return one row per policy and planned trial, with all results of the diagnosis.

    The kind of a failure is empty if the causes of failures are not judged.
    """
    columns = (
        "policy", "task", "variation", "condition", "axis", "seed", "instruction", "expected", "success", "label",
        "kind", "intended", "intended_kind", "intended_any", "first_attempt", "first_attempt_kind", "first_slot",
        "intention_correct", "progress", "attempts", "rule", "evidence", "evidence_start_s", "evidence_end_s",
        "shared", "candidates", "harm", "needless_steps", "needless_start_s", "collisions", "steps", "duration_s",
        "record",
    )  # fmt: skip
    rows = tuple(
        (
            d.policy, t.task, t.variation, t.condition, t.axis, t.seed, t.instruction, t.expected,
            None if t.ambiguous else t.success, t.label.value, t.judged_kind, t.intended, t.intended_kind,
            " ".join(t.intended_any), t.first_attempt,
            t.first_attempt_kind, t.first_slot, t.intention_correct, t.progress,
            len(t.attempts), t.evidence.rule, t.evidence.text, t.evidence.start_s, t.evidence.end_s,
            " ".join(t.evidence.shared), " ".join(t.evidence.candidates), "; ".join(t.harm),
            " ".join(e.text for e in t.needless), " ".join(f"{e.start_s:.2f}" for e in t.needless),
            t.collisions, t.steps, t.duration_s, t.record,
        )
        for d in diagnoses
        for t in d.trials
    )  # fmt: skip
    return Table("trials", "All planned trials.", columns, rows)


def short_trial_table(diagnoses: Sequence[RunDiagnosis]) -> Table:
    """Return the table of trials with only the columns that fit on a printed page."""
    columns = ("policy", "trial", "label", "intended", "first_attempt", "progress")
    rows = tuple(
        (d.policy, t.key, t.label.value, t.intended, t.first_attempt, t.progress) for d in diagnoses for t in d.trials
    )
    return Table("trials", "All planned trials with label, intended object and first attempt.", columns, rows)
