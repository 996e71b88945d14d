"""Report page: one self-contained HTML file that works offline. The tables are also written to separate files."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from betterbench.diagnosis.verdict import RunDiagnosis, TrialDiagnosis
from betterbench.errors import InvalidInputError
from betterbench.ordinary_file import open_ordinary
from betterbench.quoting import script_json
from betterbench.report.figures.charts import charts_of, twin_figure
from betterbench.report.figures.drawing import Chart, draw, file_style
from betterbench.report.figures.film import ACTS, Film, Frame
from betterbench.report.figures.media import NO_MEDIA, Media
from betterbench.report.headline import RARE_SHARE, WEAK_SHARE, Headline, headline_of
from betterbench.report.html import asset, data_uri, environment, write
from betterbench.report.knowledge import knowledge_view
from betterbench.report.legend import AXIS_NAMES, LEGEND, families_of, modes_of
from betterbench.report.outcomes import is_abroad
from betterbench.report.pages.cell_pictures import ShownFilm, cell_pictures
from betterbench.report.pages.listing import listing_of
from betterbench.report.pages.pretenders import pretender_views, score_tables
from betterbench.report.tables.exports import Export, exports_of
from betterbench.report.tables.matrices import Matrix, matrices_of
from betterbench.report.tables.paper import coffee_table, composition_table, paper_facts
from betterbench.report.task_views import task_views
from betterbench.report.wording import THIN, Figure
from betterbench.statistics.wording import p_text
from betterbench.tasks.labels import Kind
from betterbench.tasks.thresholds import threshold_table
from betterbench.vqa.knowing import Knowledge
from betterbench.wording import listed, plural

STRIP_FRAMES = 3
"""Number of frames in the film strip on the first screen: reach, evidence and outcome, in this order."""


@dataclass(frozen=True, slots=True)
class ReportSetting:
    """Row of the settings table, with one value per policy, or a single value if all policies agree."""

    name: str
    values: tuple[str, ...]

    @property
    def mixed(self) -> bool:
        """Whether the policies differ in this setting."""
        return len(self.values) > 1


_HEAD_BYTES, _TITLE = 10_000, " · BeTTER</title>".encode()


@dataclass(frozen=True, slots=True)
class ShownChart:
    """Chart on the page, in the wide version, the narrow version, and the version for a separate file."""

    chart: Chart
    wide: Markup
    narrow: Markup
    file: str


@dataclass(frozen=True, slots=True)
class Unfinished:
    """Note about a run that is still in progress or was stopped.

    Attributes:
        text: The note as a sentence.
        left: Number of missing trials by condition.
    """

    text: str
    left: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class Opening:
    """Film strip that the first screen of the report shows.

    Attributes:
        shown: The film strip.
        frames: Frames around the evidence.
        twin_frames: Frames of the training twin (the training trial with the same seed) at the corresponding step of
            the task.
        pair: One frame of the trial and one of its training twin, each with a caption.
    """

    shown: ShownFilm
    frames: tuple[Frame, ...]
    twin_frames: tuple[Frame, ...]
    pair: tuple[tuple[Frame, str], ...] = ()


def is_report(out: Path) -> bool:
    """Return whether a folder contains a report: a page with the title of betterbench, and a folder of tables."""
    try:
        with open_ordinary(out / "index.html") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return False
    return head.startswith(b"<!doctype html>") and _TITLE in head and (out / "tables").is_dir()


def write_report(
    diagnoses: Sequence[RunDiagnosis],
    out: Path,
    *,
    films: Mapping[str, Film] | None = None,
    latex: bool = True,
    media: Media = NO_MEDIA,
    machine: Mapping[str, str] | None = None,
    trust: Mapping[str, str] | None = None,
    knowledge: Sequence[Knowledge] = (),
    assets: Sequence[str] = (),
) -> Path:
    """Write the report on one policy, or on several policies side by side. Return the path of ``index.html``.

    The page needs no network and no other file. The tables are also written as ``tables/NAME.csv`` and optionally
    ``tables/NAME.tex``, and the charts as ``figures/NAME.svg``.

    Args:
        diagnoses: Diagnoses of the runs, in the order of the page.
        out: Folder to write to.
        films: Film strips of trials; None for the film strips of ``media``.
        latex: Whether to write the tables as LaTeX too.
        media: Images and run folders.
        machine: Facts about the machine, by name (e.g. "processor").
        trust: Statements about the reliability of the results, by name (e.g. "Calibration").
        knowledge: Answers of models to questions about the same trials.
        assets: Sources and licenses of the objects.

    Raises:
        InvalidInputError: If no diagnosis is given, two diagnoses have the same policy, or a film strip does not belong
            to a trial.
    """
    names = [diagnosis.policy for diagnosis in diagnoses]
    if not diagnoses:
        raise InvalidInputError("diagnoses", "no diagnosis is given", "Pass the diagnosis of at least one run")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        problem = f"policy {twice[0]!r} occurs twice"
        raise InvalidInputError("diagnoses", problem, "Give each diagnosis a different policy name")
    shown = _shown_films(diagnoses, media.films if films is None else films)
    tables = (coffee_table(diagnoses), composition_table(diagnoses))
    exports = exports_of(diagnoses, tables)
    charts = _shown_charts(charts_of([d.even() for d in diagnoses]))
    page = render_page(
        diagnoses, exports, charts, films=shown, media=media, latex=latex, machine=machine, trust=trust,
        knowledge=knowledge, assets=assets,
    )  # fmt: skip
    folder, figures = out / "tables", out / "figures"
    for shown_chart in charts:
        write(figures / f"{shown_chart.chart.name}.svg", shown_chart.file)
    for export in exports:
        write(folder / f"{export.name}.csv", export.csv)
        if latex:
            write(folder / f"{export.name}.tex", export.latex)
    return write(out / "index.html", page)


def render_page(
    diagnoses: Sequence[RunDiagnosis],
    exports: Sequence[Export],
    charts: Sequence[ShownChart],
    *,
    films: Sequence[ShownFilm] = (),
    media: Media = NO_MEDIA,
    latex: bool = True,
    machine: Mapping[str, str] | None = None,
    trust: Mapping[str, str] | None = None,
    knowledge: Sequence[Knowledge] = (),
    assets: Sequence[str] = (),
) -> str:
    """Return the report page as HTML, with links to download the tables.

    ``latex`` is True if the tables also exist as LaTeX files.
    """
    pages = environment()
    pages.filters.update(data_uri=data_uri, p_text=p_text, plural=plural)
    pages.filters.update(group=_grouped, along=_along, unbroken=_unbroken)
    headlines = [headline_of(diagnosis) for diagnosis in diagnoses]
    trials = [trial for diagnosis in diagnoses for trial in diagnosis.trials]
    numbers = {shown.film.key: shown.number for shown in films}
    matrices, unfilled = _matrices(diagnoses)
    return pages.get_template("page.html.jinja").render(
        diagnoses=diagnoses,
        headlines=headlines,
        single=len(diagnoses) == 1,
        title=_title([diagnosis.policy for diagnosis in diagnoses]),
        extent=_extent(trials, len(diagnoses), pending=any(d.pending for d in diagnoses)),
        unfinished=[_unfinished(d, single=len(diagnoses) == 1) for d in diagnoses if d.pending or d.unfinished],
        findings=[(d.policy, d.findings) for d in diagnoses if d.findings],
        paper_tables=[t for t in (coffee_table(diagnoses), composition_table(diagnoses)) if t.measured],
        paper=paper_facts(),
        charts=charts,
        tasks=task_views(diagnoses),
        films=films,
        media=media,
        instructions={(d.policy, t.key): t.instruction for d in diagnoses for t in d.trials},
        opening=_opening(headlines[0], films) if len(diagnoses) == 1 else None,
        openings=[_opening(headline, films) if len(diagnoses) > 1 else None for headline in headlines],
        training=(_training_title(headlines), _training_note(diagnoses, headlines)),
        trust=dict(trust or {}),
        assets=assets,
        knowledge=[knowledge_view(known) for known in knowledge],
        matrices=matrices,
        cell_pictures=cell_pictures(matrices, films, media),
        unfilled=unfilled,
        legend=modes_of(diagnoses),
        labels=LEGEND,
        families=families_of(diagnoses),
        axes=AXIS_NAMES,
        exports=exports,
        latex=latex,
        thresholds=_settings([_thresholds(d) for d in diagnoses]),
        versions=_settings([d.versions for d in diagnoses]),
        warnings=_warnings(diagnoses),
        decided=[(d.policy, note) for d in diagnoses if d.until_decided for note in d.until_decided.notes()],
        machine=dict(machine or {}),
        seeds=_seeds(trials),
        rare=round(100 * RARE_SHARE),
        weak=round(100 * WEAK_SHARE),
        **_style_and_script(),
        **_pretenders(diagnoses),
        data=Markup(script_json(listing_of(diagnoses, numbers, media))),  # noqa: S704 - made safe for a script element
    )


def _pretenders(diagnoses: Sequence[RunDiagnosis]) -> dict[str, object]:
    """Return the comparison of each policy with pretenders and the score tables, as variables of the page's template.

    A pretender is a reference policy that lacks an ability on purpose.
    """
    views = pretender_views([d for d in diagnoses if not is_abroad(d)])
    return {"pretenders": views, "pretender_tables": score_tables(views)}


def _style_and_script() -> dict[str, str]:
    """Return the style sheet and the script of the page, and the script's digest for the content security policy."""
    script = asset("page.js")
    return {
        "style": Markup(asset("page.css") + asset("figure.css")),  # noqa: S704 - our own file
        "script": Markup(script),  # noqa: S704 - our own file
        "script_hash": b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii"),
    }


