"""Functions that print static evaluations of vision-language models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from betterbench.cli.console import OUT, print_item, print_table
from betterbench.cli.output.vqa import difference_in_points
from betterbench.errors import one_line
from betterbench.statistics import round_half_up
from betterbench.vlm.benchmarks import Benchmark, find_benchmark
from betterbench.vlm.eyesight import eyesight_sentence
from betterbench.vlm.items import AXIS
from betterbench.vlm.running import StaticRun
from betterbench.vlm.scoring import COLUMNS, Part

if TYPE_CHECKING:
    from betterbench.diagnosis import Metric, RunDiagnosis
    from betterbench.vlm.eyesight import EyesightComparison
    from betterbench.vlm.fetching import FetchedFile
    from betterbench.vlm.prediction import PredictionTable
    from betterbench.vlm.probe import Finding
    from betterbench.vlm.static_gap import StaticGap, StaticGaps
    from betterbench.vlm.steps import Cell, StepTable

MOST_GROUPS = 12
"""Maximum number of groups to print. Groupings with more groups (such as by scenario) are only in result.json."""


def print_run(benchmark: Benchmark, run: StaticRun, acted: RunDiagnosis | None = None) -> None:
    """Print the scores of a run, the scores computed by upstream programs, and caveats for comparing them.

    Args:
        benchmark: Benchmark that was run.
        run: Answers and scores of the model.
        acted: Diagnosis of a policy's run. The policy's illusion gap in simulation is shown next to the model's static
            gap, which is measured with questions about images.
    """
    score, columns = run.score, COLUMNS if run.extracted is not None else COLUMNS[:2]
    # The table of gaps already lists the axes.
    left_out = {AXIS} if score.gaps is not None else set()
    shown = [
        p for p in score.parts if p.kind not in left_out and sum(q.kind == p.kind for q in score.parts) <= MOST_GROUPS
    ]
    with_chance = any("chance" in p.reference for p in shown)
    rows = [_row(part, columns, with_chance=with_chance) for part in shown]
    heads = [benchmark.title, "n", "unread", *(["chance"] if with_chance else []), *columns, "95 % interval"]
    print_table(heads, rows, title=f"{run.head['model']}, prompt {run.head['prompt']}, scores in percent")
    for line in _lines(benchmark, run):
        print_item(line)
    if score.gaps is not None:
        _print_gaps(score.gaps, columns[-1], acted)
    if run.upstream:
        _print_upstream(run)


def print_steps(table: StepTable) -> None:
    """Print the scores of several runs, and the steps (changes of the scores) from each run to the next."""
    heads = {name: find_benchmark(name).title for name in table.benchmarks}
    rows = [
        [row.name, *(_cell(row.cells.get(name)) for name in table.benchmarks)] for row in table.rows
    ]  # fmt: skip
    print_table(["", *(f"{title} %" for title in heads.values())], rows, title=f"Scores, {table.column}")
    for name, title in heads.items():
        _print_parts(table, name, title)
    for step in table.steps:
        print_item(step.sentence)
    if table.steps:
        correction = f" after Holm's correction over all {len(table.steps)} steps" if len(table.steps) > 1 else ""
        print_item(
            f"The 95 % intervals are paired and keep all items of an image or video together. A step is supported if "
            f"the p-value of its paired test is below {table.alpha:g}{correction}."
        )
    for line in table.warnings:
        print_item(line)
    _print_groups(table)
    for compared in table.eyesight:
        _print_eyesight(compared)


def _print_parts(table: StepTable, benchmark: str, title: str) -> None:
    """Print a benchmark's scores for its parts in Table 3 of the BeTTER paper, such as EgoPlan-Bench2's domains."""
    cells = {row.name: row.cells[benchmark] for row in table.rows if benchmark in row.cells}
    names = list(dict.fromkeys(part for cell in cells.values() for part in cell.parts))
    if names:
        rows = [[name, *(_percent(cell.parts.get(p)) for p in names), _cell(cell)] for name, cell in cells.items()]
        print_table(["", *(f"{name} %" for name in names), "all %"], rows, title=title)


def _print_groups(table: StepTable) -> None:
    """Print the groups of questions for which the score changed significantly from one run to the next."""
    if not table.groups:
        return
    moved = [group for group in table.groups if group.is_supported and not group.explained_by]
    rows = [
        [
            f"{group.lower} − {group.upper}",
            f"{group.kind}: {group.name}",
            str(group.n),
            f"{-100 * (group.difference.value or 0.0):+.1f}",
            f"{-group.difference.high_pp:+.1f} to {-group.difference.low_pp:+.1f}",
        ]
        for group in moved
    ]
    if moved:
        print_table(["step", "group", "n", "points", "95 % interval"], rows, title="Groups that a step changed")
    kinds = ", ".join(dict.fromkeys(group.kind for group in table.groups))
    number = f"{len(moved)} of {len(table.groups)}" if moved else f"none of {len(table.groups)}"
    print_item(
        f"A supported change was found in {number} groups of questions ({kinds}). The paired tests use Holm's "
        f"correction over all groups of a kind. A group is omitted if smaller groups explain its change."
    )


def _print_eyesight(compared: EyesightComparison) -> None:
    """Print the smallest object size at which a model answers correctly, for each image resolution.

    If this size cannot be inferred, the reason is printed.
    """
    rows = []
    for eyes, alone in compared.alone.items():
        loss = None if compared.one.value is None else compared.one.further.get(eyes)
        size = "–" if alone.value is None else f"{alone.value:.1f} ({alone.low:.1f} to {alone.high:.1f})"
        more = "–" if loss is None else f"{-100 * loss.value:+.1f} ({-100 * loss.high:+.1f} to {-100 * loss.low:+.1f})"
        rows.append([eyes, str(alone.n), f"{100 * compared.scores[eyes]:.1f}", size, more])
    heads = ["eyes", "n", "score %", "reads from px", "beyond the sizes"]
    print_table(heads, rows, title=f"Eyesight of {compared.name}, {compared.benchmark}")
    for eyes, alone in compared.alone.items():
        if alone.value is None:
            print_item(f"{eyes}: the size cannot be inferred, because {alone.reason}.")
    print_item(compared.sentence)


def print_prediction(table: PredictionTable) -> None:
    """Print the static score and the illusion gap of each policy, and whether static scores predict illusion gaps."""
    rows = [
        [
            policy.name,
            f"{100 * policy.score:.1f}",
            "–" if policy.static_gap is None else f"{100 * policy.static_gap:+.0f}",
            "–" if policy.training is None else f"{100 * policy.training:.0f}",
            "–" if policy.variation is None else f"{100 * policy.variation:.0f}",
            f"{100 * policy.gap:+.0f} ({100 * policy.low:+.0f} to {100 * policy.high:+.0f})",
            str(policy.pairs),
        ]
        for policy in table.policies
    ]
    heads = ["policy", "static %", "static gap", "twins %", "varied %", "illusion gap", "pairs"]
    print_table(heads, rows, title=f"{table.benchmark}, {table.column}: static score and illusion gap")
    for found in table.predictions:
        print_item(found.sentence)
    for line in table.warnings:
        print_item(line)


def _cell(cell: Cell | None) -> str:
    return _percent(None if cell is None else cell.value)


def _percent(value: float | None) -> str:
    return percent_of(None if value is None else Fraction(value).limit_denominator(10**9))


def print_probe(finding: Finding) -> None:
    """Print the error of each order and scale of coordinates for a model's answers, and the inferred convention."""
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
    if run.eyesight is not None:
        lines.append(eyesight_sentence(run.eyesight))
    everything = score.all
    if everything.answered < everything.n:
        rest = (
            ""
            if everything.if_dropped is None
            else (f" A program that drops them would print {percent_of(everything.if_dropped)} %.")
        )
        lines.append(f"{everything.n - everything.answered} of {everything.n} items have no answer and count 0.{rest}")
    if run.refused:
        requests = "1 request" if run.refused == 1 else f"{run.refused:,} requests"
        reason = f"most often with: {one_line(run.refusal, most=160)}"
        lines.append(
            f"The server rejected {requests}, {reason} ({run.path / 'answers.jsonl'} has all reasons). "
            f"To send them again, choose another --out; the other answers come from the cache."
        )
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
            f"{score.outside} answers contain a point outside the image in the declared convention "
            f"({run.head['coordinates']}). Check --coordinates."
        )
    return lines


