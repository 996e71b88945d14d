"""Section of a variation's card with the results of the study of learned policies.

The numbers come from ``docs/study/study.json``, which ``better study`` wrote.
"""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

from betterbench.statistics import percent
from betterbench.tasks import get_task

STUDY = Path(__file__).resolve().parents[1] / "docs" / "study" / "study.json"
LEAST = -1.0
"""Shares whose interval extends below this value are not reported: the underlying gap is too close to zero."""
LINK = "[study](../learned.md#what-the-study-showed)"


def validity_text(task: str, variation: str, study: Path = STUDY) -> str:
    """Return the card's line: who solved the variation, and how much of the gap balancing removed."""
    found = _read(study)
    row = next((v for v in found["variations"] if (v["task"], v["variation"]) == (task, variation)), None)
    if row is None:
        return "not measured, because no learners were trained on this task yet"
    version = found["task_versions"][task]
    if version != get_task(task).version:
        return f"measured only for version {version} of the task, not for the present version ({LINK})"
    solved = "; ".join(f"{arm} {_share(row['success'][arm])}" for arm in found["plan"]["arms"])
    removed = row["validity"]
    share = ""
    if removed is not None and removed["low"] < LEAST:
        share = "; the illusion gap is too small to measure the share of it that balanced training removes"
    elif removed is not None:
        low, high = (_whole(removed[end]) for end in ("low", "high"))
        share = f"; balanced training removes {_whole(removed['value'])} % of the illusion gap ({low} to {high})"
    return f"trials solved by learners, by training data: {solved}{share}; verdict: {row['verdict']} ({LINK})"


@functools.cache
def _read(study: Path) -> dict[str, Any]:
    form: dict[str, Any] = json.loads(study.read_text(encoding="utf-8"))
    return form


def _share(figure: dict[str, Any]) -> str:
    return f"{percent(figure['k'], figure['n'])} % ({figure['k']}/{figure['n']})"


def _whole(share: float) -> str:
    return f"{100.0 * share:.0f}".replace("-", "−")