def _matrices(diagnoses: Sequence[RunDiagnosis]) -> tuple[list[Matrix], list[str]]:
    """Return the diagnostic matrices that have results, short horizon first, and a sentence about each empty matrix.

    Runs in other simulated worlds have no matrices, since the matrices are defined for betterbench's own tasks.
    """
    if all(map(is_abroad, diagnoses)):
        return [], []
    made = [matrices_of(diagnosis) for diagnosis in diagnoses]
    every = (*(short for short, _ in made), *(long for _, long in made))
    empty: dict[str, list[str]] = {}
    for matrix in every:
        if not matrix.measured:
            empty.setdefault(matrix.title, []).append(matrix.policy)
    unfilled = []
    for title, policies in empty.items():
        whose = "" if len(policies) == len(diagnoses) else f" of {listed(policies)}"
        unfilled.append(f"{title}: no trial{whose} belongs to a cell.")
    return [matrix for matrix in every if matrix.measured], unfilled


def _shown_films(diagnoses: Sequence[RunDiagnosis], films: Mapping[str, Film]) -> list[ShownFilm]:
    """Return the film strips that have frames, with their trials. Failures come first."""
    trials = {(d.policy, t.key): t for d in diagnoses for t in d.trials}
    shown: list[ShownFilm] = []
    for film in films.values():
        trial = trials.get((film.policy, film.trial))
        if trial is None:
            problem = f"no trial {film.trial!r} of policy {film.policy!r} in this report"
            raise InvalidInputError("films", problem, "Pass only films of trials that the diagnoses contain")
        if film.frames:
            shown.append(ShownFilm(len(shown), film, trial))
    solved = sorted(shown, key=lambda s: s.trial.kind is Kind.NONE)
    return [ShownFilm(number, s.film, s.trial) for number, s in enumerate(solved)]


