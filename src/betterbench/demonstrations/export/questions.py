"""Questions about frames, made by ``better vqa``, for the language columns of a data set."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from betterbench.demonstrations.export.episodes import FrameQuestion
from betterbench.demonstrations.export.layout import DatasetLayout
from betterbench.demonstrations.export.selection import ChosenTrial
from betterbench.errors import InvalidInputError
from betterbench.tasks import TrialId
from betterbench.vqa.dataset import QuestionSet, read_set


def question_set(path: Path) -> QuestionSet:
    """Read the question set in a folder or in a JSON lines file. Raises the errors of ``read_set``."""
    return read_set(path.parent if path.is_file() else path)


def questions_of(
    asked: QuestionSet, layout: DatasetLayout, demonstrations: Collection[ChosenTrial]
) -> dict[str, tuple[FrameQuestion, ...]]:
    """Return the questions of a set that are about the given records, by SHA-256 of the record.

    Questions about cameras that are not in the layout are left out. Questions about boxes and points are also left out
    if the export resizes or rotates the image, because their coordinates would be wrong. The text of a multiple-choice
    question lists the options with letters below the question.

    Raises InvalidInputError if no question is left.
    """
    found: dict[str, list[FrameQuestion]] = {}
    records: dict[TrialId, list[str]] = {}
    for d in demonstrations:
        if asked.is_about(d.trial, d.digest):
            records.setdefault(d.trial, []).append(d.digest)
    sizes = _plain_sizes(layout)
    shown = {column.camera for column in layout.images}
    for question in asked.questions:
        source = question.source
        about = records.get(source.trial, ())
        if not about or source.camera not in shown:
            continue
        has_pixels = "[" in question.prompt + question.reply
        if has_pixels and sizes.get(source.camera) != (question.width, question.height):
            continue
        said = FrameQuestion(source.row, source.camera, question.prompt, question.reply)
        for record in about:
            found.setdefault(record, []).append(said)
    if not found:
        cure = "Use a set that `better vqa` made from the same run, with the same cameras and image sizes"
        raise InvalidInputError("--vqa", f"{asked.path} contains no questions about frames of these episodes", cure)
    return {record: tuple(sorted(asked, key=lambda q: (q.row, q.camera))) for record, asked in found.items()}


def _plain_sizes(layout: DatasetLayout) -> Mapping[str, tuple[int, int]]:
    """Return the width and height of images that the export neither resizes nor rotates, by camera."""
    rendered = {camera.name: (camera.width, camera.height) for camera in layout.observation.cameras}
    plain = {rule.camera for rule in layout.adapter.views if not (rule.mirror or rule.turn or rule.keep != 1.0)}
    cameras = [c.camera for c in layout.images if (c.width, c.height) == rendered[c.camera]]
    return {camera: rendered[camera] for camera in cameras if camera in plain or "*" in plain}
