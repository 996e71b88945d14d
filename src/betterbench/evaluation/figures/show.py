"""Images of conditions, for example of a training scene next to the test scene of a variation."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

from betterbench.interface.actions import EE_DELTA, USUAL_ROBOT
from betterbench.records.credits import credit_lines
from betterbench.sim.assets import build
from betterbench.sim.assets.asset import origin_of
from betterbench.sim.scenes import Renderer, Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Condition, Expected, Task, Variation, get_task
from betterbench.tasks.interventions import resolve_condition

OUTLINE = (255, 64, 160)
"""RGB color of outlines. No object of the suite has this color."""
_PAPER, _INK, _SOFT = (250, 250, 248), (28, 28, 30), (110, 110, 116)


def show_condition(
    task: Task,
    condition: Condition,
    *,
    seed: int,
    size: int,
    outlined: Sequence[str] = (),
    robot: str = USUAL_ROBOT,
) -> Image.Image:
    """Render the front view of a condition after the reset, as an image of ``size`` x ``size`` pixels.

    The given objects are outlined.
    """
    scene = Scene(task, condition, seed=seed, action_space=EE_DELTA, quality=quality_preset("high"), robot_name=robot)
    with Renderer(scene.model, width=size, height=size, quality=scene.quality) as renderer:
        view = renderer.render(scene.data, "front", masks=True)
    if view.rgb is None or view.masks is None:
        raise AssertionError("unreachable: colors and masks were requested")
    bodies = [int(b) for b, p in zip(scene.compiled.bodies, scene.placements, strict=True) if p.spec.name in outlined]
    return Image.fromarray(_outline(view.rgb, np.isin(view.masks, bodies), max(2, size // 180)))


def show_comparison(
    task_id: str, name: str, *, seed: int = 0, size: int = 512, robot: str = USUAL_ROBOT
) -> Image.Image:
    """Render the training scene and the test scene of a variation side by side. Changed objects are outlined.

    Both scenes have the same seed. Each image has ``size`` x ``size`` pixels.
    """
    task = get_task(task_id)
    variation = task.variation(name)
    base, found = task.train(variation.base), resolve_condition(task_id, name)
    test, outlined = found.condition, sorted(found.changes.objects)
    left = show_condition(task, base, seed=seed, size=size, outlined=outlined, robot=robot)
    right = show_condition(task, test, seed=seed, size=size, outlined=outlined, robot=robot)
    head = f"{task.title} · {variation.name} · {_printable(variation.title)}"
    return _side_by_side(
        head,
        (f"training scene ({base.name})", base.instruction.text, left),
        (f"test scene ({variation.name}): {_RIGHT[variation.expected.value]}", test.instruction.text, right),
    )


_RIGHT = {
    "succeed": "the goal can be reached",
    "refuse": "correct: refuse",
    "stay_still": "correct: stay still",
    "ambiguous": "ambiguous: no right behavior",
}
"""Description of the correct behavior in a test scene."""


def card_title(variation: Variation) -> str:
    """Return the title of a variation.

    If the correct behavior is not to reach the goal, the title ends with this behavior.
    """
    right = "" if variation.expected is Expected.SUCCEED else f" ({_RIGHT[variation.expected.value]})"
    return f"{variation.name}: {_printable(variation.title)}{right}"


def _printable(text: str) -> str:
    """Replace arrow characters, because the built-in font does not contain them."""
    return text.replace("→", ">")


def image_file(image: Image.Image, suffix: str, *, remark: str) -> bytes:
    """Encode an image as PNG or JPEG, depending on the file name's suffix. The remark is stored in the file header."""
    buffer = io.BytesIO()
    if suffix.lower() == ".png":
        texts = PngInfo()
        texts.add_text("Software", remark)
        image.save(buffer, "PNG", pnginfo=texts)
    else:
        image.save(buffer, "JPEG", quality=90, comment=remark.encode())
    return buffer.getvalue()


def show_training(
    task_id: str, *, seed: int = 0, size: int = 512, columns: int = 4, robot: str = USUAL_ROBOT
) -> Image.Image:
    """Render all training conditions of a task, in rows of ``columns`` images."""
    task = get_task(task_id)
    panels = [
        (c.name, c.instruction.text, show_condition(task, c, seed=seed, size=size, robot=robot)) for c in task.training
    ]
    return _in_rows(f"{task.title} · training distribution", panels, columns)