def _shown_charts(charts: Sequence[Chart]) -> list[ShownChart]:
    """Draw charts in the wide version, the narrow version, and the version for a separate file."""
    style = file_style(asset("figure.css"), asset("page.css"))
    return [
        ShownChart(
            chart,
            Markup(draw(chart)),  # noqa: S704 - every text in it is escaped by the drawing
            Markup(draw(chart, narrow=True)),  # noqa: S704 - likewise
            draw(chart, style=style),
        )
        for chart in charts
    ]


def _opening(headline: Headline, films: Sequence[ShownFilm]) -> Opening | None:
    """Return the film strip that shows the main failure of a policy. Return None if there is none."""
    failure = headline.failure
    if failure is None:
        return None
    mine = [s for s in films if s.film.policy == headline.policy and s.trial.variation is not None]
    found = [shown for shown in mine if shown.trial.label is failure.label]
    shown = max(found, key=lambda s: bool(s.film.twin_frames), default=None)
    if shown is None:
        return None
    start = shown.trial.evidence.start_s
    acts = [frame.time_s for frame in shown.film.twin_frames if frame.caption in ACTS]
    moments = start, acts[0] if acts else start
    sides = ((shown.film.frames, "this trial"), (shown.film.twin_frames, "its twin"))
    return Opening(
        shown,
        _around(shown.film.frames, moments[0]),
        _around(shown.film.twin_frames, moments[1]),
        tuple(
            (min(frames, key=lambda frame: abs(frame.time_s - time_s)), what)
            for (frames, what), time_s in zip(sides, moments, strict=True)
            if frames
        ),
    )


