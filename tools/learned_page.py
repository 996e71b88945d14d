"""The tables in ``docs/learned.md``, from the studies' figures in ``docs/study``, and the style of their pages.

Run with ``python tools/learned_page.py``, after a study was copied there. A page that ``better study`` writes contains
its style sheet; the pages of the documentation share one file.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from betterbench.learning.study.page import study_style
from betterbench.statistics import Rate, percent, round_half_up
from betterbench.tasks import Axis

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE, STUDIES = DOCS / "learned.md", DOCS / "study"
SHEET = "study.css"
MANY = {2: "both", 3: "all three", 4: "all four", 5: "all five"}

TIED = {"morning_coffee": ("L3", "L4", "O1"), "dinner_plates": ("L1", "R1", "O1", "T1")}
"""Variations that the audit of the diverse-confounded demonstrations predicts to fail, by the prediction.json of the
study: its versions of the tasks are in diverse.json."""

Figure = Mapping[str, Any]


def filled(text: str, studies: Path = STUDIES) -> str:
    """Return the page text with all its tables regenerated."""
    study, levers, base, doses = (_read(studies / f"{name}.json") for name in ("study", "levers", "base", "doses"))
    tables = {
        "study-arms": _arms(study),
        "study-variations": _variations(study),
        **{f"levers-{table['arm']}": _levers(table) for table in _joined(levers["levers"], base["levers"])},
        "doses": _doses(doses),
        "diverse": _diverse(studies),
    }
    for name, rows in tables.items():
        begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
        if text.count(begin) != 1 or text.count(end) != 1:
            raise ValueError(f"the page needs {begin} and {end} once each")
        before, _, rest = text.partition(begin)
        lines = "\n".join(rows)
        text = f"{before}{begin}\n\n{lines}\n\n{end}{rest.partition(end)[2]}"
    return text


def linked(page: str) -> str:
    """Return a study's page with a link to the shared style sheet instead of its own."""
    before, begin, rest = page.partition("<style>")
    if not begin:
        return page
    # A page opened from disk has no origin for 'self' to refer to, so files are allowed as well.
    before = before.replace("style-src 'unsafe-inline'", "style-src 'self' file: 'unsafe-inline'")
    return f'{before}<link rel="stylesheet" href="{SHEET}">{rest.partition("</style>")[2]}'


def share_style(studies: Path = STUDIES) -> None:
    """Write the style sheet, and let every page link it."""
    (studies / SHEET).write_text(study_style(), encoding="utf-8")
    for page in studies.glob("*.html"):
        page.write_text(linked(page.read_text(encoding="utf-8")), encoding="utf-8")


def share(figure: Figure) -> str:
    """Return successes of trials with their share and its interval."""
    low, high = (_whole(figure[end]) for end in ("low", "high"))
    return f"{_count(figure)} = {percent(figure['k'], figure['n'], digits=0)} % ({low} to {high})"


def points(figure: Figure | None) -> str:
    """Return a difference in points with its interval."""
    if figure is None:
        return ""
    value, low, high = (_signed(figure[name]) for name in ("value", "low", "high"))
    return f"{value} ({low} to {high})"


def _arms(study: Mapping[str, Any]) -> list[str]:
    tasks, arms = study["plan"]["tasks"], list(study["plan"]["arms"])
    found = {(row["task"], row["arm"]): row for row in study["arms"] if not row["lever"]}
    rows = []
    for task in ("", *tasks):
        for arm in arms:
            row = found[task, arm]
            name = f"`{task}`" if task else MANY.get(len(tasks), f"all {len(tasks)}")
            rows.append([name, arm, share(row["training"]), share(row["variations"]), points(row["gap"])])
    return _table(["task", "trained on", "training conditions", "variations", "illusion gap, points"], rows)


def _variations(study: Mapping[str, Any]) -> list[str]:
    arms = list(study["plan"]["arms"])
    rows = [
        [
            f"`{row['task']}` {row['variation']}",
            row["predicted"] or "no risk",
            *(_count(row["success"][arm]) for arm in arms),
            row["verdict"],
        ]
        for row in study["variations"]
    ]
    return _table(["variation", "predicted", *arms, "verdict"], rows)


