"""The report of runs with its film strips, which are rendered from the records."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from betterbench.cli.console import ERR, progress_bar, say
from betterbench.diagnosis import RunDiagnosis, diagnose_run
from betterbench.errors import MissingDependencyError
from betterbench.evaluation import Shot, render_shots
from betterbench.recording import RunFolder, run_names
from betterbench.report.film import Film, Frame, Showing, trials_worth_showing
from betterbench.report.headline import verdict_line
from betterbench.report.page import write_report
from betterbench.report.trust import trust_of

SOLVED_FILMS = 2
"""Largest number of solved trials per run that are shown as film strips: they look much alike."""


class BuiltReport(NamedTuple):
    """The page of a report, and the verdict on each of its runs in one line."""

    page: Path
    verdicts: tuple[str, ...]


def build_report(
    runs: Sequence[RunFolder], out: Path, *, names: Sequence[str] = (), latex: bool, films: int
) -> BuiltReport:
    """Diagnose runs, render the moments that show their failures, and return the page with the verdicts.

    The ``films`` trials that are shown as film strips, at most, are shared by the runs.
    """
    called = run_names(runs, names)
    diagnoses = [diagnose_run(run).named(name) for run, name in zip(runs, called, strict=True)]
    for run, diagnosis in zip(runs, diagnoses, strict=True):
        if diagnosis.pending:
            say(f"{run.path}: still going, {len(diagnosis.trials)} of {diagnosis.planned} trials are done")
    shown: dict[str, Film] = {}
    share = films // max(1, len(runs))
    try:
        for run, diagnosis in zip(runs, diagnoses, strict=True):
            shown |= _films(run, _choice(diagnosis, share))
    except MissingDependencyError as error:
        say(f"no film strips: {error}")
    page = write_report(diagnoses, out, films=shown, latex=latex, machine=_machine(runs), trust=trust_of(diagnoses))
    return BuiltReport(page, tuple(verdict_line(diagnosis) for diagnosis in diagnoses))


def print_verdicts(verdicts: Sequence[str]) -> None:
    """Print verdicts as the last lines of the terminal, on standard error."""
    for verdict in verdicts:
        ERR.print(verdict, markup=False, style="bold", soft_wrap=True)


def _choice(diagnosis: RunDiagnosis, limit: int) -> list[Showing]:
    """Return the trials to film: failures, and a few solved ones for comparison."""
    solved = {t.key for t in diagnosis.trials if t.success}
    showings = trials_worth_showing(diagnosis, len(diagnosis.trials))
    failed = [s for s in showings if s.trial not in solved]
    return (failed + [s for s in showings if s.trial in solved][:SOLVED_FILMS])[:limit]


def _films(run: RunFolder, showings: Sequence[Showing]) -> dict[str, Film]:
    wanted = list(dict.fromkeys(_shot(key, time) for s in showings for key, time in _moments(s)))
    with progress_bar("film strips", len(wanted)) as (bar, task):
        images = render_shots(run, wanted, on_progress=lambda done, _: bar.update(task, completed=done))
    return {s.key: _film(s, images) for s in showings}


def _moments(showing: Showing) -> list[tuple[str, float]]:
    twin = [] if showing.twin is None else [(showing.twin, t) for t in showing.twin_times_s]
    return [(showing.trial, t) for t in showing.times_s] + twin


def _shot(key: str, time_s: float) -> Shot:
    task, condition, seed = key.split("/")
    return Shot(task, condition, int(seed), time_s)


def _film(showing: Showing, images: dict[Shot, bytes]) -> Film:
    def frames(key: str, times: Sequence[float], captions: Sequence[str]) -> tuple[Frame, ...]:
        return tuple(Frame(t, images[_shot(key, t)], c) for t, c in zip(times, captions, strict=True))

    twin = () if showing.twin is None else frames(showing.twin, showing.twin_times_s, showing.twin_captions)
    return Film(
        showing.policy,
        showing.trial,
        frames(showing.trial, showing.times_s, showing.captions),
        showing.twin,
        twin,
        showing.evidence_s,
    )


def _machine(runs: Sequence[RunFolder]) -> dict[str, str]:
    context = runs[0].context
    shown = {name: str(context[name]) for name in ("platform", "processors", "python") if name in context}
    machine, renderer = context.get("machine"), context.get("renderer")
    if isinstance(machine, dict):
        shown["cpu"] = str(machine.get("cpu", "unknown"))
        cards = machine.get("graphics_cards")
        shown["graphics cards"] = ", ".join(map(str, cards)) if isinstance(cards, list) and cards else "none"
    if isinstance(renderer, dict) and "renderer" in renderer:
        shown["renderer"] = str(renderer["renderer"])
    return shown
