"""Page with the results of a study, and files with all numbers as JSON and CSV."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from markupsafe import Markup

from betterbench.demonstrations.shortcuts.prediction import read_prediction
from betterbench.jobs import write_durably
from betterbench.jobs.durable import on_disk
from betterbench.learning.study.doses import PLANTED, named_when_planted, rises
from betterbench.learning.study.findings import DECORRELATION, SOLVED, StudyFindings, findings_of
from betterbench.learning.study.stages import StudyOutcome
from betterbench.quoting import json_text
from betterbench.report.figures.drawing import Bar, BarGroup, Chart, draw
from betterbench.report.html import asset, environment
from betterbench.report.legend import AXIS_NAMES, LEGEND
from betterbench.report.outcomes import task_title
from betterbench.report.tables.table import Scalar, Table, to_csv
from betterbench.report.wording import Figure
from betterbench.statistics.wording import p_text
from betterbench.tasks import get_task
from betterbench.version import __version__
from betterbench.wording import plural

FILES = ("study.html", "study.json", "numbers.csv", "trials.csv")

LEAST_DIFFERENCE = 0.30
"""Expectation: the illusion gap of balanced learners is smaller than that of confounded learners by at least this
fraction.
"""
LEAST_SOLVED = 0.70
"""Expectation: balanced learners have at least this success rate on the variations whose words and objects occur in
training.
"""
LEAST_DECORRELATED = 0.20
"""Expectation: the success rate on variations is higher by at least this fraction for balanced than for
diverse-confounded learners.
"""
MOST_DEAF, LEAST_HEARING = 0.20, 0.70
"""Expectations about how often learners change their target when only the instruction changes: at most the first
fraction for confounded learners, and at least the second fraction for balanced learners.
"""
GOOD_AREA = 0.9
LEAST_NAMED = 0.90
"""Expectation: for learners with a planted confound, the diagnosis names the confound in at least this fraction of the
failed trials.
"""

_WHAT_VERDICTS_SAY = {
    "no gap": "the confounded learners solve it, so balancing has nothing to remove",
    "coverage is enough": (
        "the diverse-confounded learners solve what the confounded ones fail; they saw as many conditions as the "
        "balanced ones, but with each word tied to its place"
    ),
    "decorrelation is enough": "the balanced learners solve what the confounded ones fail",
    "needs more than decorrelation": "the balanced learners fail it, but learners trained on it solve it",
    "hard for another reason": "even learners trained on it fail it",
    "open": "too few trials or a missing arm: an interval contains 50 %",
}


@dataclass(frozen=True, slots=True)
class Expectation:
    """Expectation that was stated before the study, with the result.

    Attributes:
        expected: The expectation, as a sentence.
        found: The result in words.
        held: Whether the expectation was met; None if the result is inconclusive or was not measured.
    """

    expected: str
    found: str
    held: bool | None


def write_page(outcome: StudyOutcome, out: Path) -> StudyFindings:
    """Write the page, the JSON file and the CSV files of a study into its folder, and return the findings.

    The JSON and CSV files contain the measurements, and are byte-for-byte the same whether or not the study was
    interrupted. The page also reports how long the stages took.

    Raises:
        RecordError: If a prediction was changed after it was written.
        StorageError: If the disk is full.
    """
    predictions = {
        task: read_prediction(folder / "prediction.json")
        for task, folder in outcome.predictions.items()
        if (folder / "prediction.json").is_file()
    }
    found = findings_of(outcome.plan, outcome.learners, predictions)
    texts = (
        study_page(outcome, found),
        json_text(document_of(outcome, found), indent=1) + "\n",
        to_csv(numbers_table(found)),
        to_csv(trials_table(outcome)),
    )
    with on_disk(out):
        for name, text in zip(FILES, texts, strict=True):
            write_durably(out / name, text.encode())
    return found


def document_of(outcome: StudyOutcome, found: StudyFindings) -> dict[str, Any]:
    """Return all findings as a JSON document. It does not depend on whether the study was interrupted."""
    form: dict[str, Any] = json.loads(json.dumps(asdict(found)))
    return {
        "betterbench": __version__,
        "plan": outcome.plan.to_json(),
        "task_versions": {task: get_task(task).version for task in outcome.plan.tasks},
        "learners": len(outcome.learners),
        "trials": sum(len(f.trials) for f in outcome.learners),
        **form,
        "expected": [asdict(line) for line in expectations(found)],
    }


def study_page(outcome: StudyOutcome, found: StudyFindings) -> str:
    """Return the page of a study as self-contained HTML."""
    charts = [
        {"chart": c, "wide": Markup(draw(c)), "narrow": Markup(draw(c, narrow=True))}  # noqa: S704 - escaped there
        for c in study_charts(found)
    ]
    return (
        environment()
        .get_template("study.html.jinja")
        .render(
            style=Markup(study_style()),  # noqa: S704 - our own file
            plan=outcome.plan,
            found=found,
            overall=[a for a in found.arms if not a.task and not a.lever],
            by_task=[a for a in found.arms if a.task and not a.lever],
            expected=expectations(found),
            charts=charts,
            verdicts=_WHAT_VERDICTS_SAY,
            axes=AXIS_NAMES,
            labels={label.value: entry.short for label, entry in LEGEND.items()},
            title_of=task_title,
            learners=len(outcome.learners),
            trials=sum(len(f.trials) for f in outcome.learners),
            took=[(kind, _duration(s)) for kind, s in outcome.seconds.items()],
            p_text=p_text,
        )
    )


def study_style() -> str:
    """Return the style sheet for the page of a study."""
    return "".join(asset(f"{name}.css") for name in ("page", "figure", "study"))


def _duration(seconds: float) -> str:
    """Format a duration in words, such as "45 seconds", "12 minutes" or "3 h 05 min"."""
    if seconds < 90.0:
        return plural(round(seconds), "second")
    minutes = round(seconds / 60.0)
    return plural(minutes, "minute") if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


def study_charts(found: StudyFindings) -> Iterator[Chart]:
    """Yield the charts of the page: success by arm, the share of gaps that balancing removes, and failure by dose."""
    groups = []
    tasks = list(dict.fromkeys(a.task for a in found.arms if not a.lever))
    for task in tasks:
        rows: list[Bar] = []
        for arm in (a for a in found.arms if a.task == task and not a.lever):
            rows += [Bar(arm.arm, arm.training, "training"), Bar("", arm.variations, "variation")]
        groups.append(BarGroup(task_title(task) if task else "All tasks", tuple(rows)))
    yield Chart(
        "arms",
        "Success in training conditions and under variation, by arm",
        "Success rate in percent with its 95 % interval over trials. All training seeds are counted together.",
        tuple(groups),
        key=(("training", "Training conditions"), ("variation", "Variations")),
    )
    removed = [v for v in found.variations if v.validity is not None]
    if removed:
        yield Chart(
            "validity",
            "Construct validity",
            "Percentage of the confounded learners' illusion gap that balancing removes, with its 95 % interval (cut "
            "at the ends of the scale). Only variations with a gap significantly above zero are shown.",
            (BarGroup("", tuple(Bar(f"{v.task} {v.variation}", v.validity or Figure(), "dot") for v in removed)),),
        )
    if found.doses:
        groups = [
            BarGroup(
                task_title(task) if task else "All tasks",
                tuple(Bar(f"{100 * d.dose:.0f} %", d.failure, "reasoning") for d in found.doses if d.task == task),
            )
            for task in dict.fromkeys(d.task for d in found.doses)
        ]
        yield Chart(
            "doses",
            "Failure by dose",
            "Failure rate on variations that break a confound of word, place or look, by the share of demonstrations "
            "with confounds, in percent, with its 95 % interval.",
            tuple(groups),
        )


def expectations(found: StudyFindings) -> tuple[Expectation, ...]:
    """Return the expectations that were stated before the study, with the results.

    If the learners that an expectation is about have not learned their training conditions, the expectation stays open.
    """
    lines = []
    if found.known is not None and found.known.variations:
        gap, solved = found.known.contrast.gap, found.known.balanced
        where = (
            f"on the {plural(found.known.variations, 'variation')} without a word or object that training never showed"
        )
        text = f"Balanced learners solve {100 * LEAST_SOLVED:.0f} % or more {where}"
        held = None if solved.value is None else solved.value >= LEAST_SOLVED
        lines.append(_of_the_able(found, ("balanced",), Expectation(text, solved.sentence(), held)))
        text = f"Their illusion gap there is smaller than the confounded ones' by {100 * LEAST_DIFFERENCE:.0f} points"
        said = gap.sentence() + (f", {p_text(gap.p_value)}" if gap.p_value is not None else "")
        held = None if gap.value is None else gap.value <= -LEAST_DIFFERENCE
        lines.append(_of_the_able(found, ("confounded", "balanced"), Expectation(text, said, held)))
    if found.repeated is not None and found.repeated.variations:
        solved = found.repeated.success
        text = (
            f"Where decorrelation is enough according to the other training seeds, a balanced learner solves "
            f"{100 * LEAST_SOLVED:.0f} % or more"
        )
        held = None if solved.value is None else solved.value >= LEAST_SOLVED
        lines.append(_of_the_able(found, ("balanced",), Expectation(text, solved.sentence(), held)))
    lines += _expected_of_coverage(found)
    for role, bound, above in (("confounded", MOST_DEAF, False), ("balanced", LEAST_HEARING, True)):
        word = next((w for w in found.words if w.arm == found.roles.get(role)), None)
        if word is None or word.changed.value is None:
            continue
        way = "at least" if above else "at most"
        text = f"With other words in the same scene, {role} learners change their target in {way} {100 * bound:.0f} %"
        held = word.changed.value >= bound if above else word.changed.value <= bound
        lines.append(_of_the_able(found, (role,), Expectation(text, word.changed.sentence(), held)))
    if found.prediction is not None:
        area = found.prediction.area
        text = f"The audit's risk ranks failed above solved variations with an AUROC of {GOOD_AREA} or more"
        held = None if area.value is None else area.value >= GOOD_AREA
        said = _area_text(area, found.prediction.failed)
        lines.append(_of_the_able(found, ("confounded",), Expectation(text, said, held)))
    return (*lines, *_expected_of_doses(found))


def _expected_of_coverage(found: StudyFindings) -> Iterator[Expectation]:
    """Yield the expectations about balanced learners and about learners with diverse but confounded demonstrations.

    If the study does not have both kinds of learners, yield nothing.
    """
    pair = ("diverse-confounded", "balanced")
    for success in (c.success for c in found.coverage if not c.task and c.name == DECORRELATION):
        least = f"{100 * LEAST_DECORRELATED:.0f} points"
        text = f"Balanced learners solve more of the variations than {pair[0]} ones, by {least} or more"
        said = success.sentence() + (f", {p_text(success.p_value)}" if success.p_value is not None else "")
        held = None if success.value is None else success.value >= LEAST_DECORRELATED
        yield _of_the_able(found, pair, Expectation(text, said, held))


def _expected_of_doses(found: StudyFindings) -> Iterator[Expectation]:
    """Yield the expectations about doses, if the study has arms that mix training distributions."""
    overall = [d for d in found.doses if not d.task]
    if not overall:
        return
    said = ", ".join(f"{d.failure.with_unit()} at {100 * d.dose:.0f} %" for d in overall)
    yield Expectation("Variations that break a confound fail more often the higher its dose", said, rises(overall))
    named = named_when_planted(found.doses)
    text = (
        f"At doses of {100 * PLANTED:.0f} % or more, the diagnosis gives a label of the card to "
        f"{100 * LEAST_NAMED:.0f} % of the reasoning failures"
    )
    yield Expectation(text, named.sentence(), None if named.value is None else named.value >= LEAST_NAMED)


def _of_the_able(found: StudyFindings, roles: tuple[str, ...], line: Expectation) -> Expectation:
    """Mark an expectation as open if the learners with a given role solve too few of their training conditions."""
    for role in roles:
        arm = next((a for a in found.arms if (a.arm, a.task, a.lever) == (found.roles.get(role), "", "")), None)
        if arm is not None and arm.training.value is not None and arm.training.value < SOLVED:
            why = f"; but the {role} learners solve only {arm.training.with_unit()} of the training conditions"
            return replace(line, found=line.found + why, held=None)
    return line


def _area_text(area: Figure, failed: int) -> str:
    if area.value is None:
        return (
            f"not measured: {failed} of {plural(area.n or 0, 'variation')} failed; both failed and solved ones are "
            f"needed"
        )
    low, high = area.low or 0.0, area.high or 0.0
    return f"{area.value:.2f} (95 % interval {low:.2f} to {high:.2f}; {failed} of {area.n} variations failed)"


def numbers_table(found: StudyFindings) -> Table:
    """Return all numbers on the page as one table with one number per row. Rates are fractions."""
    rows: list[tuple[Scalar, ...]] = []

    def add(table: str, where: tuple[str, str, str], **figures: Figure | None) -> None:
        for number, figure in figures.items():
            if figure is not None:
                ends = (figure.value, figure.low, figure.high, figure.k, figure.n, figure.p_value)
                rows.append((table, *where, number, *ends))

    for a in found.arms:
        arm = f"{a.arm} {a.lever}".strip()
        numbers = {"training": a.training, "variations": a.variations, "gap": a.gap, "intention": a.intention}
        add("arms", (a.task, "", arm), **numbers)
    for v in found.variations:
        for arm in v.success:
            add("variations", (v.task, v.variation, arm), success=v.success[arm], gap=v.gaps[arm])
        risk = None if v.risk is None else Figure(v.risk)
        add("variations", (v.task, v.variation, ""), validity=v.validity, risk=risk)
    for c in found.compared:
        add("contrasts", (c.task, "", c.name), success=c.success, gap=c.gap)
    if found.known is not None:
        add("contrasts", ("", "", found.known.contrast.name), balanced_success=found.known.balanced)
    if found.repeated is not None:
        add("verdicts", ("", "", found.roles["balanced"]), left_out_success=found.repeated.success)
    for where, figures in _lever_numbers(found):
        add("levers", where, **figures)
    for w in found.words:
        add("words", ("", "", w.arm), changed=w.changed, right=w.right)
    if found.prediction is not None:
        scored = found.prediction
        add("prediction", ("", "", ""), area=scored.area, label=scored.label, exposed=scored.exposed)
    for d in found.doses:
        label = f"{d.arm} ({d.dose:g})"
        add("doses", (d.task, "", label), failure=d.failure, predicted_label=d.predicted, exposed_label=d.exposed)
    columns = ("table", "task", "variation", "arm", "number", "value", "low", "high", "k", "n", "p")
    return Table("numbers", "All numbers of the study.", columns, tuple(rows))


def _lever_numbers(found: StudyFindings) -> Iterator[tuple[tuple[str, str, str], dict[str, Figure]]]:
    """Yield the key (task, "", arm and recipe change) and the numbers of each row in the tables of recipe changes."""
    for table in found.levers:
        for row in table.rows:
            against = {} if row.against is None else {"success": row.against.success, "gap": row.against.gap}
            differences = {f"{name}_difference": figure for name, figure in against.items()}
            where = (" ".join(table.tasks), "", f"{table.arm} {row.found.lever}".strip())
            yield where, {**row.axes, **differences}


def trials_table(outcome: StudyOutcome) -> Table:
    """Return a table with all trials of all learners."""
    rows = tuple(
        (
            f.learner.task,
            f.learner.arm,
            f.learner.lever,
            f.learner.seed,
            t.variation,
            t.condition,
            t.seed,
            t.success,
            t.label,
            t.intention,
            t.target,
        )
        for f in outcome.learners
        for t in f.trials
    )
    columns = ("task", "arm", "lever", "training seed", "variation", "condition", "seed", "success", "label")
    return Table("trials", "All trials of the study.", (*columns, "intention correct", "first target"), rows)
