"""Bounding box rulers and panel texts that the review page shows in addition to the meshes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from betterbench.geometry import Pose, Vector
from betterbench.quoting import markup_text
from betterbench.review.desk import ReviewDesk
from betterbench.review.queue import QueuedObject
from betterbench.sim.asset_checks.opening import gripper_opening_m, needed_opening_m
from betterbench.sim.assets import Asset, Grasp
from betterbench.sim.assets.importing.review import Verdict
from betterbench.sim.assets.importing.review.changes import said

TICK_M, LONG_TICK_M = 0.004, 0.008
COLORS = {"accept": "#20bf6b", "fix": "#2e86de", "reject": "#eb3b5a", "": "#8395a7"}
SIGNS = {"accept": "✔", "fix": "✎", "reject": "✘", "": "○"}
HULL_COLORS = (
    (31, 119, 180), (255, 127, 14), (44, 160, 44), (214, 39, 40), (148, 103, 189),
    (140, 86, 75), (227, 119, 194), (188, 189, 34), (23, 190, 207),
)  # fmt: skip
"""Colors of neighboring hulls (Tableau 10 without gray)."""


def ruler(size: Vector) -> np.ndarray:
    """Return line segments of a bounding box on the plane z = 0, with ticks every centimeter, (n, 2, 3) [m].

    The ticks are at the front edges, toward +x and -y; every fifth tick is longer.
    """
    x, y, z = size
    a, b = 0.5 * x, 0.5 * y
    lines: list[object] = list(box_edges((a, b, 0.5 * z)) + np.array([0.0, 0.0, 0.5 * z], dtype=np.float32))
    for k in range(1, int(100 * y) + 1):
        lines.append(((a, -b + 0.01 * k, 0.0), (a + _tick(k), -b + 0.01 * k, 0.0)))
    for k in range(1, int(100 * x) + 1):
        lines.append(((a - 0.01 * k, -b, 0.0), (a - 0.01 * k, -b - _tick(k), 0.0)))
    for k in range(1, int(100 * z) + 1):
        lines.append(((a, -b, 0.01 * k), (a, -b - _tick(k), 0.01 * k)))
    return np.array(lines, dtype=np.float32)


def box_edges(half_size: Vector) -> np.ndarray:
    """Return the edges of a box around the origin, (12, 2, 3) [m]."""
    x, y, z = half_size
    corners = [(sx * x, sy * y, sz * z) for sz in (-1, 1) for sx in (-1, 1) for sy in (-1, 1)]
    pairs = [(i, j) for i in range(8) for j in range(i + 1, 8) if (i ^ j).bit_count() == 1]
    return np.array([(corners[i], corners[j]) for i, j in pairs], dtype=np.float32)


def _tick(number: int) -> float:
    return LONG_TICK_M if number % 5 == 0 else TICK_M


def ruler_labels(size: Vector) -> list[tuple[str, Vector]]:
    """Return the labels for a box's width, depth and height, with their positions [m]."""
    x, y, z = size
    off = 0.018
    return [
        (f"{100 * y:.1f} cm", (0.5 * x + off, 0.0, 0.0)),
        (f"{100 * x:.1f} cm", (0.0, -0.5 * y - off, 0.0)),
        (f"{100 * z:.1f} cm", (0.5 * x, 0.5 * y + off, 0.5 * z)),
    ]


def turned_about_middle(asset: Asset, pose: Pose) -> Pose:
    """Return the displayed pose of an asset after rotating it about its box center and setting it down."""
    middle = (0.0, 0.0, 0.5 * asset.size_m[2])
    x, y, z = Pose((0.0, 0.0, 0.0), pose.quaternion).apply([-v for v in middle])
    placed = Pose((x, y, z + middle[2]), pose.quaternion)
    lowest = min(placed.apply(v)[2] for part in asset.visual for v in part.vertices.tolist())
    return placed.translated(z=-lowest)


# ------------------------------------------------------------------------------------------------------------ panel


def head(desk: ReviewDesk) -> str:
    """Return the upper part of the panel as HTML: progress, the object, and facts about it."""
    item = desk.at_hand
    verdict = desk.history.verdict
    rows = "".join(
        f'<tr><td style="opacity:.6;padding-right:10px;vertical-align:top">{markup_text(name)}</td>'
        f"<td>{markup_text(value)}</td></tr>"
        for name, value in _facts(desk)
    )
    badge = ""
    if verdict is not None:
        badge = (
            f'<span style="float:right;color:{COLORS[verdict.verdict]};font-size:13px">'
            f"{SIGNS[verdict.verdict]} {verdict.verdict}</span>"
        )
    share = 100.0 * desk.judged / len(desk.queue)
    return (
        f'<div style="padding:4px 10px;font-size:13px;line-height:1.45">'
        f'<div style="opacity:.65;font-size:12px">{desk.index + 1} of {len(desk.queue)} · '
        f"{desk.judged} judged · {markup_text(desk.author)}</div>"
        f'<div style="height:4px;background:#8884;border-radius:2px;margin:4px 0 6px">'
        f'<div style="height:4px;width:{share:.0f}%;background:#20bf6b;border-radius:2px"></div></div>'
        f'<div style="font-size:16px;font-weight:600">{markup_text(item.name)}{badge}</div>'
        f'<table style="font-size:12px;margin-top:4px">{rows}</table></div>'
    )


