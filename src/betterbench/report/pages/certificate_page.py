"""Page about a certificate, as one self-contained HTML file with the smallest margins of each task and condition."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from betterbench.certification.certificate import CLAUSES, Certificate, Summary, seed_ranges, summaries
from betterbench.report.html import environment, write


@dataclass(frozen=True, slots=True)
class TaskRows:
    """Variations and training conditions of one task, as shown on the page."""

    task: str
    variations: tuple[Summary, ...]
    training: tuple[Summary, ...]


def write_certificate_page(certificate: Certificate, path: Path) -> Path:
    """Write the page about a certificate, and return its path."""
    return write(path, render_certificate(certificate))


def render_certificate(certificate: Certificate) -> str:
    """Return the page about a certificate as HTML."""
    groups = summaries(certificate.trials)
    return (
        environment()
        .get_template("certificate.html.jinja")
        .render(
            certificate=certificate,
            clauses=CLAUSES,
            tasks=_by_task(groups),
            variations=[s for s in groups if not s.training],
            training=[s for s in groups if s.training],
            seeds=seed_ranges(certificate.seeds).replace("-", "–").replace(",", ", "),
            passed=sum(t.passed for t in certificate.trials),
            solved=certificate.solved,
            ambiguous=len(certificate.ambiguous),
            failing=[t for t in certificate.trials if not t.passed],
            minutes=certificate.wall_s / 60.0,
        )
    )


def _by_task(groups: Sequence[Summary]) -> list[TaskRows]:
    rows = []
    for task, group in itertools.groupby(sorted(groups, key=lambda s: s.task), key=lambda s: s.task):
        both = tuple(group)
        rows.append(TaskRows(task, tuple(s for s in both if not s.training), tuple(s for s in both if s.training)))
    return rows