def _print_gaps(gaps: StaticGaps, column: str, acted: RunDiagnosis | None) -> None:
    """Print a model's static illusion gaps (measured with questions about images) by axis and by type.

    If the run of a policy is given, the illusion gaps of the policy are printed next to them.
    """
    shown = [gap for gap in gaps.by_column[column] if gap.kind != "axis and type"]
    policy = {} if acted is None else acted_gaps(acted)
    heads = ["gap of", "pairs", "train", "varied", "static gap", "p", *(["acted gap"] if policy else [])]
    rows = [
        [
            gap.name.replace("_", " "),
            str(gap.pairs),
            f"{100 * gap.training:.0f} %",
            f"{100 * gap.variation:.0f} %",
            difference_in_points(gap.difference),
            "–" if gap.adjusted is None else f"{gap.adjusted:.2g}",
            *([_acted(policy.get(gap.name))] if policy else []),
        ]
        for gap in shown
    ]
    print_table(heads, rows, title="Static illusion gap: training scenes minus interventions, in points")
    print_item(
        f"{gaps.paired} of {gaps.questions} questions about variations have a static twin: a question of the same kind "
        "about the training scene with the same seed. p is the p-value of the paired test after Holm's correction over "
        "the rows."
    )
    for line in gap_sentences(shown, policy):
        print_item(line)


