"""Report section on reliability: certification of the scenes, and measured accuracy of the diagnosis."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from betterbench.certification.coverage import coverage_of, parse_ranges
from betterbench.diagnosis import Calibration, RunDiagnosis, packaged_calibration
from betterbench.diagnosis.measures.confusion import CLAIMED
from betterbench.diagnosis.measures.power_matrix import power_cure, power_matrix_of
from betterbench.report.outcomes import is_abroad
from betterbench.report.pages.calibration_page import calibration_summary, rate_text
from betterbench.report.pages.power_page import flagged, redundant
from betterbench.statistics import Rate
from betterbench.statistics.wording import points
from betterbench.tasks import SUITE_VERSION, Expected, get_task
from betterbench.wording import listed


def trust_of(diagnoses: Sequence[RunDiagnosis]) -> dict[str, str]:
    """Return statements about the reliability of the benchmark for the given runs, by name of the statement.

    Each statement consists of one or two sentences.
    """
    if all(map(is_abroad, diagnoses)):
        return {name: text for d in diagnoses for facts in d.worlds for name, text in facts.statements.items()}
    trials = {(f"{t.task}/{t.variation or t.condition}", t.seed) for d in diagnoses for t in d.trials}
    shown = sorted({looks for d in diagnoses for looks in d.versions.get("looks", "seen").split(" | ")})
    facts = {"Certificate": _certified(trials, shown)}
    held_out = packaged_calibration(CLAIMED)
    facts["Calibration"] = (
        f"This build contains no calibration; run better calibrate --family {CLAIMED}."
        if held_out is None
        else "This was measured on policies with other habits and another controller. The diagnosis was not developed "
        "on these policies. "
        f"{calibration_summary(held_out)} {_interval(held_out)} Command: better calibrate --family {CLAIMED}."
    )
    facts |= _blind({name for name, _ in trials})
    return facts


def _interval(held_out: Calibration) -> str:
    low, high = map(points, held_out.failed.interval)
    return f"If trials are independent, the 95 % interval of the first rate is {low} to {high} %."


def _blind(ran: set[str]) -> dict[str, str]:
    """Return statements about the variations in the run that can be solved without observations, by name."""
    matrix = power_matrix_of(_tasks(ran))
    if matrix is None:
        return {"Blind probes": f"This build contains no power matrix; {power_cure(_tasks(ran))}."}
    cells = matrix.without(matrix.stale_tasks()).blind_cells()
    tried = {f"{cell.task}/{cell.variation}" for cell in cells}
    missing = sorted(name for name in ran - tried if _requires_action(name))
    blind: dict[str, list[str]] = {}
    for cell in flagged(cells):
        if f"{cell.task}/{cell.variation}" in ran:
            name = f"{cell.task}/{cell.variation} ({cell.rate.k}/{cell.rate.n})"
            blind.setdefault(cell.pretender.rpartition(":")[2], []).append(name)
    said = [f"{probe} solves {listed(names)}" for probe, names in sorted(blind.items())]
    told = []
    if said:
        reason = "more often than by chance, so success on these variations is weaker evidence"
        told.append(f"{'; '.join(said)} {reason}.")
    elif ran & tried or not missing:
        told.append("No variation of this run is solved without images, instruction or aim more often than by chance.")
    if missing:
        told.append(f"Not measured on {_by_task(missing)}; {power_cure(_tasks(missing))}.")
    facts = {"Blind probes": " ".join(told)}
    alone = [name for name in redundant(cells) if name in ran]
    if alone:
        facts["Instructions"] = f"Only one instruction fits the scene of {listed(alone)}, so it is redundant there."
    return facts


def _requires_action(name: str) -> bool:
    """Return whether a condition, given by name ("fast_food/T1"), is a variation that requires an action."""
    task, _, variation = name.partition("/")
    found = [v for v in get_task(task).variations if v.name == variation]
    return bool(found) and found[0].expected is Expected.SUCCEED


def _by_task(names: Sequence[str]) -> str:
    """List variations by task, e.g. "L1, L2 of fast_food and O1 of tidy_desk"."""
    groups: dict[str, list[str]] = {}
    for name in names:
        task, _, variation = name.partition("/")
        groups.setdefault(task, []).append(variation)
    return listed([f"{', '.join(group)} of {task}" for task, group in groups.items()])


def _tasks(names: Iterable[str]) -> set[str]:
    """Return the tasks of conditions that are given by name ("fast_food/T1")."""
    return {name.partition("/")[0] for name in names}


def _certified(trials: set[tuple[str, int]], looks: Sequence[str]) -> str:
    coverage = coverage_of(_tasks(name for name, _ in trials))
    others = [name for name in looks if name != coverage.versions.looks]
    if others:
        return (
            f"The certificate of the suite covers the {coverage.versions.looks} looks, not the {listed(others)} looks."
        )
    if coverage.versions.suite != SUITE_VERSION:
        return f"The certificate of the suite is for suite version {coverage.versions.suite}, not {SUITE_VERSION}."
    seeds = {name: parse_ranges(s.certified) for name, s in coverage.conditions.items()}
    covered = Rate(sum(seed in seeds.get(name, ()) for name, seed in trials), len(trials))
    return (
        f"{rate_text(covered)} of the trials are covered by the certificate of the suite: the expert solved them "
        "with trained motions only, and their scenes are at rest, reachable, and consistent with the premise of the "
        "instruction."
    )
