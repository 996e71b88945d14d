"""Trial player: a page with the video, masks, boxes, subgoals and contacts of one trial on a common timeline."""

from __future__ import annotations

import base64
import hashlib
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from betterbench.errors import InvalidInputError
from betterbench.ordinary_file import open_ordinary
from betterbench.quoting import script_json
from betterbench.report.html import asset, environment, write

_HEAD_BYTES = 1 << 18
_MARKS = (b'<main class="player">', b'<script type="application/json" id="data">')
"""Markers by which a player page is recognized. They occur near the beginning and after the style sheet."""


@dataclass(frozen=True, slots=True)
class PlayedView:
    """View of one camera: for each frame an image (JPEG), a mask (PNG, transparent outside the objects), and boxes.

    A box consists of the index of the object in :attr:`PlayedTrial.objects`, the left, top, right and bottom edge
    [pixel], and the visible fraction of the object.
    """

    name: str
    width: int
    height: int
    pictures: Sequence[bytes]
    masks: Sequence[bytes]
    boxes: Sequence[Sequence[tuple[int, int, int, int, int, float]]]


@dataclass(frozen=True, slots=True)
class PlayedLane:
    """Row of the timeline: intervals of frames (first and last frame), each with a text."""

    kind: str
    name: str
    spans: Sequence[tuple[int, int, str]]


@dataclass(frozen=True, slots=True)
class PlayedTrial:
    """Content of the player for one trial.

    Attributes:
        heading: Trial name ("fast_food/T1/3").
        policy: Name of the policy.
        instruction: Instruction of the trial.
        ended: Outcome of the trial as text.
        times_s: Time of each frame [s].
        objects: Name of each object, with its color as (red, green, blue).
        views: Views of the cameras.
        lanes: Rows of the timeline.
    """

    heading: str
    policy: str
    instruction: str
    ended: str
    times_s: Sequence[float]
    objects: Sequence[tuple[str, tuple[int, int, int]]]
    views: Sequence[PlayedView]
    lanes: Sequence[PlayedLane]


def write_player(trial: PlayedTrial, path: Path) -> Path:
    """Write the player page of a trial, and return its path. The page is self-contained and works offline.

    Raises:
        InvalidInputError: If a view does not have one frame for each time.
    """
    frames = len(trial.times_s)
    for view in trial.views:
        if not frames == len(view.pictures) == len(view.masks) == len(view.boxes):
            raise InvalidInputError(
                f"view {view.name}", f"the view does not have {frames} frames", "Provide one frame for each time"
            )
    script = asset("player.js")
    page = (
        environment()
        .get_template("player.html.jinja")
        .render(
            trial=trial,
            style=Markup(asset("page.css") + asset("player.css")),  # noqa: S704 - our own files
            script=Markup(script),  # noqa: S704 - our own file
            script_hash=b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii"),
            data=Markup(_data(trial)),  # noqa: S704 - made safe for a script element
        )
    )
    return write(path, page)


def is_player(path: Path) -> bool:
    """Return whether a file is a player page that :func:`write_player` wrote in this or an earlier version."""
    with open_ordinary(path) as file:
        head = file.read(_HEAD_BYTES)
    return head.startswith(b"<!doctype html>") and all(mark in head for mark in _MARKS)


def _data(trial: PlayedTrial) -> str:
    """Return the data for the page's script as JSON that is safe inside a script element."""
    form = {
        "times": [round(time_s, 4) for time_s in trial.times_s],
        "objects": [{"name": name, "color": list(color)} for name, color in trial.objects],
        "views": [
            {
                "name": view.name,
                "width": view.width,
                "height": view.height,
                "pictures": [base64.b64encode(picture).decode("ascii") for picture in view.pictures],
                "masks": [base64.b64encode(mask).decode("ascii") for mask in view.masks],
                "boxes": [[[*box[:5], round(box[5], 3)] for box in boxes] for boxes in view.boxes],
            }
            for view in trial.views
        ],
        "lanes": [
            {"kind": lane.kind, "name": lane.name, "spans": [list(s) for s in lane.spans]} for lane in trial.lanes
        ],
    }
    return script_json(form)
