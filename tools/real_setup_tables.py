"""Write the tables of the page about building the real scene, from the simulated scene, and its marker sheets.

Example:
    python tools/real_setup_tables.py
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from betterbench.quoting import markdown_table
from betterbench.real.sheet.camera_pose import mounted, twin_camera
from betterbench.real.sheet.drawing import pdf
from betterbench.real.sheet.layout import BASE_MM
from betterbench.real.sheet.pages import sheet_pages
from betterbench.sim.assets import build_unpainted, looks
from betterbench.sim.robots.so101 import SO101
from betterbench.sim.scenes.rooms import CLOTHS
from betterbench.tasks import get_task

PAGE = Path("docs/real-setup.md")
BEGIN, END = "<!-- numbers:{}:begin -->", "<!-- numbers:{}:end -->"
_TITLES = {"basket": "basket", "lemon": "lemon", "mangosteen": "mangosteen", "block": "red block", "soap_bar": "soap"}
_IMAGE = (640, 480)


def tables() -> dict[str, str]:
    """Return the generated tables of the page by name."""
    return {"objects": _objects(), "cloths": _cloths(), "slots": _slots(), "layouts": _layouts(), "cameras": _cameras()}


def filled(page: str) -> str:
    """Return a page with its tables written anew; raise ValueError if a marker is missing."""
    for name, table in tables().items():
        begin, end = BEGIN.format(name), END.format(name)
        head, found, rest = page.partition(begin)
        _, closed, tail = rest.partition(end)
        if not (found and closed):
            raise ValueError(f"{PAGE} must hold the lines {begin} and {end}")
        page = f"{head}{begin}\n\n{table}\n\n{end}{tail}"
    return page


def sheets() -> dict[str, bytes]:
    """Return the marker sheets that are linked by the page, as PDF by file name."""
    return {f"pictures/real-sheet-{paper}.pdf": pdf(sheet_pages(paper)) for paper in ("a4", "letter")}


def write(out: Path) -> None:
    """Write the tables into the page of a documentation folder, and the sheets next to its pictures."""
    path = out / PAGE.name
    path.write_text(filled(path.read_text(encoding="utf-8")), encoding="utf-8")
    for name, data in sheets().items():
        (out / name).write_bytes(data)


def _table(titles: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    return "\n".join(markdown_table(titles, rows))


def _objects() -> str:
    """Return the sizes of the objects over all looks of the demonstrations."""
    task, rows = get_task("fruit_basket"), []
    specs = {o.name: o for condition in task.training for o in condition.objects}
    for name, title in _TITLES.items():
        spec = specs[name]
        assets = [build_unpainted(spec.category, look=k, color=spec.color) for k in looks(spec.category)]
        sizes = 1000.0 * np.array([asset.size_m for asset in assets])
        grams = 1000.0 * np.array([asset.mass_kg for asset in assets])
        low, high, middle = sizes.min(axis=0), sizes.max(axis=0), np.median(sizes, axis=0)
        spans = [f"{a:.0f} to {b:.0f}" for a, b in zip(low, high, strict=True)]
        usual = " x ".join(f"{v:.0f}" for v in middle)
        rows.append((title, *spans, usual, f"{grams.min():.0f} to {grams.max():.0f}"))
    return _table(("object", "length [mm]", "width [mm]", "height [mm]", "middle", "mass in the twin [g]"), rows)


def _cloths() -> str:
    task = get_task("fruit_basket")
    rows = []
    for color, rgb in CLOTHS.items():
        told = sorted({c.instruction.text for c in task.training if c.cloth == color})
        rows.append((color, " ".join(f"{255 * v:.0f}" for v in rgb), " ".join(told)))
    return _table(("cloth", "mean color (RGB, 0 to 255)", "instruction"), rows)


def _slots() -> str:
    rows = []
    for slot in get_task("fruit_basket").slots:
        side = "left" if slot.y > 0.0 else "right"
        place = f"{1000 * slot.x:.0f}", f"{1000 * abs(slot.y):.0f} {side}"
        rows.append((f"`{slot.name}`", *place, f"{1000 * slot.jitter_m:.0f}"))
    return _table(("slot", "ahead of the origin [mm]", "aside [mm]", "varied by up to [mm]"), rows)


def _layouts() -> str:
    task = get_task("fruit_basket")
    rows = []
    for number, condition in enumerate(task.training, start=1):
        places = (f"`{condition.layout[name]}`" for name in _TITLES)
        rows.append((f"`train{number}`", condition.cloth or "", *places))
    return _table(("condition", "cloth", *_TITLES.values()), rows)


def _cameras() -> str:
    front, wrist = twin_camera(), mounted(SO101.wrist_camera)
    x, y, z = front.position_m
    down = math.degrees(math.asin(-front.axes[2, 2]))
    meets = front.position_m - front.axes[:, 2] * z / front.axes[2, 2]
    tilt = math.degrees(math.acos(-float(wrist.axes[2, 2])))
    at = ", ".join(f"{1000 * v:.0f}" for v in wrist.position_m)
    rows = [
        (
            "front",
            f"{1000 * x:.0f} mm ahead of the origin, {1000 * abs(y):.0f} mm aside, {1000 * z:.0f} mm high",
            f"toward the arm, {down:.1f}° down; its axis meets the table {1000 * meets[0]:.0f} mm ahead of the origin",
            *_lens(front.fovy_deg),
        ),
        (
            "wrist",
            f"({at}) mm in the gripper's frame: TheRobotStudio's mount for a 32 x 32 mm module",
            f"along the jaws, turned by {tilt:.1f}° toward their tips",
            *_lens(wrist.fovy_deg),
        ),
    ]
    return _table(("camera", "position", "direction", "lens at 4:3", "focal length at 640 x 480"), rows)


def _lens(fovy_deg: float) -> tuple[str, str]:
    """Return the vertical, horizontal and diagonal field of view, and the focal length [pixel]."""
    width, height = _IMAGE
    focal = 0.5 * height / math.tan(0.5 * math.radians(fovy_deg))
    views = [2.0 * math.degrees(math.atan(0.5 * side / focal)) for side in (height, width, math.hypot(width, height))]
    return f"{views[0]:.0f}° vertical, {views[1]:.0f}° horizontal, {views[2]:.0f}° diagonal", f"{focal:.0f} px"


def foot() -> str:
    """Return the foot of the base in words."""
    rear, front, half = BASE_MM
    return f"from {-rear:.0f} mm behind the origin to {front:.0f} mm ahead of it, and {half:.1f} mm to each side"


if __name__ == "__main__":
    write(PAGE.parent)
