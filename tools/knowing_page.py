"""Write the measured part of docs/knowing.md from learners' trials and their answers about them.

The folder has a run of ``better eval`` (``runs/TASK``), with the knowledge that ``better diagnose --answers`` stored,
and a run of ``better vlm`` (``static/TASK``) for each task.

Example:
    python tools/knowing_page.py measured/ morning_coffee fruit_lunch seasoning_rack
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from betterbench.diagnosis import RunDiagnosis, diagnose_run
from betterbench.records import RunFolder
from betterbench.statistics import Difference, Rate
from betterbench.vlm.prediction import prediction_table
from betterbench.vlm.stored import StoredRun, read_static_run
from betterbench.vqa.knowing import Knowledge, read_knowledge

PAGE = Path(__file__).resolve().parents[1] / "docs" / "knowing.md"
BEGIN, END = "<!-- measured:begin -->", "<!-- measured:end -->"
Measured = tuple[str, StoredRun, RunDiagnosis, Knowledge]


def main(arguments: Sequence[str] | None = None) -> int:
    """Replace the measured tables of the page; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("tasks", nargs="+")
    options = parser.parse_args(arguments)
    found = [_read(options.folder, task) for task in options.tasks]
    text = "\n".join([*_learners(found), "", *_prediction(found), "", *_groups(found)])
    page = PAGE.read_text()
    block = re.compile(f"{re.escape(BEGIN)}.*{re.escape(END)}", re.DOTALL)
    PAGE.write_text(block.sub(lambda _: f"{BEGIN}\n\n{text}\n\n{END}", page))
    return 0


def _read(folder: Path, task: str) -> Measured:
    run = RunFolder.open(folder / "runs" / task)
    known = read_knowledge(run)
    if known is None:
        raise SystemExit(f"{run.path} has no knowledge.json. Run better diagnose {run.path} --answers FILE.")
    return task, read_static_run(folder / "static" / task), diagnose_run(run), known


def _learners(found: Sequence[Measured]) -> Iterator[str]:
    columns = ("learner of", "training conditions", "variations", "illusion gap", "correct answers", "static gap")
    yield f"| {' | '.join((*columns, 'known failures'))} |"
    yield "|---|---|---|---|---|---|---|"
    for task, static, diagnosis, known in found:
        gap = diagnosis.metric("illusion_gap", "overall")
        rates = (_rate(diagnosis, scope) for scope in ("training", "overall"))
        right = sum(item.score_in("parsed") == 1 for item in static.items.values())
        group = known.groups[0]
        yield (
            f"| `{task}` | {' | '.join(map(_told, rates))} | {'–' if gap is None else _metric(gap)} "
            f"| {right}/{len(static.items)} | {_static(static)} "
            f"| {group.known_failures}/{group.failed} (guessed {group.expected_failures:.1f}) |"
        )


def _rate(diagnosis: RunDiagnosis, scope: str) -> Rate:
    metric = diagnosis.metric("success_rate", scope)
    return Rate(0, 0) if metric is None else Rate(metric.k or 0, metric.n)


def _told(rate: Rate) -> str:
    return f"{rate.k}/{rate.n} ({100 * rate.low:.0f} to {100 * rate.high:.0f} %)" if rate.n else "–"


def _points(value: float, low: float, high: float) -> str:
    return f"{100 * value:+.0f} ({100 * low:+.0f} to {100 * high:+.0f})".replace("-", "−")


def _metric(gap: object) -> str:
    value, low, high = (getattr(gap, name) for name in ("value", "low", "high"))
    return "–" if value is None else _points(value, low, high)


def _static(static: StoredRun) -> str:
    told = static.head.get("static_gap")
    if not isinstance(told, dict):
        return "–"
    first = told["by_column"]["parsed"][0]
    ends = first["difference"]
    return f"{_points(ends['value'], ends['low'], ends['high'])}, {first['pairs']} pairs"


def _prediction(found: Sequence[Measured]) -> Iterator[str]:
    table = prediction_table([(task, static, diagnosis) for task, static, diagnosis, _ in found])
    for told in table.predictions:
        yield f"- {told.sentence[0].upper()}{told.sentence[1:]}".replace("-1", "−1").replace("-0", "−0")
    for line in table.warnings:
        yield f"- {line}"


def _groups(found: Sequence[Measured]) -> Iterator[str]:
    yield "| learner of | trials | knows | guessed | does | knows − does | failed, knows | p, Holm | finding |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for task, _, _, known in found:
        for group in known.groups:
            name = group.name.removeprefix(f"{task}/").replace("_", " ")
            if not group.knows.n:
                yield f"| `{task}` | {name} ({group.trials}) | – | – | – | – | – | – | not asked |"
                continue
            yield (
                f"| `{task}` | {name} | {group.knows.k}/{group.knows.n} | {group.expected:.1f} "
                f"| {group.does.k}/{group.does.n} | {_difference(group.difference)} "
                f"| {group.known_failures}/{group.failed} ({group.expected_failures:.1f}) | {group.adjusted:.2g} "
                f"| {group.verdict.value} |"
            )


def _difference(found: Difference) -> str:
    return _points(found.value or 0.0, found.low, found.high)


if __name__ == "__main__":
    raise SystemExit(main())
