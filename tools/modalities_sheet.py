"""A contact sheet of modalities: colors with boxes, instances, semantics and depth for some recorded states.

Each row of the sheet is one view halfway through a trial::

    MUJOCO_GL=egl python tools/modalities_sheet.py RUN --trial fast_food/T1/0 --out docs/pictures/modalities.jpg
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from betterbench.records import RunFolder
from betterbench.records.modalities.labels import SEMANTIC_IDS
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.modalities.pictures import depth_image, mask_image, object_colors, with_boxes
from betterbench.sim.modalities.run import seen_quality
from betterbench.sim.modalities.values import ViewValues
from betterbench.sim.scenes.limited import LimitedView

VIEWS = (ViewSpec("front"), ViewSpec("wrist"))
MODALITIES = ("rgb", "depth", "instances", "semantics", "boxes")
SIDE_PX, PAD_PX, HEAD_PX = 330, 6, 20


def main() -> None:
    """Draw the contact sheet."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n", maxsplit=1)[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--trial", action="append", required=True, help="TASK/CONDITION/SEED; repeatable")
    parser.add_argument("--at", type=float, default=0.45, help="moment of the trial, from 0 (start) to 1 (end)")
    parser.add_argument("--out", type=Path, default=Path("docs/pictures/modalities.jpg"))
    options = parser.parse_args()
    run = RunFolder.open(options.run)
    panels = [panel for trial in options.trial for panel in panels_of(run, trial, options.at)]
    sheet(panels).save(options.out, quality=84, optimize=True)
    sys.stdout.write(f"wrote {options.out}\n")


def panels_of(run: RunFolder, trial: str, at: float) -> list[tuple[str, list[Image.Image]]]:
    """Return the name and the pictures of each view of a trial."""
    task, condition, seed = trial.split("/")
    record = run.read_record(task, condition, int(seed))
    meta, row = record.metadata, round(at * (len(record) - 1))
    names = [o.name for o in meta.scene.objects]
    categories = [o.category for o in meta.scene.objects]
    panels = []
    with LimitedView(quality=seen_quality(run, record)) as limited:
        limited.open(run.scene_of(meta))
        facts, _ = limited.prepare(VIEWS, MODALITIES)
        (sights,) = limited.sights(record.qpos[row : row + 1], jitter=meta.view_jitter)
        for view, focal_px, sight in zip(VIEWS, facts.focal_px, sights, strict=True):
            values = ViewValues(facts, MODALITIES, categories, focal_px).of(sight, record.time[row], None)
            palette = np.array([(30, 30, 34), *object_colors(max(SEMANTIC_IDS.values()))], np.uint8)
            semantics = palette[np.minimum(values["semantics"], len(palette) - 1)]
            pictures = [
                with_boxes(values["rgb"], values["visible_box"], values["visible_fraction"], names),
                Image.fromarray(mask_image(values["instances"], object_colors(len(names)))),
                Image.fromarray(semantics),
                Image.fromarray(depth_image(values["depth"])),
            ]
            panels.append((f"{trial}, {record.time[row]:.1f} s, {view.name}", pictures))
    return panels


def sheet(panels: list[tuple[str, list[Image.Image]]]) -> Image.Image:
    """Return all panels, one per row, with its name above."""
    columns = max(len(pictures) for _, pictures in panels)
    width, height = PAD_PX + columns * (SIDE_PX + PAD_PX), len(panels) * (HEAD_PX + SIDE_PX + PAD_PX)
    image = Image.new("RGB", (width, height), (250, 250, 248))
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(13)
    for i, (name, pictures) in enumerate(panels):
        y = i * (HEAD_PX + SIDE_PX + PAD_PX)
        pen.text((PAD_PX, y + 3), name, fill=(28, 28, 30), font=font)
        for j, picture in enumerate(pictures):
            x = PAD_PX + j * (SIDE_PX + PAD_PX)
            image.paste(picture.resize((SIDE_PX, SIDE_PX), Image.Resampling.LANCZOS), (x, y + HEAD_PX))
    return image


if __name__ == "__main__":
    main()
