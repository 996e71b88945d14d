"""Static evaluations of vision-language models as text."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

from betterbench.cli.console import OUT, print_item, print_table
from betterbench.statistics import round_half_up
from betterbench.vlm.benchmarks import Benchmark, find_benchmark
from betterbench.vlm.running import StaticRun
from betterbench.vlm.scoring import COLUMNS, Part

if TYPE_CHECKING:
    from betterbench.vlm.fetching import FetchedFile
    from betterbench.vlm.probe import Finding
    from betterbench.vlm.steps import Cell, StepTable

MOST_GROUPS = 12
"""Kinds with more groups (such as scenarios) are left to result.json."""


def print_run(benchmark: Benchmark, run: StaticRun) -> None:
    """Print the scores of a run, the numbers of upstream programs, and what limits the comparison."""
    score, columns = run.score, COLUMNS if run.extracted is not None else COLUMNS[:2]
    shown = [p for p in score.parts if sum(q.kind == p.kind for q in score.parts) <= MOST_GROUPS]
    with_chance = any("chance" in p.reference for p in shown)
    rows = [_row(part, columns, with_chance=with_chance) for part in shown]
    heads = [benchmark.title, "n", "unread", *(["chance"] if with_chance else []), *columns, "95 % interval"]
    print_table(heads, rows, title=f"{run.head['model']}, prompt {run.head['prompt']}, scores in percent")
    for line in _lines(benchmark, run):
        print_item(line)
    if run.upstream:
        _print_upstream(run)


def print_steps(table: StepTable) -> None:
    """Print the numbers of each row, and the steps between neighboring rows."""
    heads = {name: find_benchmark(name).title for name in table.benchmarks}
    rows = [
        [row.name, *(_cell(row.cells.get(name)) for name in table.benchmarks)] for row in table.rows
    ]  # fmt: skip
    print_table(["", *(f"{title} %" for title in heads.values())], rows, title=f"Scores, {table.column}")
    for step in table.steps:
        print_item(step.sentence)
    if table.steps:
        print_item(
            f"Intervals of 95 % are paired and keep items of one image or video together. A step is supported if its "
            f"paired test is below {table.alpha:g} after Holm's correction over all {len(table.steps)} steps."
        )
    for line in table.warnings:
        print_item(line)


def _cell(cell: Cell | None) -> str:
    return "–" if cell is None else f"{percent_of(Fraction(cell.value).limit_denominator(10**9))}"


def print_probe(finding: Finding) -> None:
    """Print how well each order and scale explains a model's answers, and the convention."""
    rows = [
        [fit.scale, fit.order.replace("xy", "x, y").replace("yx", "y, x"), f"{fit.fitting}/{finding.readable}",
         "–" if finding.readable == 0 else f"{100 * fit.error:.0f} %"]
        for fit in finding.fits
    ]  # fmt: skip
    print_table(["scale", "order", "answers that fit", "median error"], rows, title=f"Coordinates of {finding.model}")
    print_item(finding.sentence)


def _row(part: Part, columns: Sequence[str], *, with_chance: bool) -> list[str]:
    name = part.name if part.kind == "all" else f"{part.kind}: {part.name}"
    chance = [f"{part.reference['chance']:.1f}" if "chance" in part.reference else "–"] if with_chance else []
    means = [percent_of(part.means[column].mean) for column in columns]
    last = part.means[columns[-1]]
    interval = f"{percent_of(Fraction(last.low), 1)}–{percent_of(Fraction(last.high), 1)}"
    return [name, str(part.n), str(part.n - part.read), *chance, *means, interval]


def _lines(benchmark: Benchmark, run: StaticRun) -> list[str]:
    score = run.score
    column = "parsed" if run.extracted is None else "extracted"
    lines = [f"{benchmark.title}: {percent_of(score.headline[column])} % ({score.rule})."]
    macro = [f"{kind} {percent_of(means[column])} %" for kind, means in score.macro.items()]
    lines.append(f"Macro means: {', '.join(macro)}.")
    if run.completeness.sentence:
        lines.append(run.completeness.sentence)
    everything = score.all
    if everything.answered < everything.n:
        rest = (
            ""
            if everything.if_dropped is None
            else (f" A program that drops them would print {percent_of(everything.if_dropped)} %.")
        )
        lines.append(f"{everything.n - everything.answered} of {everything.n} items have no answer and count 0.{rest}")
    if run.refused:
        lines.append(f"The server rejected {run.refused} requests; {run.path / 'answers.jsonl'} has the reasons.")
    lines += run.requests.sentences()
    if run.prices is not None:
        lines.append(run.requests.cost_sentence(run.prices))
    if run.extractor_requests is not None:
        lines += run.extractor_requests.sentences("extractor")
    if run.extracted is not None:
        share = percent_of(Fraction(score.changed, everything.n), 1)
        lines.append(f"The extractor changed {score.changed} of {everything.n} scores ({share} %).")
    if score.outside:
        lines.append(
            f"{score.outside} answers have a place outside the image in the declared convention "
            f"({run.head['coordinates']}). Check --coordinates."
        )
    return lines


def _print_upstream(run: StaticRun) -> None:
    with_notes = any(found.note for found in run.upstream)
    rows = [
        [
            found.name,
            "–" if found.value is None else percent_of(found.value),
            "–" if found.moved is None else signed_percent_of(found.moved),
            f"{found.scored}/{found.total}",
            str(found.differs),
            *([found.note] if with_notes else []),
        ]
        for found in run.upstream
    ]
    OUT.print()
    print_table(
        ["upstream scorer", "score", "− ours", "scored", "differs", *(["note"] if with_notes else [])],
        rows,
        title="Upstream scorers, same texts",
    )


def percent_of(value: Fraction | None, digits: int = 2) -> str:
    """Return a fraction in percent, rounded half up, or a dash."""
    return "–" if value is None else str(round_half_up(100 * value, digits))


def signed_percent_of(value: Fraction) -> str:
    """Return a difference of fractions in percentage points with its sign."""
    return f"{'+' if value >= 0 else ''}{percent_of(value)}"


def print_source(benchmark: Benchmark, fetched: Sequence[FetchedFile] = ()) -> None:
    """Print what data a benchmark needs, where it comes from, and its terms."""
    source = benchmark.source
    rows = [
        [f.path, "unknown" if f.megabytes is None else f"{f.megabytes:g}", f.sha256 or "not published"]
        for f in source.files
    ]
    print_table(["file", "MB", "SHA-256"], rows, title=f"{benchmark.title}: {source.repository} on the hub")
    for file in fetched:
        print_item(f"{file.path}: {file.size / 1e6:.1f} MB, SHA-256 {file.sha256}")
    print_item(f"License: {source.license}. {source.terms}")
    for layout in source.layout:
        print_item(f"Form of the data: {layout}.")
