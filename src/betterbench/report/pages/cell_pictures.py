"""Pictures in the cells of the diagnostic matrices. A picture is a frame of a film strip, or else the initial scene."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from betterbench.diagnosis.verdict import TrialDiagnosis
from betterbench.report.figures.film import ACTS, Film, Frame
from betterbench.report.figures.media import Media
from betterbench.report.outcomes import task_of
from betterbench.report.tables.matrices import Cell, Matrix

CellName = tuple[str, str, str, str]
"""Name of the matrix, name of the policy, row, and column."""


@dataclass(frozen=True, slots=True)
class ShownFilm:
    """Film strip on the page, with its index and its trial."""

    number: int
    film: Film
    trial: TrialDiagnosis


@dataclass(frozen=True, slots=True)
class CellPicture:
    """Picture in a cell of a diagnostic matrix.

    Attributes:
        frame: Image that is shown: the main frame of a film strip, or the initial scene.
        text: Alternative text of the picture.
        film: Index of the film strip on the page; None for a scene.
    """

    frame: Frame
    text: str
    film: int | None = None


def cell_pictures(matrices: Iterable[Matrix], films: Sequence[ShownFilm], media: Media) -> dict[CellName, CellPicture]:
    """Return the pictures of the cells. A cell has no picture if there is neither a film strip nor a scene for it.

    A film strip with the most frequent outcome in the cell is preferred to other film strips.
    """
    found = {}
    for matrix in matrices:
        for cell in (cell for row in matrix.cells for cell in row if not cell.empty):
            picture = _filmed(matrix.policy, cell, films) or _scene(cell, media)
            if picture is not None:
                found[matrix.name, matrix.policy, cell.row.value, cell.column.value] = picture
    return found


def _filmed(policy: str, cell: Cell, films: Sequence[ShownFilm]) -> CellPicture | None:
    sources = {source.id for source in cell.sources}
    mine = [s for s in films if s.film.policy == policy and f"{s.trial.task}/{s.trial.pool}" in sources]
    if not mine:
        return None
    shown = next((s for s in mine if s.trial.label is cell.labels[0][0]), mine[0])
    frames = shown.film.frames
    main = next((frame for frame in frames if frame.caption in ACTS), frames[-1])
    return CellPicture(main, f"{shown.trial.key}, {main.time_s:.1f} s", shown.number)


def _scene(cell: Cell, media: Media) -> CellPicture | None:
    """Return the initial scene of the first condition that has an image.

    The image of a training condition is stored with one of the variations that are derived from this condition.
    """
    for source in cell.sources:
        images = media.thumbnails.get(source.id)
        if images is not None:
            return CellPicture(Frame(0.0, images.test), f"scene of {source.id}")
        task_name, _, name = source.id.partition("/")
        task = task_of(task_name)
        for variation in () if task is None else task.variations:
            images = media.thumbnails.get(f"{task_name}/{variation.name}") if variation.base == name else None
            if images is not None and images.training is not None:
                return CellPicture(Frame(0.0, images.training), f"scene of {source.id}")
    return None
