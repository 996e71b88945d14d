"""HTML for the panel of the page for reviewing scenes."""

from __future__ import annotations

import math

from betterbench.certification.certificate import CLAUSES
from betterbench.jobs.decisions import Verdict
from betterbench.quoting import markup_text
from betterbench.review.panel import decision_sign, panel_foot, panel_head
from betterbench.review.scenes.changes import FrameChange, SlotChange, said
from betterbench.review.scenes.desk import SceneDesk


def head(desk: SceneDesk, judged: int) -> str:
    """Return the upper part of the panel as HTML: the progress, the current scene, and facts about it."""
    item = desk.at_hand
    return panel_head(
        item.name,
        item.verdict(desk.history),
        _facts(desk),
        author=desk.author,
        index=desk.index,
        judged=judged,
        total=len(desk.queue),
    )


def _facts(desk: SceneDesk) -> list[tuple[str, str]]:
    condition = desk.condition
    facts = [
        ("instruction", condition.instruction.text),
        ("expected", condition.expected.value),
        ("objects", ", ".join(f"{spec.name} ({spec.role})" for spec in condition.objects)),
        ("seed", str(desk.seed)),
    ]
    variation = next((v for v in desk.task.variations if v.name == desk.at_hand.condition), None)
    if variation is not None:
        facts.insert(0, ("change", f"{variation.title} (from {variation.base})"))
    if desk.problem:
        facts.append(("cannot be built", desk.problem))
    return facts


def foot(desk: SceneDesk) -> str:
    """Return the lower part of the panel as HTML.

    It shows the target of the gizmo, the edit in progress, the last message, the certificate, and the latest decisions.
    """
    edit = None if desk.edit is None else said(desk.edit)
    last = desk.history.reviews[-6:]
    decisions = [(decision_sign(r.decision), _said(r.decision, r.condition), r.author) for _, r in last]
    target, between = markup_text(_target(desk)), _certificate(desk)
    return panel_foot(target, edit, desk.message, decisions, is_problem=desk.is_problem, between=between)


def _target(desk: SceneDesk) -> str:
    if desk.mode == "slot":
        slot = desk.slot
        if slot is None:
            return "no slot"
        return f"slot {slot.name} at ({slot.x:.3f} m, {slot.y:.3f} m), {math.degrees(slot.yaw):.0f}°"
    frame = desk.frame
    return "no frame" if frame is None else f"frame {frame[1].name} of {frame[0].spec.name}"


def _certificate(desk: SceneDesk) -> str:
    found = desk.certified
    if found is None:
        return ""
    rows = "".join(
        f'<div style="color:{"#20bf6b" if clause.passed else "#eb3b5a"}">{"✔" if clause.passed else "✘"} '
        f"({letter}) {markup_text(CLAUSES[letter])}"
        f"{'' if clause.passed or not clause.text else ': ' + markup_text(clause.text)}</div>"
        for letter, clause in ((letter, found.clauses[letter]) for letter in CLAUSES)
    )
    return f'<div style="font-size:12px;margin:4px 0">{rows}</div>'


def _said(decision: object, condition: str) -> str:
    if isinstance(decision, SlotChange | FrameChange):
        return said(decision)
    if isinstance(decision, Verdict):
        return f"{condition}: {decision.verdict}{f', {decision.reason}' if decision.reason else ''}"
    return ""
