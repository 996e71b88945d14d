"""Write the documentation page with the values, reasons and effects of the thresholds.

Example:
    python tools/threshold_page.py
"""

from __future__ import annotations

import re
from pathlib import Path

import betterbench.diagnosis
import betterbench.tasks
import betterbench.tasks.relations
from betterbench.tasks import Threshold, threshold_table

_ENTRY = re.compile(r'\bthreshold\(\s*"(\w+)"')
_SECTIONS = (
    ("While a trial runs", "tasks/thresholds.py", Path(betterbench.tasks.__file__).with_name("thresholds.py")),
    ("The diagnosis", "diagnosis/thresholds.py", Path(betterbench.diagnosis.__file__).with_name("thresholds.py")),
    ("Relations", "tasks/relations", Path(betterbench.tasks.relations.__file__).parent),
)
"""Heading, module name and module of each section's thresholds."""


def write(out: Path) -> None:
    """Write the page into the documentation folder."""
    (out / "thresholds.md").write_text(page(), encoding="utf-8")


def page() -> str:
    """Return the page."""
    table = {entry.name: entry for entry in threshold_table()}
    lines = [
        "# Thresholds",
        "",
        (
            "Labels depend on these numbers. A report and `better diagnose --json` list them with their values, "
            "except for those marked °. These were added to the table later. If they were listed, older stored "
            "diagnoses would seem to use other thresholds. The last column lists the labels that become more or "
            "less frequent with a larger value, if nothing else changes. It was derived from the code, not measured. "
            '"Policies without a fault" are those of the [independent family](calibration.md). "Judges" are language '
            "models that judged images and instructions without seeing the program's verdicts ([how](sides.md))."
        ),
    ]
    for heading, name, place in _SECTIONS:
        files = [place] if place.is_file() else sorted(place.glob("*.py"))
        entries = [table[found] for file in files for found in _ENTRY.findall(file.read_text(encoding="utf-8"))]
        lines += ["", f"## {heading}", "", f"In `{name}`.", "", "| threshold | value | decides | with a larger value |"]
        lines += ["|---|---|---|---|", *map(_row, entries)]
    return "\n".join([*lines, ""])


def _row(entry: Threshold) -> str:
    unit = "" if entry.unit == "1" else f" {entry.unit}"
    mark = "" if entry.listed else " °"
    larger = entry.effect.removeprefix("Larger: ").removesuffix(".")
    reason = entry.reason.replace("<", "&lt;")
    return f"| `{entry.name}`{mark} | {entry.value:.4g}{unit} | {reason} | {larger} |"


if __name__ == "__main__":
    write(Path(__file__).resolve().parent.parent / "docs")