def _training_title(headlines: Sequence[Headline]) -> str:
    """Return the heading of the success rate in training conditions, which is shown next to the gaps."""
    return "Success in all training trials" if any(h.twins_differ for h in headlines) else "Training success"


def _training_note(diagnoses: Sequence[RunDiagnosis], headlines: Sequence[Headline]) -> str:
    """Explain why the numbers of training trials differ within the report. Return "" if they do not differ."""
    all_of, twins_of = [], []
    for diagnosis, headline in zip(diagnoses, headlines, strict=True):
        twins = twin_figure(diagnosis, "overall")
        if headline.training.missing or twins.missing or twins.n == headline.training.n:
            continue
        whose = "" if len(diagnoses) == 1 else f" of {diagnosis.policy}"
        all_of.append(f"{headline.training.n}{whose}")
        twins_of.append(f"{twins.n}{whose}")
    if not all_of:
        return ""
    return (
        f"It counts every training trial ({listed(all_of)}). Gaps, charts and task tables count only the training "
        f"twins, one per pair ({listed(twins_of)}). A twin differs from its variation only by the variation itself."
    )


def _along(figure: Figure, value: float) -> str:
    """Return the position of a value on the scale that is drawn below a number, as a CSS length such as "62.0%".

    For a difference, the scale goes from -1 to 1.
    """
    low = -1.0 if figure.difference else 0.0
    return f"{100 * (min(max(value, low), 1.0) - low) / (1.0 - low):.1f}%"