def _joined(tables: Sequence[Mapping[str, Any]], later: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return lever tables that include the levers trained later, next to the same learners without a lever."""
    more = {table["arm"]: table["rows"] for table in later}
    found = []
    for table in tables:
        plain, *added = more.get(table["arm"], [table["rows"][0]])
        if plain != table["rows"][0]:
            raise ValueError(f"the learners without a lever differ between the studies: {table['arm']}")
        found.append({**table, "rows": [*table["rows"], *added]})
    return found


def _levers(table: Mapping[str, Any]) -> list[str]:
    axes = [axis.value for axis in Axis if any(axis.value in row["axes"] for row in table["rows"])]
    rows = []
    for row in table["rows"]:
        found, against = row["found"], row["against"] or {}
        name = found["lever"] or "unchanged"
        name += f", begins with {row['start']}" if row["start"] else ""
        name += f", against {row['compared']}" if row["compared"] else ""
        counted = [found["training"], *(row["axes"][axis] for axis in axes), found["variations"], found["intention"]]
        rows.append([name, *map(_count, counted), points(against.get("success")), points(against.get("gap"))])
    head = ["recipe", "training", *(axis.replace("_", " ") for axis in axes), "all variations", "correct first target"]
    return _table([*head, "difference in success, points", "difference in illusion gap, points"], rows)


def _doses(study: Mapping[str, Any]) -> list[str]:
    trained = {row["arm"]: row["training"] for row in study["arms"] if not row["task"]}
    rows = [
        [
            f"{_whole(row['dose'])} %",
            share(trained[row["arm"]]),
            *(share(row[name]) for name in ("failure", "predicted", "exposed")),
        ]
        for row in study["doses"]
        if not row["task"]
    ]
    head = ["demonstrations with the confounds", "training conditions", "variations that break a confound: failed"]
    return _table(
        [*head, "failures of reasoning with the predicted label", "with a label that the card names"],
        rows,
    )


def _diverse(studies: Path) -> list[str]:
    """Return the diverse-confounded learners next to the study's learners with the same tasks and training seeds."""
    plan = _read(studies / "diverse.json")["plan"]
    seeds = {str(seed) for seed in plan["seeds"]}
    trials = [
        trial
        for name in ("trials.csv", "diverse-trials.csv")
        for trial in csv.DictReader((studies / name).read_text(encoding="utf-8").splitlines())
        if trial["task"] in plan["tasks"] and trial["training seed"] in seeds and not trial["lever"]
    ]
    rows = []
    for task in plan["tasks"]:
        for arm in ("confounded", "diverse-confounded", "balanced", "covered"):
            mine = [t for t in trials if (t["task"], t["arm"]) == (task, arm)]
            trained = [t for t in mine if not t["variation"]]
            tied = [t for t in mine if t["variation"] in TIED[task]]
            others = [t for t in mine if t["variation"] and t["variation"] not in TIED[task]]
            right = sum(t["intention correct"] == "true" for t in tied)
            rows.append([f"`{task}`", arm, *map(_solved, (trained, tied)), f"{right}/{len(tied)}", _solved(others)])
    head = ["task", "trained on", "training conditions", "variations that break the tie", "correct first target there"]
    return _table([*head, "other variations"], rows)


def _solved(trials: Sequence[Mapping[str, str]]) -> str:
    return share(Rate(sum(t["success"] == "true" for t in trials), len(trials)).to_json())


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = [f"| {' | '.join(row)} |" for row in (head, *rows)]
    return [lines[0], "|" + "---|" * len(head), *lines[1:]]


def _count(figure: Figure) -> str:
    return f"{figure['k']}/{figure['n']}"


def _whole(value: float) -> str:
    return str(round_half_up(100.0 * value, 0))


def _signed(value: float) -> str:
    rounded = int(round_half_up(100.0 * value, 0))
    return f"{rounded:+d}".replace("-", "−") if rounded else "0"


def _read(path: Path) -> dict[str, Any]:
    form: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return form


def main() -> None:
    """Write the page, and the style of the studies."""
    share_style()
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    sys.stdout.write(f"wrote the tables of {PAGE}\n")


if __name__ == "__main__":
    main()
