"""Panel texts for the scene review page."""

from __future__ import annotations

import math
from collections.abc import Sequence

from betterbench.certification.certificate import CLAUSES
from betterbench.jobs.decisions import Verdict
from betterbench.quoting import markup_text
from betterbench.review.drawing import COLORS, SIGNS, panel_foot
from betterbench.review.scenes.changes import FrameChange, SlotChange, said
from betterbench.review.scenes.desk import SceneDesk
from betterbench.review.scenes.queue import QueuedScene

_BOX = "padding:4px 10px;font-size:13px;line-height:1.45"


def head(desk: SceneDesk, judged: int) -> str:
    """Return the upper part of the panel as HTML: progress, the scene, and facts about it."""
    item, condition = desk.at_hand, desk.condition
    verdict = item.verdict(desk.history)
    badge = ""
    if verdict is not None:
        badge = (
            f'<span style="float:right;color:{COLORS[verdict.verdict]};font-size:13px">'
            f"{SIGNS[verdict.verdict]} {verdict.verdict}</span>"
        )
    facts = [
        ("instruction", condition.instruction.text),
        ("expected", condition.expected.value),
        ("objects", ", ".join(f"{spec.name} ({spec.role})" for spec in condition.objects)),
        ("seed", str(desk.seed)),
    ]
    variation = next((v for v in desk.task.variations if v.name == item.condition), None)
    if variation is not None:
        facts.insert(0, ("change", f"{variation.title} (from {variation.base})"))
    if desk.problem:
        facts.append(("cannot be built", desk.problem))
    rows = "".join(
        f'<tr><td style="opacity:.6;padding-right:10px;vertical-align:top">{markup_text(name)}</td>'
        f"<td>{markup_text(value)}</td></tr>"
        for name, value in facts
    )
    share = 100.0 * judged / len(desk.queue)
    return (
        f'<div style="{_BOX}"><div style="opacity:.65;font-size:12px">{desk.index + 1} of {len(desk.queue)} · '
        f"{judged} judged · {markup_text(desk.author)}</div>"
        f'<div style="height:4px;background:#8884;border-radius:2px;margin:4px 0 6px">'
        f'<div style="height:4px;width:{share:.0f}%;background:#20bf6b;border-radius:2px"></div></div>'
        f'<div style="font-size:16px;font-weight:600">{markup_text(item.name)}{badge}</div>'
        f'<table style="font-size:12px;margin-top:4px">{rows}</table></div>'
    )


def foot(desk: SceneDesk) -> str:
    """Return the lower part of the panel as HTML: gizmo, edit, last message, certificate, and active decisions."""
    edit = None if desk.edit is None else said(desk.edit)
    last = desk.history.reviews[-6:]
    decisions = [(_sign(r.decision), _said(r.decision, r.condition), r.author) for _, r in last]
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


def _sign(decision: object) -> str:
    return SIGNS[decision.verdict] if isinstance(decision, Verdict) else "·"


def _said(decision: object, condition: str) -> str:
    if isinstance(decision, SlotChange | FrameChange):
        return said(decision)
    if isinstance(decision, Verdict):
        return f"{condition}: {decision.verdict}{f', {decision.reason}' if decision.reason else ''}"
    return ""


def queue_list(queue: Sequence[QueuedScene], verdicts: Sequence[str], index: int) -> str:
    """Return the part of the queue around the current scene as an HTML list."""
    first = max(0, min(index - 4, len(queue) - 9))
    rows = "".join(
        f'<div style="padding:1px 4px;border-radius:3px;'
        f'{"background:#2e86de44;font-weight:600" if first + k == index else ""}">'
        f'<span style="color:{COLORS[verdicts[first + k]]}">{SIGNS[verdicts[first + k]]}</span>&ensp;'
        f"{markup_text(item.name)}</div>"
        for k, item in enumerate(queue[first : first + 9])
    )
    return f'<div style="padding:2px 10px;font-size:12px;line-height:1.4">{rows}</div>'
