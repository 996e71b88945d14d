"""Creation of the report of one or more runs, including videos of trials rendered from the recorded states."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

from betterbench.api.arguments import options_as_arguments
from betterbench.argument_types import checked_arguments
from betterbench.diagnosis import RunDiagnosis, TrialDiagnosis, diagnose_run
from betterbench.errors import InvalidInputError, MissingDependencyError, RecordError, require_between
from betterbench.evaluation import Panel, Shot, render_paths, render_shots, render_twin_films
from betterbench.jobs import OnCount
from betterbench.jobs.outputs import OutputFolder
from betterbench.records import RunFolder, require_each_once, run_names
from betterbench.records.credits import credits_of_runs
from betterbench.report.figures.film import Film, Frame, Showing, failures_in_question, film_key, trials_worth_showing
from betterbench.report.figures.media import Media, Thumbnails
from betterbench.report.headline import headline_of, verdict_line
from betterbench.report.legend import LEGEND
from betterbench.report.outcomes import is_abroad
from betterbench.report.pages.page import is_report
from betterbench.report.pages.page import write_report as write_page
from betterbench.report.pages.trust import trust_of
from betterbench.sim.scenes.limited import LimitedViews
from betterbench.sim.worlds import WorldError, world_named
from betterbench.sim.worlds.world import require_photos
from betterbench.tasks import all_tasks
from betterbench.tasks.user_files import options_for
from betterbench.vqa.knowing import read_knowledge
from betterbench.wording import plural

logger = logging.getLogger(__name__)

THUMBNAIL_PX = 200
"""Width and height of the images on the cards of variations [px]."""

FILMS = 40
"""Default for the maximum number of trials that are shown as films (videos)."""

SOLVED_FILMS = 2
"""Maximum number of films of successful trials per run. A few suffice, because successful trials look alike."""


@contextmanager
def _no_bar(_what: str) -> Iterator[OnCount]:
    yield lambda _done, _planned: None


@dataclass(frozen=True, slots=True)
class ReportListener:
    """Callbacks for messages and progress while a report is built.

    Attributes:
        say: Function that is called with each message, which is one line of text.
        warn: Function that is called with a warning if films cannot be rendered.
        bar: Function that is called with the name of a step and returns a context manager for a progress bar. On entry,
            the context manager returns a function that takes the number of finished items and the total number.
    """

    say: Callable[[str], None] = logger.info
    warn: Callable[[str], None] = logger.warning
    bar: Callable[[str], AbstractContextManager[OnCount]] = _no_bar


class BuiltReport(NamedTuple):
    """Built report: path of the page, and lines of text with the verdict on each run."""

    page: Path
    verdicts: tuple[str, ...]


def build_report(
    runs: Sequence[RunFolder],
    out: Path,
    *,
    names: Sequence[str] = (),
    twins: Sequence[Path] = (),
    latex: bool = True,
    films: int = FILMS,
    listener: ReportListener = ReportListener(),
) -> BuiltReport:
    """Diagnose runs, render their failures and write the report page.

    Args:
        runs: Runs of the report.
        out: Folder of the report.
        names: Name of each run on the page. By default, the name of its policy.
        twins: For runs in LIBERO-PRO, one run folder of the same policy in the original suite (LIBERO) for each run.
            Empty otherwise.
        latex: Whether to also write the tables as LaTeX files.
        films: Maximum total number of trials that are shown as films. With 0, nothing is rendered.
        listener: Callbacks for messages and progress.
    """
    if twins and len(twins) != len(runs):
        problem = f"got {len(twins)} for {plural(len(runs), 'run')}"
        raise InvalidInputError("--twins", problem, "Repeat --twins once for each run, in the order of the runs")
    called = run_names(runs, names)
    say = listener.say
    bases: list[RunFolder | None] = [RunFolder.open(path) for path in twins] or [None] * len(runs)
    diagnoses = []
    for run, base, name in zip(runs, bases, called, strict=True):
        with listener.bar(f"diagnosing {run.path.name}") as told:
            diagnoses.append(diagnose_run(run, twins_in=base, on_progress=told).named(name))
    for run, diagnosis in zip(runs, diagnoses, strict=True):
        if diagnosis.pending:
            say(f"{run.path}: unfinished, {len(diagnosis.trials)} of {diagnosis.planned} trials are done")
    media = Media()
    if films > 0:
        try:
            media = _media(runs, diagnoses, films, listener)
        except (MissingDependencyError, RecordError, WorldError) as error:
            listener.warn(f"no films: {error}")
    # Trials in betterbench's own scenes can be replayed, so the page shows the command for this.
    ours = [(d, run) for d, run in zip(diagnoses, runs, strict=True) if not is_abroad(d)]
    media = replace(media, folders={d.policy: str(run.path) for d, run in ours})
    media = replace(media, options=options_for({t.task for d in diagnoses for t in d.trials}))
    stored = [(read_knowledge(run), name) for run, name in zip(runs, called, strict=True)]
    knowledge = [replace(known, policy=name) for known, name in stored if known is not None]
    page = write_page(
        diagnoses, out, media=media, latex=latex, machine=_machine(runs), trust=trust_of(diagnoses),
        knowledge=knowledge, assets=credits_of_runs(runs),
    )  # fmt: skip
    verdicts = []
    for diagnosis in diagnoses:
        claim = headline_of(diagnosis).claim
        verdicts += [line for line in (verdict_line(diagnosis), claim.deciding, claim.command) if line]
    return BuiltReport(page, tuple(verdicts))


@checked_arguments
def write_report(
    *runs: RunFolder | Path | str,
    out: Path | str | None = None,
    names: Sequence[str] = (),
    twins: Sequence[Path | str] = (),
    latex: bool = True,
    films: int = FILMS,
    overwrite: bool = False,
) -> Path:
    """Write the report of one or more runs, like ``better report``. Return the path of the HTML page.

    The page is self-contained and can be opened without a network connection. The tables are also written as CSV and
    LaTeX files to the same folder.

    Args:
        *runs: Runs, or their folders.
        out: Folder of the report. By default, the folder ``report`` inside the folder of the first run.
        names: Name of each run on the page, in the order of the runs. By default, the names of the policies.
        twins: For runs in LIBERO-PRO, one run of the same policy in the original suite (LIBERO) for each run.
        latex: Whether to also write the tables as LaTeX files.
        films: Maximum total number of trials that are shown as films (videos). Each other failure is shown as one
            image. With 0, nothing is rendered.
        overwrite: Whether to write into a folder that contains other files.

    Raises:
        InvalidInputError: If no run is given, if a number is out of range, or if names or twins do not match the runs.
        RecordError: If a run or a record cannot be read.
        RunConflictError: If the folder contains other files and must not be overwritten.
    """
    require_between("films", films, 0, math.inf)
    folders = [run if isinstance(run, RunFolder) else RunFolder.open(Path(run)) for run in runs]
    with options_as_arguments():
        return report_into(
            folders,
            None if out is None else Path(out),
            names=names,
            twins=[Path(run) for run in twins],
            latex=latex,
            films=films,
            overwrite=overwrite,
        ).page


def report_into(
    runs: Sequence[RunFolder],
    out: Path | None,
    *,
    names: Sequence[str] = (),
    twins: Sequence[Path] = (),
    latex: bool = True,
    films: int = FILMS,
    overwrite: bool = False,
    listener: ReportListener = ReportListener(),
) -> BuiltReport:
    """Build a report in a folder, by default in the folder of the first run (see :func:`build_report`).

    Raises:
        InvalidInputError: If no run is given, or if a run is given twice.
        RunConflictError: If the folder contains other files and must not be overwritten.
    """
    if not runs:
        raise InvalidInputError("runs", "no run was given", "Pass the run folder that better eval has written")
    require_each_once([run.path for run in runs])
    place = runs[0].report_path if out is None else out
    with OutputFolder(place, "report", overwrite=overwrite, is_ours=lambda: is_report(place)):
        return build_report(runs, place, names=names, twins=twins, latex=latex, films=films, listener=listener)


def _choice(diagnosis: RunDiagnosis) -> list[Showing]:
    """Return the trials to show as films, sorted by importance.

    Failures come first, then one trial for each condition of the diagnostic matrices, then a few other successes.
    """
    aside = {t.key for t in diagnosis.trials if t.success or t.ambiguous}
    showings = trials_worth_showing(diagnosis, len(diagnosis.trials), repeats=True)
    failed = [s for s in showings if s.trial not in aside]
    rest = [s for s in showings if s.trial in aside]
    named, cells = _conditions_of_matrices(), dict[str, Showing]()
    for s in rest:
        condition = s.trial.rpartition("/")[0]
        if condition in named:
            cells.setdefault(condition, s)
    others = [s for s in rest if s not in cells.values()]
    return failed + list(cells.values()) + others[:SOLVED_FILMS]


def _conditions_of_matrices() -> frozenset[str]:
    """Return the conditions ("fruit_basket/O6") that appear in the diagnostic matrices of the tasks."""
    return frozenset(
        f"{task.id}/{name}"
        for task in all_tasks()
        for matrix in task.matrices
        for cell in matrix.cells
        for name in cell.conditions
    )


def _media(runs: Sequence[RunFolder], diagnoses: Sequence[RunDiagnosis], films: int, listener: ReportListener) -> Media:
    """Render at most ``films`` films for all runs together, and one image for each other failure.

    The path of the gripper is drawn into these images. Runs in LIBERO and CALVIN get no such images, because their
    camera poses are not recorded.
    """
    say = listener.say
    one_each = zip_longest(*(_choice(diagnosis) for diagnosis in diagnoses))
    chosen = [showing for turn in one_each for showing in turn if showing is not None][:films]
    failed = {d.policy: [] if is_abroad(d) else failures_in_question(d) for d in diagnoses}
    filmed, count = {s.key for s in chosen}, sum(map(len, failed.values()))
    more = sum(film_key(policy, t.key) not in filmed for policy, trials in failed.items() for t in trials)
    if not chosen and not more:
        trials = [trial for diagnosis in diagnoses for trial in diagnosis.trials]
        varied = any(trial.variation is not None for trial in trials)
        recorded = sum(trial.record is not None for trial in trials)
        if varied or not recorded:
            say("No films: no trial of a variation has a record." if varied else "No films: no trial has a record.")
        else:
            say(
                f"No films: only trials of variations are filmed, but the {plural(recorded, 'record')} belong to "
                "training conditions."
            )
        return Media()
    for run, diagnosis in zip(runs, diagnoses, strict=True):
        if is_abroad(diagnosis) and any(s.policy == diagnosis.policy for s in chosen):
            require_photos(world_named(run.world.name))
    rest = f", and the start of {plural(more, 'more failure')} with the path of the gripper" if more else ""
    say(
        f"Rendering {plural(len(chosen), 'film')}{rest}: this takes most of the time of a report. "
        f"{f'--films {count} makes a film of every failure, ' if more else ''}--films 0 renders nothing."
    )
    shown: dict[str, Film] = {}
    paths: dict[str, bytes] = {}
    thumbnails: dict[str, Thumbnails] = {}
    with LimitedViews() as views:
        for run, diagnosis in zip(runs, diagnoses, strict=True):
            mine = [s for s in chosen if s.policy == diagnosis.policy]
            shown |= _films(run, diagnosis, mine, views, listener)
            left = [t for t in failed[diagnosis.policy] if film_key(diagnosis.policy, t.key) not in filmed]
            paths |= _paths(run, diagnosis, left, views, listener)
            thumbnails |= _thumbnails(run, diagnosis, thumbnails, views, listener)
    return Media(shown, paths, thumbnails)


def _films(
    run: RunFolder,
    diagnosis: RunDiagnosis,
    showings: Sequence[Showing],
    views: LimitedViews,
    listener: ReportListener,
) -> dict[str, Film]:
    wanted = list(dict.fromkeys(_shot(key, time) for s in showings for key, time in _moments(s)))
    trials = {t.key: t for t in diagnosis.trials}
    with listener.bar(f"film strips of {diagnosis.policy}") as told:
        images = render_shots(run, wanted, views=views, on_progress=told)
    if is_abroad(diagnosis):
        return {s.key: _film(s, images) for s in showings}
    with listener.bar(f"films of {diagnosis.policy}") as told:
        clips = render_twin_films(
            run,
            [[panel_of(trials[key], heading) for key, heading in _sides(s)] for s in showings],
            views=views,
            on_progress=told,
        )
    return {s.key: replace(_film(s, images), clip=film.clip) for s, film in zip(showings, clips, strict=True)}


def _sides(showing: Showing) -> list[tuple[str, str]]:
    twin = [] if showing.twin is None else [(showing.twin, "training twin")]
    return [(showing.trial, "this trial"), *twin]


def panel_of(trial: TrialDiagnosis, what: str) -> Panel:
    """Return the panel of a film that shows one trial. Its heading is ``what``, followed by the name of the trial.

    A film may show a trial and its training twin, i.e. the training trial with the same seed, in two panels.
    """
    place = trial.variation or trial.condition
    return Panel(trial.task, place, trial.seed, f"{what}, {trial.key}", LEGEND[trial.label].name, trial.success)


def _paths(
    run: RunFolder,
    diagnosis: RunDiagnosis,
    failed: Sequence[TrialDiagnosis],
    views: LimitedViews,
    listener: ReportListener,
) -> dict[str, bytes]:
    """Render the initial state of each failed trial and of its training twin, with the path of the gripper drawn in.

    The training twin is the training trial with the same seed. Return the images by film key.
    """
    if not failed:
        return {}
    recorded = {t.key for t in diagnosis.trials if t.record is not None}
    twins = [t.twin_key for t in failed if t.twin_key in recorded]
    wanted = list(dict.fromkeys([*(t.key for t in failed), *twins]))
    places = {key: _shot(key, 0.0) for key in wanted}
    with listener.bar(f"paths of {diagnosis.policy}") as told:
        images = render_paths(
            run,
            [(s.task, s.condition, s.seed) for s in places.values()],
            views=views,
            on_progress=told,
        )
    return {film_key(diagnosis.policy, key): images[s.task, s.condition, s.seed] for key, s in places.items()}


def _thumbnails(
    run: RunFolder,
    diagnosis: RunDiagnosis,
    made: Mapping[str, Thumbnails],
    views: LimitedViews,
    listener: ReportListener,
) -> dict[str, Thumbnails]:
    """Render thumbnails of each variation that is not in ``made``: one trial, and the training trial with its seed."""
    recorded = {t.key for t in diagnosis.trials if t.record is not None}
    chosen: dict[str, TrialDiagnosis] = {}
    for trial in diagnosis.trials:
        name = f"{trial.task}/{trial.variation}"
        if trial.variation is None or trial.record is None or name in made:
            continue
        if name not in chosen or (trial.twin_key in recorded and chosen[name].twin_key not in recorded):
            chosen[name] = trial
    twins = [t.twin_key for t in chosen.values() if t.twin_key in recorded]
    wanted = [_shot(key, 0.0) for key in dict.fromkeys([*(t.key for t in chosen.values()), *twins])]
    with listener.bar("scenes of the variations") as told:
        images = render_shots(run, wanted, size=THUMBNAIL_PX, views=views, on_progress=told)
    by_key = {f"{shot.task}/{shot.condition}/{shot.seed}": image for shot, image in images.items()}
    return {name: Thumbnails(by_key[t.key], by_key.get(t.twin_key or "")) for name, t in chosen.items()}


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