def gap_sentences(gaps: Sequence[StaticGap], policy: Mapping[str, Metric]) -> list[str]:
    """Return sentences about a model's statistically significant static gaps, and about larger gaps of a policy.

    Args:
        gaps: Static illusion gaps of the model.
        policy: Illusion gaps of the policy when it acts, by axis or "all"; empty if there is no policy to compare.
    """
    supported = [gap for gap in gaps if gap.is_supported and gap.kind != "all"]
    words = ", ".join(f"{gap.name.replace('_', ' ')} ({100 * (gap.difference.value or 0.0):+.0f})" for gap in supported)
    lines = [f"Supported static gaps: {words}." if words else "No static gap of an axis or type is supported."]
    for gap in gaps:
        did = policy.get(gap.name)
        if did is not None and did.value is not None and did.low is not None and did.low > gap.difference.high:
            name = "all variations" if gap.kind == "all" else gap.name.replace("_", " ")
            lines.append(
                f"{name}: the policy loses {100 * did.value:.0f} points, the model "
                f"{100 * (gap.difference.value or 0.0):.0f}, and the intervals do not overlap. The model's recognition "
                f"therefore does not explain this loss."
            )
    return lines


def acted_gaps(diagnosis: RunDiagnosis) -> dict[str, Metric]:
    """Return a policy's illusion gaps, overall ("all") and by axis."""
    found = {}
    for metric in diagnosis.metrics:
        scope = "all" if metric.scope == "overall" else metric.scope.removeprefix("axis:")
        if metric.name == "illusion_gap" and (metric.scope == "overall" or metric.scope.startswith("axis:")):
            found[scope] = metric
    return found


def acted_form(diagnosis: RunDiagnosis) -> dict[str, Any]:
    """Return a policy's illusion gaps as a JSON-serializable dict."""
    return {"policy": diagnosis.policy, "gaps": {name: asdict(gap) for name, gap in acted_gaps(diagnosis).items()}}


def _acted(gap: Metric | None) -> str:
    if gap is None or gap.value is None or gap.low is None or gap.high is None:
        return "–"
    return f"{100 * gap.value:+.0f} ({100 * gap.low:+.0f} to {100 * gap.high:+.0f})"


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
    """Format a fraction in percent, rounded half up. None becomes a dash."""
    return "–" if value is None else str(round_half_up(100 * value, digits))


def signed_percent_of(value: Fraction) -> str:
    """Format a difference of two fractions in percentage points with its sign."""
    return f"{'+' if value >= 0 else ''}{percent_of(value)}"


def print_source(benchmark: Benchmark, fetched: Sequence[FetchedFile] = ()) -> None:
    """Print the data files that a benchmark needs, with their source and terms of use."""
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
        print_item(f"Data format: {layout}.")