def _around(frames: Sequence[Frame], time_s: float) -> tuple[Frame, ...]:
    """Return the frame that is nearest to a time, together with the frames before and after it."""
    times = [abs(frame.time_s - time_s) for frame in frames]
    at = times.index(min(times)) if times else 0
    first = max(0, min(at - STRIP_FRAMES // 2, len(frames) - STRIP_FRAMES))
    return tuple(frames[first : first + STRIP_FRAMES])


def _title(policies: Sequence[str]) -> str:
    """Return the title of the page."""
    if len(policies) == 1:
        return f"Diagnosis of {policies[0]}"
    return f"Diagnosis of {len(policies)} policies"


def _extent(trials: Sequence[TrialDiagnosis], policies: int, *, pending: bool) -> str:
    """Return a sentence with the numbers of trials, tasks and variations."""
    if not trials:
        return "No trial is done yet." if pending else "The plan contains no trials."
    variations = {(t.task, t.variation) for t in trials if t.variation is not None}
    tasks = {t.task for t in trials}
    text = f"{plural(len(trials), 'trial')} on {plural(len(tasks), 'task')} with {plural(len(variations), 'variation')}"
    text = text.replace(str(len(trials)), _grouped(len(trials)), 1)
    return f"{text}{f', {policies} policies' if policies > 1 else ''}; {_seeds(trials)}."


def _unfinished(diagnosis: RunDiagnosis, *, single: bool) -> Unfinished:
    """Return the note about a run that is in progress or was stopped."""
    stopped = [trial.key for trial in diagnosis.unfinished]
    left = Counter(key.rpartition("/")[0] for key in (*diagnosis.pending, *stopped))
    whose = "" if single else f" of {diagnosis.policy}"
    if not diagnosis.pending:
        ended, planned = len(diagnosis.trials) - len(stopped), len(diagnosis.trials)
        text = (
            f"Unfinished: {_grouped(ended)} of {_grouped(planned)} trials{whose} have ended. The other "
            f"{_grouped(len(stopped))} count in the denominator of every rate, but not as failures of any kind, and "
            f"not in pairs. Run the same command again to finish them."
        )
        return Unfinished(text, tuple(sorted(left.items())))
    text = (
        f"Unfinished: {_grouped(len(diagnosis.trials))} of {_grouped(diagnosis.planned)} trials{whose} were done when "
        f"this page was written. The {_grouped(len(diagnosis.pending))} not yet run are not counted."
    )
    return Unfinished(text, tuple(sorted(left.items())))


def _seeds(trials: Sequence[TrialDiagnosis]) -> str:
    """Format the seeds of trials as ranges, e.g. "seeds 0–19"."""
    seeds = sorted({trial.seed for trial in trials})
    if not seeds:
        return "no seeds"
    ranges: list[list[int]] = [[seeds[0], seeds[0]]]
    for seed in seeds[1:]:
        if seed == ranges[-1][1] + 1:
            ranges[-1][1] = seed
        else:
            ranges.append([seed, seed])
    shown = [str(a) if a == b else f"{a}–{b}" for a, b in ranges]
    more = f" and {len(shown) - 6} more ranges" if len(shown) > 6 else ""
    return f"{'seed' if len(seeds) == 1 else 'seeds'} {', '.join(shown[:6])}{more}"


def _settings(values: Sequence[Mapping[str, str]]) -> tuple[ReportSetting, ...]:
    """Return the settings by name. A setting has one value if all runs agree, otherwise one value per run."""
    names = sorted({name for mapping in values for name in mapping})
    settings = []
    for name in names:
        found = tuple("–" if (value := mapping.get(name)) in (None, "None") else str(value) for mapping in values)
        settings.append(ReportSetting(name, found[:1] if len(set(found)) == 1 else found))
    return tuple(settings)


def _thresholds(diagnosis: RunDiagnosis) -> dict[str, str]:
    """Return the thresholds of a diagnosis with their units."""
    units = {entry.name: f" {entry.unit}" for entry in threshold_table() if entry.unit != "1"}
    return {name: f"{value:g}{units.get(name, '')}" for name, value in diagnosis.thresholds.items()}


def _warnings(diagnoses: Sequence[RunDiagnosis]) -> list[str]:
    """Return the reasons why the runs are difficult to compare, one sentence each."""
    warnings = []
    for what, values in (
        ("versions", [d.versions for d in diagnoses]),
        ("thresholds", [_thresholds(d) for d in diagnoses]),
    ):
        mixed = [setting.name for setting in _settings(values) if setting.mixed]
        if mixed:
            warnings.append(
                f"The runs were made with different {what} ({listed(mixed[:6])}). This may be the cause of differences "
                f"between the policies."
            )
    plans = [{(t.task, t.variation or t.condition, t.seed) for t in d.even_trials} for d in diagnoses]
    if any(plan != plans[0] for plan in plans):
        warnings.append(
            "The policies did not run the same trials. Compare them only on conditions with numbers for both."
        )
    return warnings


def _unbroken(text: str) -> str:
    """Insert non-breaking spaces before percent signs and within p-values."""
    return text.replace(" %", f"{THIN}%").replace("p = ", "p\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}")


def _grouped(number: int) -> str:
    """Format a count with a thin space between the thousands, e.g. "1 440"."""
    return f"{number:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")
