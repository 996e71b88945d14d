"""LeRobot's language columns: the subgoals of an episode, and questions about its frames.

Source: huggingface/lerobot 0.6, ``src/lerobot/datasets/language.py`` and ``docs/source/language_and_recipes.mdx``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from betterbench.demonstrations.export.episodes import Dataset
from betterbench.demonstrations.export.part import Part

PERSISTENT, EVENTS = "language_persistent", "language_events"


def language_columns(dataset: Dataset, number: int, part: Part) -> dict[str, pa.Array]:
    """Return the two language columns of an episode.

    ``language_persistent`` contains all subgoals with their start times [s], repeated in every frame.
    ``language_events`` contains the questions about each frame with their answers, and the name of the image column.
    """
    times = (np.arange(len(part)) / dataset.rate_hz).astype(np.float32)
    changes = [row for row in range(len(part)) if row == 0 or part.subgoals[row] != part.subgoals[row - 1]]
    steps = [_said("assistant", part.subgoals[row], "subtask") | {"timestamp": times[row]} for row in changes]
    events: list[list[dict[str, Any]]] = [[] for _ in range(len(part))]
    columns = {column.camera: name for name, column in reversed(dataset.layout.all_images.items())}
    for asked in dataset.episodes[number].questions:
        if asked.row < len(part):
            for role, text in (("user", asked.question), ("assistant", asked.answer)):
                events[asked.row].append(_said(role, text, "vqa") | {"camera": columns[asked.camera]})
    return {
        PERSISTENT: _column([steps] * len(part), timed=True),
        EVENTS: _column(events, timed=False),
    }


def _said(role: str, text: str, style: str) -> dict[str, Any]:
    return {"role": role, "content": text, "style": style, "camera": None, "tool_calls": None}


def _column(rows: list[list[dict[str, Any]]], *, timed: bool) -> pa.Array:
    # pyarrow cannot create an array of its JSON type from Python values, but can cast strings to it.
    return pa.array(rows, pa.list_(_entry(pa.string(), timed=timed))).cast(pa.list_(_entry(pa.json_(), timed=timed)))


def _entry(call: pa.DataType, *, timed: bool) -> pa.DataType:
    """Return the Arrow type of one entry in a language column. ``call`` is the type of the entry's tool calls."""
    fields = [pa.field("role", pa.string(), nullable=False)]
    fields += [pa.field("content", pa.string()), pa.field("style", pa.string())]
    fields += [pa.field("timestamp", pa.float32(), nullable=False)] if timed else []
    return pa.struct([*fields, pa.field("camera", pa.string()), pa.field("tool_calls", pa.list_(call))])
