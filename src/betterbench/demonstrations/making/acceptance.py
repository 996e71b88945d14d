"""Acceptance rate of demonstration attempts by task, source and region, together with the reasons for rejection."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from betterbench.demonstrations.making.attempt import AttemptNote
from betterbench.demonstrations.making.failure import FAILURES
from betterbench.demonstrations.making.production import Method, StartOutcome, attempts_of, method_of, set_hash
from betterbench.demonstrations.making.starts import FactorCoverage, coverage_of, levels_of
from betterbench.demonstrations.making.variety import TaskVariety, variety_lines, variety_of_run
from betterbench.jobs import OnCount, write_durably
from betterbench.quoting import json_text, markdown_address, markdown_text
from betterbench.records import RunFolder
from betterbench.tasks import Task, TrialId

FOLDER = "acceptance"
"""Folder in a run for the acceptance report and its videos."""


@dataclass(frozen=True, slots=True)
class Tally:
    """Number of attempts, and number of attempts that were accepted as demonstrations."""

    accepted: int
    attempts: int

    @property
    def rate(self) -> float | None:
        """Fraction of the attempts that were accepted; None if there are no attempts."""
        return round(self.accepted / self.attempts, 4) if self.attempts else None

    def __str__(self) -> str:
        """Return the counts and the percentage as text, e.g. "3/4 (75 %)"."""
        rate = self.rate
        return "–" if rate is None else f"{self.accepted}/{self.attempts} ({100.0 * rate:.0f} %)"


@dataclass(frozen=True, slots=True)
class ConditionCoverage:
    """Coverage of the possible initial states of a training condition by its accepted demonstrations."""

    condition: str
    demonstrations: int
    factors: tuple[FactorCoverage, ...]

    @property
    def filled(self) -> float:
        """Number of covered factor levels, divided by the maximum number that could be covered.

        A level is covered if it has a demonstration.
        """
        return round(sum(f.filled for f in self.factors) / len(self.factors), 4) if self.factors else 1.0


@dataclass(frozen=True, slots=True)
class TaskAcceptance:
    """Outcomes of the attempts at a task.

    Attributes:
        attempts: All attempts.
        starts: Number of initial states, and number of initial states with a demonstration.
        steps: Total number of control steps in the accepted demonstrations.
        sources: Attempts by primary source demonstration.
        regions: Attempts by the initial position of an object. Each slot (an area in which an object is placed at
            random) is divided into nine cells. The cells of the slot "first" are named "slot first 0" to "slot first
            8".
        failures: Number of failed attempts by kind of failure.
        examples: First failed attempt of each kind of failure, as (trial, index of the attempt, reason).
        coverage: Coverage of the initial states, by training condition.
    """

    task: str
    attempts: Tally
    starts: Tally
    steps: int
    sources: Mapping[str, Tally]
    regions: Mapping[str, Tally]
    failures: Mapping[str, int]
    examples: Mapping[str, tuple[TrialId, int, str]]
    coverage: tuple[ConditionCoverage, ...]


@dataclass(frozen=True, slots=True)
class Acceptance:
    """Outcomes of all attempts in a run, computed from its records. Run times are not included.

    Attributes:
        policy: Name of the demonstrator in the records.
        sha256: Hash of the demonstration set.
        demonstrations: Number of demonstrations.
        tasks: Outcomes by task.
        variety: Differences between the demonstrations of each task; empty if no condition has two demonstrations.
        sources: Differences between the source demonstrations of an amplified set; empty if their folder is missing.
    """

    policy: str
    sha256: str
    demonstrations: int
    tasks: tuple[TaskAcceptance, ...]
    variety: tuple[TaskVariety, ...] = ()
    sources: tuple[TaskVariety, ...] = ()

    @property
    def mean_rate(self) -> float | None:
        """Fraction of accepted attempts, averaged over the tasks; None if there are no attempts."""
        rates = [t.attempts.rate for t in self.tasks if t.attempts.rate is not None]
        return round(sum(rates) / len(rates), 4) if rates else None

    def to_json(self) -> dict[str, Any]:
        """Return the outcomes as a JSON-serializable dict."""
        form = asdict(self)
        form["mean_rate"] = self.mean_rate
        for task, own in zip(form["tasks"], self.tasks, strict=True):
            task["examples"] = {k: [str(trial), number, text] for k, (trial, number, text) in own.examples.items()}
        return form


def acceptance_of(run: RunFolder, *, on_progress: OnCount | None = None) -> Acceptance:
    """Return the outcomes of the attempts in a run of demonstrations, and the differences between the demonstrations.

    Args:
        run: Folder of the run.
        on_progress: Called with the number of records read so far and the total number.

    Raises:
        RecordError: If a journal or a record is corrupt.
    """
    outcomes = attempts_of(run.path)
    done = sum(entry.status == "done" for entry in run.entries())
    names = sorted({trial.task for trial in outcomes})
    method = method_of(run)
    tasks = tuple(
        _of_task(method.task(name), [o for t, o in sorted(outcomes.items()) if t.task == name]) for name in names
    )
    variety = variety_of_run(run, on_progress=on_progress)
    return Acceptance(str(run.plan["policy"]), set_hash(run), done, tasks, variety, _of_sources(method, names))


def _of_sources(method: Method, tasks: Sequence[str]) -> tuple[TaskVariety, ...]:
    """Return the differences between the source demonstrations of a run, or () if they are missing or have changed."""
    folder = Path(method.sources)
    if not method.sources or not (folder / "run.json").exists():
        return ()
    run = RunFolder.open(folder)
    return variety_of_run(run, tasks) if set_hash(run, method.source_tasks) == method.sources_hash else ()


def _of_task(task: Task, outcomes: Sequence[StartOutcome]) -> TaskAcceptance:
    notes = [(outcome, note) for outcome in outcomes for note in outcome.notes]
    failures = Counter(note.failure for _, note in notes if not note.accepted)
    examples: dict[str, tuple[TrialId, int, str]] = {}
    for outcome, note in notes:
        if not note.accepted:
            examples.setdefault(note.failure, (outcome.trial, note.number, note.reason))
    regions: dict[str, list[AttemptNote]] = {}
    for outcome, note in notes:
        levels = levels_of(task, task.train(outcome.condition), outcome.seed)
        for factor, level in levels.items():
            if factor.startswith("slot "):
                regions.setdefault(f"{factor} {level}", []).append(note)
    sources: dict[str, list[AttemptNote]] = {}
    for _, note in notes:
        if note.lead:
            sources.setdefault(note.lead, []).append(note)
    coverage = []
    for condition in task.training:
        seeds = [o.seed for o in outcomes if o.condition == condition.name and o.accepted]
        coverage.append(ConditionCoverage(condition.name, len(seeds), coverage_of(task, condition, seeds)))
    return TaskAcceptance(
        task=task.id,
        attempts=_tally(note for _, note in notes),
        starts=Tally(sum(o.accepted for o in outcomes), len(outcomes)),
        steps=sum(note.steps for _, note in notes if note.accepted),
        sources={source: _tally(found) for source, found in sorted(sources.items())},
        regions={region: _tally(found) for region, found in sorted(regions.items())},
        failures=dict(sorted(failures.items())),
        examples=dict(sorted(examples.items())),
        coverage=tuple(coverage),
    )


def _tally(notes: Iterable[AttemptNote]) -> Tally:
    found = list(notes)
    return Tally(sum(note.accepted for note in found), len(found))


def write_acceptance(
    run: RunFolder, found: Acceptance, films: Mapping[tuple[str, str], str], pictures: Mapping[str, str]
) -> Path:
    """Write ``acceptance.json`` and ``index.md`` into the run, and return the path of ``index.md``.

    Args:
        run: Folder of the run.
        found: Outcomes of the run's attempts.
        films: For each task and kind of failure, the path of a video relative to ``index.md``, or the reason why there
            is none.
        pictures: For each task, the path of a picture of the tool paths relative to ``index.md``, or the reason why
            there is none.
    """
    folder = run.inside(FOLDER)
    text = json_text(found.to_json(), indent=1) + "\n"
    write_durably(folder / "acceptance.json", text.encode())
    write_durably(folder / "index.md", page_of(found, films, pictures).encode())
    return folder / "index.md"


def page_of(found: Acceptance, films: Mapping[tuple[str, str], str], pictures: Mapping[str, str]) -> str:
    """Return the acceptance report of a demonstration run as Markdown.

    Args:
        found: Outcomes of the run's attempts.
        films: For each task and kind of failure, the path of a video relative to the report, or the reason why there is
            none.
        pictures: For each task, the path of a picture of the tool paths relative to the report, or the reason why there
            is none.
    """
    mean = "none yet" if found.mean_rate is None else f"{100.0 * found.mean_rate:.1f} %"
    lines = [
        f"# Acceptance of {markdown_text(found.policy)}",
        "",
        f"Demonstrations: {found.demonstrations}. Accepted share of attempts, mean over tasks: {mean}.",
        "",
        f"Hash of the set: `{found.sha256}`",
        "",
        "| task | attempts accepted | starts solved | mean steps | levels covered |",
        "|---|---|---|---|---|",
    ]
    for t in found.tasks:
        steps = t.steps / t.attempts.accepted if t.attempts.accepted else 0.0
        covered = sum(c.filled for c in t.coverage) / len(t.coverage)
        lines.append(f"| {markdown_text(t.task)} | {t.attempts} | {t.starts} | {steps:.0f} | {100.0 * covered:.0f} % |")
    said = "Levels covered: share of the levels with a demonstration, relative to the number that the set can reach."
    lines += ["", said, "", *variety_lines(found.variety, found.sources)]
    for t in found.tasks:
        lines += ["", f"## {markdown_text(t.task)}", "", *_picture_lines(t, pictures), *_failure_lines(t, films)]
        lines += [*_coverage_lines(t), *_source_lines(t)]
    return "\n".join(lines) + "\n"


def _picture_lines(t: TaskAcceptance, pictures: Mapping[str, str]) -> list[str]:
    file = pictures.get(t.task, "none: not requested")
    if not file.endswith(".jpg"):
        return [f"No picture of the paths ({markdown_text(file.removeprefix('none: '))})", ""]
    said = "Paths of the tool, one color per primary source; a ring marks where the gripper begins to close."
    return [f"![Paths of {markdown_text(t.task)}]({markdown_address(file)})", "", said, ""]


def _failure_lines(t: TaskAcceptance, films: Mapping[tuple[str, str], str]) -> list[str]:
    if not t.failures:
        return ["No attempt failed.", ""]
    lines = ["| failure | attempts | what it means | first example | film |", "|---|---|---|---|---|"]
    for kind, count in sorted(t.failures.items(), key=lambda item: (-item[1], item[0])):
        trial, number, reason = t.examples[kind]
        example = markdown_text(f"{trial}, attempt {number + 1}: {reason}")
        film = films.get((t.task, kind), "not rendered")
        shown = f"[film]({markdown_address(film)})" if film.endswith(".mp4") else markdown_text(film)
        meaning = FAILURES.get(kind, "")  # type: ignore[call-overload] # a journal may hold kinds of other versions
        lines.append(f"| {markdown_text(kind)} | {count} | {meaning} | {example} | {shown} |")
    return [*lines, ""]


def _coverage_lines(t: TaskAcceptance) -> list[str]:
    """Return a Markdown table with the number of demonstrations at each level of each random factor, by condition.

    If any attempt was rejected, a line below the table names the region with the lowest acceptance rate.
    """
    lines = ["| condition | factor | demonstrations per level | rarest level against the mean |", "|---|---|---|---|"]
    for c in t.coverage:
        for f in c.factors:
            names = f"{markdown_text(c.condition)} | {markdown_text(f.factor)}"
            lines.append(f"| {names} | {' '.join(map(str, f.counts))} | {f.evenness:.2f} |")
    if t.regions and t.attempts.accepted < t.attempts.attempts:
        low = min(t.regions, key=lambda r: (t.regions[r].rate or 0.0, r))
        lines += ["", f"Lowest acceptance of a region: {markdown_text(low)} with {t.regions[low]}."]
    return [*lines, ""]


def _source_lines(t: TaskAcceptance) -> list[str]:
    if not t.sources:
        return []
    lines = ["| leading source | attempts accepted |", "|---|---|"]
    return [*lines, *(f"| {markdown_text(source)} | {tally} |" for source, tally in t.sources.items()), ""]
