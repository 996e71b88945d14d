"""Recorded trial for a viewer: its views row by row, and the time spans of subgoals, grasps and contacts."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from betterbench.jobs.ahead import ahead
from betterbench.records import Record, RunFolder
from betterbench.records.modalities.spec import Modality, ViewSpec
from betterbench.sim.modalities.values import ViewValues
from betterbench.sim.scenes.limited import LimitedView

MOST_CONTACTS = 24
"""Maximum number of body pairs that are shown. Pairs whose contact begins first are preferred."""

_SHOWN: tuple[Modality, ...] = ("rgb", "depth", "instances", "boxes")


@dataclass(frozen=True, slots=True)
class Lane:
    """Lane of a timeline. Each span of the lane has a first row, a last row and a label.

    ``kind`` is "subgoal", "held" or "contact".
    """

    kind: str
    name: str
    spans: tuple[tuple[int, int, str], ...]


def lanes_of(record: Record) -> list[Lane]:
    """Return the lanes of a record: one for each subgoal, one for the held object, and one for each changing contact.

    Contacts that last from the first row to the last, such as those of objects on the table, are left out.
    """
    lanes = [
        Lane("subgoal", name, tuple((a, b, "met") for a, b in _spans(record.subgoals[:, i])))
        for i, name in enumerate(record.metadata.subgoal_names)
    ]
    names = [o.name for o in record.metadata.scene.objects]
    held = [(a, b, name) for i, name in enumerate(names) for a, b in _spans(record.held == i)]
    lanes.append(Lane("held", "held", tuple(sorted(held))))
    touching: dict[tuple[str, str], np.ndarray] = defaultdict(lambda: np.zeros(len(record), bool))
    rows = np.repeat(np.arange(len(record)), np.diff(record.contacts.offsets))
    for row, (a, b) in zip(rows.tolist(), record.contacts.bodies.tolist(), strict=True):
        touching[record.bodies[a], record.bodies[b]][row] = True
    changing = [(pair, _spans(there)) for pair, there in touching.items() if not there.all()]
    changing.sort(key=lambda item: (item[1][0], item[0]))
    for (a, b), spans in changing[:MOST_CONTACTS]:
        lanes.append(Lane("contact", f"{a} – {b}", tuple((first, last, "touch") for first, last in spans)))
    return lanes


def _spans(there: np.ndarray) -> list[tuple[int, int]]:
    """Return the first and the last index of each run of consecutive true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


@dataclass(frozen=True, slots=True)
class ShownRow:
    """One row of a record, as a viewer shows it.

    Attributes:
        time_s: Time of the row [s].
        views: Values of the columns in the modality file of each view.
        focal_px: Focal length of each view [pixel].
        half_sizes_m: Half extents of the 3-D box of each object (objects, 3) [m].
    """

    row: int
    time_s: float
    views: tuple[dict[str, np.ndarray], ...]
    focal_px: tuple[float, ...]
    half_sizes_m: np.ndarray


def shown_rows(run: RunFolder, record: Record, views: Sequence[ViewSpec], *, quality: str) -> Iterator[ShownRow]:
    """Yield every row of a record, rendered in a separate process with memory and time limits.

    Raises RecordError if the scene cannot be opened, and MissingDependencyError if off-screen OpenGL does not work on
    this machine.
    """
    meta = record.metadata
    categories = [o.category for o in meta.scene.objects]
    with LimitedView(quality=quality) as limited:
        limited.open_of(run, record)
        facts, _ = limited.prepare(views, _SHOWN)
        values = [ViewValues(facts, _SHOWN, categories, focal_px) for focal_px in facts.focal_px]
        with ahead(limited.sights(record.qpos, jitter=meta.view_jitter), 4) as taken:
            for row, (sights, time_s) in enumerate(zip(taken, record.time.tolist(), strict=True)):
                shown = tuple(v.of(sight, time_s, None) for v, sight in zip(values, sights, strict=True))
                yield ShownRow(row, time_s, shown, facts.focal_px, facts.boxes[:, 1])
