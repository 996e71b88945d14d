"""Files of an audit: ``audit.json`` for programs, and ``audit.md`` for people."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from betterbench.certification.certificate import CLAUSES, Summary
from betterbench.generation.better_release.audit import CODES, Audit, Finding
from betterbench.generation.better_release.building import Built
from betterbench.generation.better_release.files import ReleaseTask
from betterbench.generation.better_release.matching import Match
from betterbench.generation.better_release.resolved import Resolved
from betterbench.quoting import markdown_code, markdown_table, markdown_text

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Imported:
    """Imported release task, with its library assets and the results of the audit and the certification.

    Attributes:
        certificate: Certification result of each condition of our task. Empty if the task was not certified.
    """

    release: ReleaseTask
    resolved: Mapping[str, Resolved]
    matches: Mapping[str, Match]
    built: Built
    audit: Audit
    certificate: Mapping[str, Summary] = field(default_factory=dict)

    @property
    def task_id(self) -> str | None:
        """Id of the task in our format, or None if our format cannot represent any training variation."""
        return None if self.built.task is None else self.built.task.id

    def certified(self, variation: str) -> Summary | None:
        """Return the certification result of a release variation, or None if it was not certified."""
        return self.certificate.get(self.built.variations[variation].name or "")


def certified_text(summary: Summary | None) -> str:
    """Format a certification result ("3/3", "0/3: (b)"). Return an empty string if there is no result."""
    if summary is None:
        return ""
    failed = [f"({letter})" for letter in CLAUSES if summary.clauses[letter] < summary.n]
    return f"{summary.passed}/{summary.n}" + (f": {' '.join(failed)}" if failed else "")


def certificate_notes(summary: Summary | None) -> tuple[str, ...]:
    """Return a remark for each failed clause of a certificate, with an example seed."""
    notes = () if summary is None else summary.notes
    firsts = (next((note for note in notes if note.startswith(f"({letter}) fails")), "") for letter in CLAUSES)
    return tuple(filter(None, firsts))


def audit_form(tasks: Iterable[Imported], *, suite: str | None) -> dict[str, Any]:
    """Return audits as a JSON-serializable dict.

    Args:
        tasks: Imported tasks, each with its audit.
        suite: Name of the suite folder, or None if no task can be represented in our format.
    """
    return {"schema_version": SCHEMA_VERSION, "suite": suite, "tasks": [_task_form(one) for one in tasks]}


def _task_form(one: Imported) -> dict[str, Any]:
    slots = one.built.slots
    return {
        "release_task": one.release.task.task_id,
        "template_type": one.release.task.template_type,
        "task": one.task_id,
        "variations": [_variation_form(one, name) for name in one.resolved],
        "assets": {
            name: {"category": m.category, "color": m.color, "score": m.score, "how": m.how}
            for name, m in one.matches.items()
        },
        "unmatched": [name for name in one.release.instances if name not in one.matches],
        "slots": {
            name: {"x": slot.x, "y": slot.y, "yaw": slot.yaw, "moved_cm": round(100.0 * slots.moved_m[name], 2)}
            for name, slot in slots.slots.items()
        },
        "crowded": [[a, b, round(100.0 * missing, 2)] for a, b, missing in slots.crowded],
        "findings": [finding.to_json() for finding in one.audit.findings],
    }


def _variation_form(one: Imported, name: str) -> dict[str, Any]:
    variation, shown, summary = one.resolved[name], one.built.variations[name], one.certified(name)
    return {
        "variation": name,
        "training": variation.training,
        "instruction": variation.instruction,
        "goals": [str(p) for p in variation.success],
        "fails": [str(p) for p in variation.fail],
        "condition": shown.name,
        "base": shown.base,
        "operations": list(shown.operations),
        "reasons": list(shown.reasons),
        "left_out": dict(shown.left_out),
        "no_counterpart": [str(p) for p in shown.predicates],
        "certificate": None
        if summary is None
        else {
            "trials": summary.n,
            "passed": summary.passed,
            "clauses": summary.clauses,
            "failures": list(certificate_notes(summary)),
        },
    }


def counts_of(findings: Sequence[Finding]) -> tuple[int, int]:
    """Return the number of faults and the number of remarks among findings."""
    faults = sum(f.level == "fault" for f in findings)
    return faults, len(findings) - faults


def audit_markdown(tasks: Iterable[Imported], *, suite: str | None) -> str:
    """Format audits as Markdown. The arguments are the same as for :func:`audit_form`."""
    lines = ["# Audit of a BeTTER release", ""]
    if suite is not None:
        lines += [f"The tasks in our form are in {markdown_code(suite)}.", ""]
    for one in tasks:
        lines += [f"## {markdown_text(one.release.task.task_id)}", "", *_overview(one), "", *_assets(one)]
        for name in ("", *one.resolved):
            lines += _section(one, name)
    lines += ["", "## Codes", "", *markdown_table(["code", "meaning"], _codes())]
    return "\n".join(lines) + "\n"


def _overview(one: Imported) -> list[str]:
    rows = []
    for name, variation in one.resolved.items():
        shown = one.built.variations[name]
        faults, remarks = counts_of(one.audit.of(name))
        kind = "training" if variation.training else f"test, from {shown.base}" if shown.base else "test"
        ours = markdown_code(shown.name) if shown.name else "not represented"
        certified = certified_text(one.certified(name)) or "–"
        rows.append([markdown_text(name), kind, ours, str(faults), str(remarks), certified])
    return markdown_table(["variation", "kind", "in our form", "faults", "remarks", "certified"], rows)


def _assets(one: Imported) -> list[str]:
    rows = []
    for name in one.release.instances:
        match = one.matches.get(name)
        found = ["none", "", ""] if match is None else [_asset_text(match), f"{match.score:.2f}", match.how]
        rows.append([markdown_code(name), *found])
    return [*markdown_table(["object", "asset", "score", "found by"], rows), ""]


def _asset_text(match: Match) -> str:
    return markdown_code(match.category if match.color is None else f"{match.category} ({match.color})")


def _section(one: Imported, name: str) -> list[str]:
    """Return the lines about a variation or the complete task.

    They list the findings and the failed clauses of the certificate.
    """
    findings = one.audit.of(name)
    notes = certificate_notes(one.certified(name)) if name else ()
    if not findings and not notes:
        return []
    lines = ["", f"### {markdown_text(name)}" if name else "### The whole task", ""]
    if name:
        lines += [f"Instruction: {markdown_text(one.resolved[name].instruction)}", ""]
    for level in ("fault", "remark"):
        lines += [
            f"- **{level}** {markdown_code(f.code)}: {markdown_text(f.text)}" for f in findings if f.level == level
        ]
    lines += [f"- **certificate** {markdown_text(note)}" for note in notes]
    return lines


def _codes() -> list[list[str]]:
    return [[markdown_code(code), markdown_text(meaning)] for code, meaning in CODES.items()]
