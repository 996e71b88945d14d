"""Write the closing points of the library's preferred grasps; with --check, compare them with the packaged file.

Usage: .venv/bin/python tools/closing_points.py [--check]
"""

from __future__ import annotations

import json
import math
import sys
from importlib import resources

from betterbench.json_form import SEAL, seal_of
from betterbench.sim.assets import build, categories, looks, unseen_looks
from betterbench.tasks.judging.picked_slots import FORM, PACKAGED


def points_of(category: str) -> list[tuple[float, float, float]]:
    """Return x and y of a category's closing points in the object's frame, and their variation over the looks [mm].

    A category with several equally preferred grasps, such as a plate's rim, has one point for each.
    """
    found: dict[int, list[tuple[float, float]]] = {}
    for look in (*looks(category), *unseen_looks(category)):
        grasps = build(category, look=look).grasps
        best = min((grasp.preference for grasp in grasps), default=0)
        for number, grasp in enumerate(grasp for grasp in grasps if grasp.preference == best):
            x, y, _ = grasp.pose.position
            found.setdefault(number, []).append((1000.0 * x, 1000.0 * y))
    points = []
    for seen in found.values():
        x, y = (sum(values) / len(seen) for values in zip(*seen, strict=True))
        points.append((round(x, 1), round(y, 1), round(max(math.dist(p, (x, y)) for p in seen), 1)))
    return [(x + 0.0, y + 0.0, spread) for x, y, spread in sorted(set(points))]


def file_text() -> str:
    """Return the text of the file, one line per category."""
    known = {category: points for category in categories() if (points := points_of(category))}
    form = json.loads(json.dumps({"form": FORM, "version": 1, "categories": known}))
    lines = ",\n".join(f" {json.dumps(name)}: {json.dumps(points)}" for name, points in form["categories"].items())
    head = f'{{"form": {json.dumps(FORM)}, "version": 1, "{SEAL}": "{seal_of(form)}",\n "categories": {{\n'
    return head + lines + "\n}}\n"


def main() -> int:
    """Write the file, or compare with it."""
    with resources.as_file(resources.files("betterbench.tasks").joinpath("data", PACKAGED)) as path:
        if "--check" not in sys.argv[1:]:
            path.write_text(file_text(), encoding="utf-8")
            return 0
        if path.read_text(encoding="utf-8") == file_text():
            return 0
    print(f"{PACKAGED} does not agree with the assets. Run tools/closing_points.py.", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