def show_card(task_id: str, *, seed: int = 0, size: int = 256, columns: int = 4) -> Image.Image:
    """Render an overview of a task: the first training condition of each layout, and all test scenes."""
    task = get_task(task_id)
    layouts = {tuple(sorted(c.layout.items())): c for c in reversed(task.training)}
    shown = [c for c in task.training if c in layouts.values()]
    panels = [(c.name, c.instruction.text, show_condition(task, c, seed=seed, size=size)) for c in shown]
    for variation in task.variations:
        found = resolve_condition(task_id, variation.name)
        image = show_condition(task, found.condition, seed=seed, size=size, outlined=sorted(found.changes.objects))
        panels.append((card_title(variation), found.condition.instruction.text, image))
    return _in_rows(task.title, panels, columns)


def _in_rows(head: str, panels: Sequence[tuple[str, str, Image.Image]], columns: int) -> Image.Image:
    rows = [panels[i : i + columns] for i in range(0, len(panels), columns)]
    sheets = [_side_by_side(head if i == 0 else "", *row) for i, row in enumerate(rows)]
    whole = Image.new("RGB", (max(s.width for s in sheets), sum(s.height for s in sheets)), _PAPER)
    top = 0
    for sheet in sheets:
        whole.paste(sheet, (0, top))
        top += sheet.height
    return whole


def shown_credits(task_id: str, name: str | None) -> tuple[str, ...]:
    """Return the credit lines for all objects in the test scene and the training scene of a variation.

    If ``name`` is None, the objects in all training conditions are credited.
    """
    task = get_task(task_id)
    conditions = task.training
    if name is not None:
        conditions = (task.train(task.variation(name).base), resolve_condition(task_id, name).condition)
    specs = {(o.category, o.color) for condition in conditions for o in condition.objects}
    assets = [build(category, color=color) for category, color in sorted(specs, key=str)]
    return credit_lines([_Credited(a.identity, *origin_of(a)) for a in assets])


@dataclass(frozen=True, slots=True)
class _Credited:
    asset: str
    source: str
    license: str


def _outline(rgb: np.ndarray, mask: np.ndarray, width: int) -> np.ndarray:
    """Return a copy of an image in which the outline of a mask is drawn."""
    grown = mask.copy()
    for _ in range(width):
        padded = np.pad(grown, 1)
        grown = padded[1:-1, 1:-1] | padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]
    image = rgb.copy()
    image[grown & ~mask] = OUTLINE
    return image


def _side_by_side(head: str, *panels: tuple[str, str, Image.Image]) -> Image.Image:
    size = panels[0][2].width
    pad = size // 24
    big, small = ImageFont.load_default(size / 22), ImageFont.load_default(size / 28)
    titles = [_wrapped(title, small, size) for title, _, _ in panels]
    lines = [wrap_text(text, small, size) for _, text, _ in panels]
    row = round(size / 20)
    top = 2 * pad + row if head else pad
    caption = row * max(len(above) + len(below) for above, below in zip(titles, lines, strict=True)) + pad
    sheet = Image.new("RGB", (pad + (size + pad) * len(panels), top + size + caption + pad // 2), _PAPER)
    draw = ImageDraw.Draw(sheet)
    draw.text((pad, pad), head, fill=_INK, font=big)
    for i, ((_, _, image), above, below) in enumerate(zip(panels, titles, lines, strict=True)):
        x = pad + i * (size + pad)
        sheet.paste(image, (x, top))
        for j, line in enumerate((*above, *below)):
            fill = _SOFT if j < len(above) else _INK
            draw.text((x, top + size + pad // 2 + j * row), line, fill=fill, font=small)
    return sheet


def wrap_text(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: int) -> list[str]:
    """Put an instruction in quotation marks, and split it into lines of at most the given width [px]."""
    return _wrapped(f"“{text}”", font, width)


def _wrapped(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: int) -> list[str]:
    lines: list[str] = []
    for word in text.split():
        candidate = f"{lines[-1]} {word}" if lines else word
        if lines and font.getlength(candidate) <= width:
            lines[-1] = candidate
        else:
            lines.append(word)
    return lines
