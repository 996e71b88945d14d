"""Pictures of the tool paths in a task's demonstrations, drawn over an image of an initial state."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence

import numpy as np
from PIL import Image, ImageDraw

from betterbench.demonstrations.making.acceptance import FOLDER
from betterbench.demonstrations.making.production import attempts_of
from betterbench.errors import BetterError, StorageError
from betterbench.jobs import OnCount, write_durably
from betterbench.records import Record, RunFolder
from betterbench.sim.scenes.image_files import jpeg_bytes
from betterbench.sim.scenes.limited import LimitedView
from betterbench.tasks import TrialId

SIZE = 512
"""Side length of a picture [pixel]."""
MOST_PATHS = 60
"""Maximum number of paths in a picture. The demonstrations with the smallest seeds are drawn."""


def draw_paths(run: RunFolder, *, on_progress: OnCount | None = None) -> dict[str, str]:
    """Draw the tool paths in the first training condition of every task.

    Paths from the same source demonstration share a color. A demonstration without a source has its own color.

    Args:
        run: Folder of the run.
        on_progress: Called with the number of finished pictures and the total number.

    Returns:
        For each task, the path of the picture relative to the report, or the reason why it could not be drawn.
    """
    leads = {t: next((n.lead for n in o.notes if n.accepted), "") for t, o in attempts_of(run.path).items()}
    done = sorted(entry.key for entry in run.entries() if entry.status == "done")
    files: dict[str, str] = {}
    tasks = list(dict.fromkeys(t.task for t in done))
    for number, task in enumerate(tasks):
        if on_progress is not None:
            on_progress(number, len(tasks))
        trials = [t for t in done if t.task == task]
        trials = [t for t in trials if t.condition == trials[0].condition][:MOST_PATHS]
        name = f"paths-{task}.jpg"
        try:
            write_durably(run.inside(FOLDER, name), _picture(run, trials, leads))
            files[task] = name
        except StorageError:
            raise
        except BetterError as problem:
            files[task] = f"none: {problem}"
    return files


def _picture(run: RunFolder, trials: Sequence[TrialId], leads: Mapping[TrialId, str]) -> bytes:
    records = [run.read_record(t.task, t.condition, t.seed) for t in trials]
    groups = list(dict.fromkeys(leads.get(t) or str(t) for t in trials))
    with LimitedView(quality="standard", size=SIZE) as view:
        view.open_of(run, records[0])
        first = records[0]
        image = Image.fromarray(view.draw(first.qpos[0], "front", jitter=first.metadata.view_jitter))
        draw = ImageDraw.Draw(image)
        for trial, record in zip(trials, records, strict=True):
            hue = groups.index(leads.get(trial) or str(trial)) / len(groups)
            color = tuple(round(255 * v) for v in colorsys.hsv_to_rgb(hue, 0.85, 1.0))
            _draw_path(draw, view.project(record.ee_position, "front"), record, color)
    return jpeg_bytes(image, quality=88)


def _draw_path(draw: ImageDraw.ImageDraw, pixels: np.ndarray, record: Record, color: tuple[int, ...]) -> None:
    """Draw the tool path of a demonstration, with a ring at each point where the gripper begins to close."""
    points = [(float(x), float(y)) for x, y in pixels if np.isfinite((x, y)).all()]
    draw.line(points, fill=color, width=1)
    closed = record.gripper_command > 0.0
    for row in np.flatnonzero(closed[1:] & ~closed[:-1]) + 1:
        x, y = pixels[row]
        if np.isfinite((x, y)).all():
            draw.ellipse((x - 3, y - 3, x + 3, y + 3), outline=color)
