"""Contact sheet of a training set: an image of one initial state per condition, with the instruction."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw

from betterbench.jobs import write_durably
from betterbench.records import RunFolder
from betterbench.sim.scenes.image_files import jpeg_bytes
from betterbench.sim.scenes.limited import LimitedView
from betterbench.tasks import TrialId

SIZE = 256
"""Side length of each image [pixel]."""
COLUMNS = 4
MOST_VIEWS = 12
"""Maximum number of conditions that are shown for a task."""
_CAPTION = 44
_LINE = 40


def draw_sheet(run: RunFolder, trials: Sequence[TrialId], path: Path) -> None:
    """Write a JPEG with front views of the initial states of several records, labeled with condition and instruction.

    Raises:
        RecordError: If a record or its scene cannot be read.
        MissingDependencyError: If off-screen OpenGL does not work on this machine.
    """
    shown = list(trials)[:MOST_VIEWS]
    columns = min(COLUMNS, len(shown))
    lines = -(-len(shown) // columns)
    sheet = Image.new("RGB", (columns * SIZE, lines * (SIZE + _CAPTION)), "white")
    draw = ImageDraw.Draw(sheet)
    with LimitedView(quality="standard", size=SIZE) as view:
        for i, trial in enumerate(shown):
            record = run.read_record(trial.task, trial.condition, trial.seed)
            view.open_of(run, record)
            pixels = view.draw(record.qpos[0], "front", jitter=record.metadata.view_jitter)
            x, y = i % columns * SIZE, i // columns * (SIZE + _CAPTION)
            sheet.paste(Image.fromarray(pixels), (x, y))
            said = textwrap.wrap(f"{trial.condition}: {record.metadata.instruction}", _LINE)[:3]
            for number, line in enumerate(said):
                draw.text((x + 4, y + SIZE + 2 + 13 * number), line, fill="black")
    write_durably(path, jpeg_bytes(sheet, quality=88))
