"""Charts of a report. Each rate is shown with its counts and its confidence interval."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Sequence

from betterbench.diagnosis.verdict import RunDiagnosis, TrialDiagnosis
from betterbench.report.figures.drawing import GRID, Bar, BarGroup, Chart, Scale, Stack, StackGroup
from betterbench.report.legend import AXIS_NAMES, LEGEND, causes_judged, families_of
from betterbench.report.outcomes import task_title
from betterbench.report.wording import Figure
from betterbench.statistics import Rate
from betterbench.statistics.power import DEFAULT_ALPHA
from betterbench.tasks.labels import Kind

MODES_SHOWN = 6
"""Maximum number of failure modes that the chart shows per policy. The CSV file of trials contains all of them."""

HOLM_NOTE = (
    " An interval may exclude zero although p is large. The interval is for this row only, while p is exact for few "
    "pairs and is corrected for the number of axes (Holm). Only a small p shows a gap."
)
"""Note below the chart of illusion gaps, for rows whose interval and p-value seem to contradict each other."""

_PAIR = (("training", "Training twins"), ("variation", "Variations"))
TWINS_NOTE = "Training twins are the training trials from which the variations are derived, one per pair."

Keep = Callable[[TrialDiagnosis], bool]


def charts_of(diagnoses: Sequence[RunDiagnosis]) -> tuple[Chart, ...]:
    """Return all charts for which the runs have data."""
    made = (axes_chart, outcomes_chart, gap_chart, modes_chart, grasps_chart, tasks_chart)
    return tuple(chart for chart in (make(diagnoses) for make in made) if chart.groups)


def axes_chart(diagnoses: Sequence[RunDiagnosis]) -> Chart:
    """Return a chart of success on variations and on the training trials with the same seeds, by variation axis."""
    return Chart(
        "axes",
        "Success in training and under each axis of variation",
        f"Success rate in percent with its 95 % interval. {TWINS_NOTE}",
        tuple(g for scope, title in _scopes() if (g := _pairs(diagnoses, title, scope)) is not None),
        key=_PAIR,
    )


def tasks_chart(diagnoses: Sequence[RunDiagnosis]) -> Chart:
    """Return a chart of success on variations and on the training trials with the same seeds, by task."""
    names = sorted({t.task for d in diagnoses for t in d.trials if t.variation is not None})
    groups = (_pairs(diagnoses, task_title(name), name) for name in names)
    return Chart(
        "tasks",
        "Success in training and under variation, by task",
        f"Success rate in percent with its 95 % interval. {TWINS_NOTE}",
        tuple(group for group in groups if group is not None),
        key=_PAIR,
    )


def gap_chart(diagnoses: Sequence[RunDiagnosis]) -> Chart:
    """Return the chart of illusion gaps (training success minus variation success), in total and by variation axis."""
    single = len(diagnoses) == 1
    groups = []
    for scope, title in _scopes():
        rows = [
            Bar(title if single else d.policy, figure, "dot")
            for d in diagnoses
            if not (figure := _gap(d, scope)).missing
        ]
        if rows:
            groups.append(BarGroup("" if single else title, tuple(rows)))
    ends = [
        e for g in groups for r in g.rows for e in (r.figure.value, r.figure.low, r.figure.high) if e is not None
    ]  # fmt: skip
    low = math.floor(min([0.0, *ends]) / GRID + 1e-9) * GRID
    high = math.ceil(max([GRID, *ends]) / GRID - 1e-9) * GRID
    clear = [r.figure for g in groups for r in g.rows if (r.figure.low or 0.0) > 0.0 or (r.figure.high or 0.0) < 0.0]
    doubtful = any((figure.p_value or 0.0) > DEFAULT_ALPHA for figure in clear)
    return Chart(
        "gap",
        "Illusion gap",
        "Success of the training twin minus success of the variation, in percentage points, with 95 % intervals and "
        "the exact McNemar test (Holm over the axes of a policy). A positive gap means that training success "
        f"overstates the ability.{HOLM_NOTE if doubtful else ''}",
        tuple(groups),
        Scale(low, high),
    )


def outcomes_chart(diagnoses: Sequence[RunDiagnosis]) -> Chart:
    """Return the chart of trial outcomes: in training, over all variations, and by variation axis."""
    scopes: list[tuple[str, Keep]] = [
        ("Training", lambda t: t.variation is None),
        ("All variations", lambda t: t.variation is not None),
    ]
    scopes += [(name, lambda t, a=a: t.axis == a) for a, name in AXIS_NAMES.items()]  # type: ignore[misc]
    families = families_of(diagnoses)
    groups: list[StackGroup] = []
    for title, keep in scopes:
        rows = [
            Stack(title if len(diagnoses) == 1 else d.policy, _families([t for t in d.trials if keep(t)], families))
            for d in diagnoses
            if any(map(keep, d.trials))
        ]
        if rows:
            groups.append(StackGroup("" if len(diagnoses) == 1 else title, tuple(rows)))
    causes = (
        "Reasoning failure: the policy went for the wrong object. Execution failure: the policy went for the correct "
        "target at the right time, but the manipulation failed. "
    )
    return Chart(
        "outcomes",
        "How the trials ended",
        f"Numbers of trials. {causes if causes_judged(diagnoses) else ''}System failure: the policy did not run.",
        tuple(groups),
        key=tuple(families.items()),
    )


def modes_chart(diagnoses: Sequence[RunDiagnosis]) -> Chart:
    """Return the chart of the most frequent failure modes in variation trials."""
    families = families_of(diagnoses)
    groups = []
    for d in diagnoses:
        varied = [t for t in d.trials if t.variation is not None]
        counts = Counter(t.label for t in varied if t.kind not in (Kind.NONE, Kind.UNFINISHED))
        ranked = sorted(counts, key=lambda label: (-counts[label], list(LEGEND).index(label)))[:MODES_SHOWN]
        rows = tuple(
            Bar(LEGEND[label].short, Figure.of_rate(Rate(counts[label], len(varied))), LEGEND[label].family)
            for label in ranked
        )
        if rows:
            groups.append(BarGroup("" if len(diagnoses) == 1 else d.policy, rows))
    return Chart(
        "modes",
        "Failure modes",
        "Percentage of all variation trials that ended with each label, with its 95 % interval.",
        tuple(groups),
        key=tuple((f, n) for f, n in families.items() if any(r.style == f for g in groups for r in g.rows)),
    )


def grasps_chart(diagnoses: Sequence[RunDiagnosis]) -> Chart:
    """Return the chart of distractor grasp rates: in training, over all variations, and by variation axis."""
    single = len(diagnoses) == 1
    groups = []
    for scope, title in (("training", "Training"), *_scopes()):
        rows = []
        for d in diagnoses:
            figure = Figure.of(d.metric("distractor_grasp_rate", scope), noun="grasps")
            if not figure.missing:
                style = "training" if scope == "training" else "reasoning"
                rows.append(Bar(title if single else d.policy, figure, style))
        if rows:
            groups.append(BarGroup("" if single else title, tuple(rows)))
    return Chart(
        "grasps",
        "Distractor grasp rate",
        "Percentage of grasp attempts that were at an object that was not requested, with the 95 % interval. Air "
        "grasps are not counted. Attempts within a trial are not independent.",
        tuple(groups),
    )


def twin_figure(diagnosis: RunDiagnosis, scope: str) -> Figure:
    """Return the success rate of the training twins, i.e. the training trials that are paired with variation trials.

    The two trials of a pair have the same seed. A training trial that is paired with several variation trials is
    counted once for each of them.

    The illusion gap is this rate minus the success rate of the variations.

    Args:
        diagnosis: Diagnosis of the run.
        scope: Variations to include, such as "overall" or an axis.
    """
    return Figure.of(diagnosis.metric("twin_success_rate", scope), noun="pairs")


def _pairs(diagnoses: Sequence[RunDiagnosis], title: str, scope: str) -> BarGroup | None:
    """Return two bars per policy: success on variations and on the training trials with the same seeds.

    Return None if no trial is included.
    """
    rows: list[Bar] = []
    for d in diagnoses:
        variation = Figure.of(d.metric("success_rate", scope))
        if variation.missing:
            continue
        names = ("twins", "variations") if len(diagnoses) == 1 else (d.policy, "")
        rows += [Bar(names[0], twin_figure(d, scope), "training"), Bar(names[1], variation, "variation")]
    return BarGroup(title, tuple(rows)) if rows else None


def _families(trials: Sequence[TrialDiagnosis], families: Collection[str]) -> tuple[tuple[str, int], ...]:
    counts = Counter(LEGEND[t.label].family for t in trials)
    return tuple((family, counts[family]) for family in families)


def _gap(diagnosis: RunDiagnosis, scope: str) -> Figure:
    return Figure.gap(diagnosis, scope)


def _scopes() -> tuple[tuple[str, str], ...]:
    return (("overall", "All variations"), *((f"axis:{a}", name) for a, name in AXIS_NAMES.items()))
