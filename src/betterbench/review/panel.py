"""HTML for the parts of the panel that object reviews and scene reviews share."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

from betterbench.jobs.decisions import Verdict
from betterbench.quoting import markup_text

COLORS = {"accept": "#20bf6b", "fix": "#2e86de", "reject": "#eb3b5a", "": "#8395a7"}
SIGNS = {"accept": "✔", "fix": "✎", "reject": "✘", "": "○"}
QUEUE_ROWS = 9
"""Number of listed items of the queue: the current item and its neighbors."""
_BOX = "padding:4px 10px;font-size:13px;line-height:1.45;overflow-wrap:break-word"


def panel_head(
    name: str,
    verdict: Verdict | None,
    facts: Sequence[tuple[str, str]],
    *,
    author: str,
    index: int,
    judged: int,
    total: int,
) -> str:
    """Return the upper part of the panel: the progress, the name of the item and its verdict, and a table of facts.

    Args:
        name: Name of the current object or scene.
        verdict: Verdict on the current object or scene, or None if it has none.
        facts: Rows of the table, each as a name and a value.
        author: Name of the reviewer.
        index: Index of the current object or scene in the queue.
        judged: Number of objects or scenes that have a verdict.
        total: Number of objects or scenes in the queue.
    """
    badge = ""
    if verdict is not None:
        badge = (
            f'<span style="float:right;color:{COLORS[verdict.verdict]};font-size:13px">'
            f"{SIGNS[verdict.verdict]} {verdict.verdict}</span>"
        )
    rows = "".join(
        f'<tr><td style="opacity:.6;padding-right:10px;vertical-align:top">{markup_text(fact)}</td>'
        f"<td>{markup_text(value)}</td></tr>"
        for fact, value in facts
    )
    return (
        f'<div style="{_BOX}"><div style="opacity:.65;font-size:12px">{index + 1} of {total} · '
        f"{judged} judged · {markup_text(author)}</div>"
        f'<div style="height:4px;background:#8884;border-radius:2px;margin:4px 0 6px">'
        f'<div style="height:4px;width:{100.0 * judged / total:.0f}%;background:#20bf6b;border-radius:2px"></div></div>'
        f'<div style="font-size:16px;font-weight:600">{markup_text(name)}{badge}</div>'
        f'<table style="font-size:12px;margin-top:4px">{rows}</table></div>'
    )


def panel_foot(
    target: str,
    edit: str | None,
    message: str,
    decisions: Sequence[tuple[str, str, str]],
    *,
    is_problem: bool,
    between: str = "",
) -> str:
    """Return the lower part of the panel as HTML.

    It shows the target of the gizmo, the edit in progress, the last message and the last decisions.

    Args:
        target: Name of the element that the gizmo moves, as HTML.
        edit: Description of the edit in progress, or None if there is none.
        message: The last message.
        decisions: Symbol, text and author of each of the last decisions.
        is_problem: Whether the message reports a problem.
        between: HTML that is inserted between the message and the decisions.
    """
    color = "#eb3b5a" if is_problem else "#20bf6b"
    pending = "" if edit is None else f"{edit} — Enter keeps it, Escape drops it"
    lines = "".join(
        f'<div style="opacity:.75">{sign} {markup_text(text)} '
        f'<span style="opacity:.6">· {markup_text(author)}</span></div>'
        for sign, text, author in decisions
    )
    return (
        f'<div style="{_BOX}"><div><b>Gizmo: {target}</b></div>'
        f'<div style="color:#f7b731;min-height:19px">{markup_text(pending)}</div>'
        f'<div style="color:{color};min-height:19px">{markup_text(message)}</div>{between}{lines}</div>'
    )


def decision_sign(decision: object) -> str:
    """Return the symbol for a decision: the symbol of the verdict, or a dot for any other decision."""
    return SIGNS[decision.verdict] if isinstance(decision, Verdict) else "·"


def queue_list(names: Sequence[str], verdicts: Sequence[Verdict | None], index: int) -> str:
    """Return the part of the review queue around the current object or scene, as an HTML list."""
    first = max(0, min(index - QUEUE_ROWS // 2, len(names) - QUEUE_ROWS))
    rows = ""
    for k, (name, verdict) in enumerate(islice(zip(names, verdicts, strict=True), first, first + QUEUE_ROWS), first):
        kind = "" if verdict is None else verdict.verdict
        style = "background:#2e86de44;font-weight:600" if k == index else ""
        rows += (
            f'<div style="padding:1px 4px;border-radius:3px;{style}">'
            f'<span style="color:{COLORS[kind]}">{SIGNS[kind]}</span>&ensp;{markup_text(name)}</div>'
        )
    return f'<div style="padding:2px 10px;font-size:12px;line-height:1.4;overflow-wrap:break-word">{rows}</div>'
