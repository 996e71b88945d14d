"""Draw the regions beside a laptop and a plate that goals accept, for docs/sides.md."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Renderer, Scene
from betterbench.sim.scenes.cameras import camera_matrices
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task
from betterbench.tasks.relations.beside import SIDES, side_of
from betterbench.tasks.relations.relation import SHARED

COLORS = {"left": (240, 140, 40), "right": (60, 130, 240), "behind": (60, 180, 90), "upper_right": (190, 80, 220)}
SHOWN = (("desk_meeting", "laptop"), ("breakfast_table", "plate"))
STEP_M = 0.002
"""Grid spacing of the table points whose side is determined [m]; a pixel shows 2 to 3 mm."""


def view(task_id: str, anchor: str, size: int) -> Image.Image:
    """Return the front view of a training scene with its anchor's sides painted on the table.

    The outline is the area in which the expert places objects.
    """
    task = get_task(task_id)
    scene = Scene(task, task.training[0], seed=0, action_space=EE_DELTA, quality=quality_preset("high"))
    state = scene.reset()
    with Renderer(scene.model, width=size, height=size, quality=scene.quality) as renderer:
        seen = renderer.render(scene.data, "front").rgb
    if seen is None:
        raise AssertionError("colors were requested")
    image = Image.fromarray(seen).convert("RGBA")
    layer = Image.new("RGBA", image.size)
    pen = ImageDraw.Draw(layer)
    camera = camera_matrices(scene.model, scene.data, "front", width=size, height=size)
    info, frame = state.info.object(anchor), state.pose(anchor)

    def pixels(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
        found, _ = camera.project(np.array([frame.apply((x, y, 0.0)) for x, y in points]))
        return [(float(u), float(v)) for u, v in found]

    axis = np.arange(-0.46, 0.46, STEP_M).tolist()
    half = 0.55 * STEP_M
    for x in axis:
        for y in axis:
            side = side_of(info, x, y)
            if side is not None:
                square = [(x - half, y - half), (x - half, y + half), (x + half, y + half), (x + half, y - half)]
                shared = [COLORS[name] for name in side.split(SHARED)]
                color = tuple(sum(parts) // len(shared) for parts in zip(*shared, strict=True))
                pen.polygon(pixels(square), fill=(*color, 110))
    for region in info.regions:
        if region.name in SIDES:
            (x, y, _), (dx, dy, _) = region.position, region.half_size
            corners = [(x - dx, y - dy), (x - dx, y + dy), (x + dx, y + dy), (x + dx, y - dy), (x - dx, y - dy)]
            pen.line(pixels(corners), fill=(*COLORS[region.name], 255), width=max(1, size // 220))
    return Image.alpha_composite(image, layer).convert("RGB")


def main(arguments: list[str]) -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/pictures/sides.jpg"), help="file of the picture")
    parser.add_argument("--size", type=int, default=440, help="side of each of the two views [pixel]")
    wanted = parser.parse_args(arguments)
    views = [view(task, anchor, wanted.size) for task, anchor in SHOWN]
    sheet = Image.new("RGB", (2 * wanted.size + 6, wanted.size), "white")
    for place, image in enumerate(views):
        sheet.paste(image, (place * (wanted.size + 6), 0))
    sheet.save(wanted.out, quality=80)
    print(f"{wanted.out}: {wanted.out.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
