"""Pictures in the cells of the diagnostic matrices: the film of a trial if there is one, else the scene at reset."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from betterbench.diagnosis.verdict import TrialDiagnosis
from betterbench.report.figures.film import ACTS, Film, Frame
from betterbench.report.figures.media import Media
from betterbench.report.outcomes import task_of
from betterbench.report.tables.matrices import Cell, Matrix

CellName = tuple[str, str, str, str]
"""Name of the matrix, policy, row and column."""


@dataclass(frozen=True, slots=True)
class ShownFilm:
    """A film on the page: its number, its trial, and whether its twin has frames."""

    number: int
    film: Film
    trial: TrialDiagnosis


@dataclass(frozen=True, slots=True)
class CellPicture:
    """Picture of a cell.

    Attributes:
        frame: The picture: the main frame of a film, or the scene at reset.
        text: Alternative text of the picture.
        film: Number of the film on the page, or None for a scene.
    """

    frame: Frame
    text: str
    film: int | None = None


def cell_pictures(matrices: Iterable[Matrix], films: Sequence[ShownFilm], media: Media) -> dict[CellName, CellPicture]:
    """Return the pictures of all cells that have one.

    A film of the most frequent outcome of the cell is preferred to other films.
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
    """Return the scene of the first condition with an image; a training condition's image belongs to a variation."""
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
