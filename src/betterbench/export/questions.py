"""Questions about frames, as ``better vqa`` writes them, for the language columns of a data set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter

from betterbench.errors import InvalidInputError
from betterbench.export.episodes import FrameQuestion
from betterbench.export.layout import DatasetLayout
from betterbench.json_form import open_form, read_bounded, read_form
from betterbench.tasks import TrialId

MAX_BYTES = 1 << 30
"""Largest file of questions that is read."""

_GROUNDED = ("box", "point")
_CURE = "Give the lines of questions that better vqa wrote"


@open_form
@dataclass(frozen=True, slots=True)
class _Source:
    task: str
    condition: str
    seed: Annotated[int, Field(ge=0)]
    row: Annotated[int, Field(ge=0)]
    camera: str


@open_form
@dataclass(frozen=True, slots=True)
class _Line:
    source: _Source
    text: str
    answer: str
    options: tuple[str, ...] = ()
    form: str = ""
    width: int = 0
    height: int = 0


_LINE = TypeAdapter(_Line)


def read_questions(path: Path, layout: DatasetLayout) -> dict[TrialId, tuple[FrameQuestion, ...]]:
    """Return the questions of a file of JSON lines by trial; those about cameras that are not shown are left out.

    So are boxes and points in pixels of an image that is not shown as it was rendered. Options of a choice are listed
    with letters below the text.

    Raises:
        InvalidInputError: If the file cannot be read, or a line is none.
    """
    found: dict[TrialId, list[FrameQuestion]] = {}
    sizes = _plain_sizes(layout)
    shown = {column.camera for column in layout.images}
    for number, text in enumerate(read_bounded(path, max_bytes=MAX_BYTES, cure=_CURE).splitlines()):
        line = read_form(_LINE, text, where=f"{path}, line {number + 1}", cure=_CURE)
        source = line.source
        if source.camera not in shown:
            continue
        if line.form in _GROUNDED and sizes.get(source.camera) != (line.width, line.height):
            continue
        trial = TrialId(source.task, source.condition, source.seed)
        found.setdefault(trial, []).append(FrameQuestion(source.row, source.camera, *_worded(line, path, number)))
    return {trial: tuple(sorted(asked, key=lambda q: (q.row, q.camera))) for trial, asked in found.items()}


def _worded(line: _Line, path: Path, number: int) -> tuple[str, str]:
    """Return question and answer as they are said."""
    if not line.options:
        return line.text, line.answer
    if line.answer not in line.options:
        raise InvalidInputError(f"{path}, line {number + 1}: answer", f"{line.answer!r} is none of the options", _CURE)
    letters = [chr(ord("A") + i) for i in range(len(line.options))]
    listed = "\n".join(f"{a}. {option}" for a, option in zip(letters, line.options, strict=True))
    return f"{line.text}\n{listed}", f"{letters[line.options.index(line.answer)]}. {line.answer}"


def _plain_sizes(layout: DatasetLayout) -> Mapping[str, tuple[int, int]]:
    """Return the sizes of the images that are shown as they were rendered, by camera."""
    rendered = {camera.name: (camera.width, camera.height) for camera in layout.observation.cameras}
    plain = {rule.camera for rule in layout.adapter.views if not (rule.mirror or rule.turn or rule.keep != 1.0)}
    cameras: Sequence[str] = [c.camera for c in layout.images if (c.width, c.height) == rendered[c.camera]]
    return {camera: rendered[camera] for camera in cameras if camera in plain or "*" in plain}
