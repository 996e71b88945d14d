"""Draw small pictures of scenes for the documentation, with outlines around the changes of a variation."""

from __future__ import annotations

import functools
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFilter, ImageFont, ImageOps

from betterbench.errors import InvalidInputError
from betterbench.evaluation.figures.show import OUTLINE, wrap_text
from betterbench.interface.actions import EE_DELTA
from betterbench.report.figures.image_sheet import INK, PAPER, SheetCell, image_sheet
from betterbench.sim.scenes import Renderer, Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Condition, Task, Variation, get_task
from betterbench.tasks.interventions import vary

PICTURE_BYTES = 28_000
"""Maximum file size of a card's picture [byte], so that 70 pictures are not larger than the code."""
_BEST, _WORST, _STEP = 90, 50, 4  # qualities of JPEG that are tried, from the best
_GAP = 4  # between two pictures that belong together [pixel]


@functools.cache
def front_view(task_id: str, condition: str, seed: int, size: int) -> Image.Image:
    """Return a policy's front camera view at reset, with a variation's changes outlined.

    Args:
        task_id: Task id.
        condition: Name of a training condition; ``VARIATION`` for a variation's test scene, and ``VARIATION/before``
            for the training scene from which it is derived.
        seed: Seed.
        size: Side of the picture [pixel].
    """
    task = get_task(task_id)
    name, _, before = condition.partition("/")
    outlined: frozenset[str] = frozenset()
    if name in {v.name for v in task.variations}:
        test, changes = vary(task, task.variation(name))
        shown = task.train(task.variation(name).base) if before else test
        outlined = changes.objects
    else:
        shown = task.train(name)
    return _render(task, shown, outlined, seed, size)


def pair(task: Task, variation: Variation, *, seed: int, size: int) -> Image.Image:
    """Return a variation's training scene next to its test scene with the same seed, each ``size`` pixels wide."""
    return row(_before_and_after(task, variation, seed=seed, size=size, shown=size))


def _before_and_after(task: Task, variation: Variation, *, seed: int, size: int, shown: int) -> list[Image.Image]:
    """Return both scenes, with the instruction below if only the instruction differs."""
    images = [front_view(task.id, name, seed, size) for name in (f"{variation.name}/before", variation.name)]
    images = [image.resize((shown, shown), Image.Resampling.LANCZOS) if shown != size else image for image in images]
    test, changes = vary(task, variation)
    said = [task.train(variation.base).instruction.text, test.instruction.text]
    if changes.objects or said[0] == said[1]:
        return images
    told = [with_sentence(image, text) for image, text in zip(images, said, strict=True)]
    tall = max(image.height for image in told)
    return [ImageOps.pad(image, (shown, tall), color=PAPER, centering=(0, 0)) for image in told]


def with_sentence(image: Image.Image, text: str) -> Image.Image:
    """Return a picture with an instruction under it."""
    size = max(11, image.width // 15)
    font = ImageFont.load_default(size)
    lines = wrap_text(text, font, image.width - 2 * _GAP)
    height = round(1.25 * size) * len(lines) + 2 * _GAP
    told = Image.new("RGB", (image.width, image.height + height), PAPER)
    told.paste(image, (0, 0))
    draw = ImageDraw.Draw(told)
    for i, line in enumerate(lines):
        draw.text((_GAP, image.height + _GAP + i * round(1.25 * size)), line, fill=INK, font=font)
    return told


def row(images: Sequence[Image.Image], *, columns: int | None = None) -> Image.Image:
    """Return equally sized pictures side by side, in rows of ``columns``."""
    columns = columns or len(images)
    width, height = images[0].size
    rows = -(-len(images) // columns)
    sheet = Image.new("RGB", (columns * (width + _GAP) - _GAP, rows * (height + _GAP) - _GAP), PAPER)
    for i, image in enumerate(images):
        sheet.paste(image, ((i % columns) * (width + _GAP), (i // columns) * (height + _GAP)))
    return sheet


def contact_sheet(tasks: Sequence[Task], *, seed: int, size: int = 256, shown: int = 168) -> Image.Image:
    """Return the pairs of all variations, one row per task, each under its id and its title.

    Scenes are rendered with a side length of ``size`` pixels and shown with ``shown`` pixels.
    """
    return Image.fromarray(
        image_sheet(
            [
                [
                    SheetCell(
                        f"{task.id}/{variation.name}",
                        [
                            np.asarray(view)
                            for view in _before_and_after(task, variation, seed=seed, size=size, shown=shown)
                        ],
                        variation.title,
                    )
                    for variation in task.variations
                ]
                for task in tasks
            ]
        )
    )


def save_small(image: Image.Image, path: Path, *, limit: int = PICTURE_BYTES) -> None:
    """Write a JPEG in the best quality that keeps the file below ``limit`` bytes."""
    for quality in range(_BEST, _WORST, -_STEP):
        buffer = io.BytesIO()
        image.save(buffer, "JPEG", quality=quality, optimize=True, progressive=True)
        if buffer.tell() < limit:
            path.write_bytes(buffer.getvalue())
            return
    raise InvalidInputError(path.name, f"exceeds {limit} bytes even at quality {_WORST}", "Make the picture smaller")


def _render(task: Task, condition: Condition, outlined: frozenset[str], seed: int, size: int) -> Image.Image:
    scene = Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("standard"))
    with Renderer(scene.model, width=size, height=size, quality=scene.quality) as renderer:
        view = renderer.render(scene.data, "front", masks=True)
    if view.rgb is None or view.masks is None:
        raise AssertionError("colors and masks were requested")
    bodies = [int(b) for b, p in zip(scene.compiled.bodies, scene.placements, strict=True) if p.spec.name in outlined]
    inner = np.isin(view.masks, bodies)
    grown = np.asarray(Image.fromarray(inner).convert("L").filter(ImageFilter.MaxFilter(5))) > 0
    picture = view.rgb.copy()
    picture[grown & ~inner] = OUTLINE
    return Image.fromarray(picture)