def _facts(desk: ReviewDesk) -> list[tuple[str, str]]:
    state, asset = desk.state, desk.asset
    if state is None or asset is None:
        return [("cannot be imported", desk.at_hand.problem)]
    kind, fit = state.imported.kind, state.imported.fit
    size = " × ".join(f"{100 * v:.1f}" for v in asset.size_m)
    usual = "unknown" if kind is None else f"{kind.name}, {100 * kind.low_m:.0f}–{100 * kind.high_m:.0f} cm"
    mass = f"{1000 * asset.mass_kg:.0f} g"
    if kind is not None:
        mass += f" (usual for its kind: {1000 * kind.mass_at(max(asset.size_m)):.0f} g)"
    shapes = f"{len(asset.collision)} hulls, {1000 * fit.outside_m:.1f} mm out, {1000 * fit.inside_m:.1f} mm in"
    frames = ", ".join(region.name for region in asset.regions) or "none"
    return [
        ("name", state.name),
        ("kind", usual),
        ("size", f"{size} cm"),
        ("mass", mass),
        ("collision", shapes),
        ("grasps", str(len(asset.grasps))),
        ("frames", frames),
        ("license", asset.license),
    ]


def foot(desk: ReviewDesk) -> str:
    """Return the lower part of the panel as HTML: the edit in progress, the last message, and the active decisions."""
    edit = None if desk.edit is None else said(desk.edit)
    decisions = [(_sign(r.decision), _said(r.decision), r.author) for _, r in desk.history.reviews[-6:]]
    return panel_foot(_at_hand(desk), edit, desk.message, decisions, is_problem=desk.is_problem)


def panel_foot(
    target: str,
    edit: str | None,
    message: str,
    decisions: Sequence[tuple[str, str, str]],
    *,
    is_problem: bool,
    between: str = "",
) -> str:
    """Return the lower part of a review's panel as HTML.

    Args:
        target: Gizmo target, as HTML.
        edit: The edit in progress, or None.
        message: The last message.
        decisions: Symbol, text and author of the last decisions.
        is_problem: Whether the message reports a problem.
        between: HTML to insert between the message and the decisions.
    """
    color = "#eb3b5a" if is_problem else "#20bf6b"
    pending = "" if edit is None else f"{edit} — Enter keeps it, Escape drops it"
    lines = "".join(
        f'<div style="opacity:.75">{sign} {markup_text(text)} '
        f'<span style="opacity:.6">· {markup_text(author)}</span></div>'
        for sign, text, author in decisions
    )
    return (
        f'<div style="padding:4px 10px;font-size:13px;line-height:1.45">'
        f"<div><b>Gizmo: {target}</b></div>"
        f'<div style="color:#f7b731;min-height:19px">{markup_text(pending)}</div>'
        f'<div style="color:{color};min-height:19px">{markup_text(message)}</div>{between}{lines}</div>'
    )


def _at_hand(desk: ReviewDesk) -> str:
    if desk.mode == "grasp":
        grasp = desk.grasp
        return "no grasp" if grasp is None else f"grasp {markup_text(grasp.name)}, {_opening(desk, grasp)}"
    if desk.mode == "frame":
        return "no frame" if desk.region is None else f"frame {markup_text(desk.region.name)}"
    return "pose" if desk.mode == "pose" else "support plane"


def _opening(desk: ReviewDesk, grasp: Grasp) -> str:
    """Return a phrase with the stated width of a grasp and the gripper opening that it requires."""
    stated, jaw = f"{1000 * grasp.width_m:.0f} mm wide", gripper_opening_m()
    solid = desk.solid
    needed = None if solid is None else needed_opening_m(solid, grasp)
    if needed is None:
        return f"{stated}; there is nothing between the pads"
    fits = "" if needed <= jaw else " — too wide"
    return f"{stated}; needs an opening of {1000 * needed:.0f} of {1000 * jaw:.0f} mm{fits}"


def _sign(decision: object) -> str:
    return SIGNS[decision.verdict] if isinstance(decision, Verdict) else "·"


def _said(decision: object) -> str:
    if isinstance(decision, Verdict):
        return f"{decision.verdict}{f': {decision.reason}' if decision.reason else ''}"
    return said(decision)  # type: ignore[arg-type]  # a history contains no undo


def queue_list(queue: Sequence[QueuedObject], verdicts: Sequence[str], index: int) -> str:
    """Return the part of the queue around the current object as an HTML list."""
    first = max(0, min(index - 4, len(queue) - 9))
    rows = "".join(
        f'<div style="padding:1px 4px;border-radius:3px;'
        f'{"background:#2e86de44;font-weight:600" if first + k == index else ""}">'
        f'<span style="color:{COLORS[verdicts[first + k]]}">{SIGNS[verdicts[first + k]]}</span>&ensp;'
        f"{markup_text(item.name)}</div>"
        for k, item in enumerate(queue[first : first + 9])
    )
    return f'<div style="padding:2px 10px;font-size:12px;line-height:1.4">{rows}</div>'
