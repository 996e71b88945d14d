"""Questions about the position of the object that a trial's instruction names.

As in :mod:`betterbench.vqa.decisive`, the questions use the frame where the decisive choice began according to the
diagnosis. They ask for a box and for a point, each in two wordings. Unlike the questions of other sets, their answers
are not balanced, because all of them are about one object.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from betterbench.diagnosis import TrialDiagnosis
from betterbench.diagnosis.analysis.episode_analysis import analyze_episode
from betterbench.interface.state import ObjectInfo
from betterbench.records import Record
from betterbench.tasks import Expected, training_distribution_of
from betterbench.vqa.dataset import PhotoSource, finished
from betterbench.vqa.decisive import TIMES_ASKED, WHERE, decisive_rows
from betterbench.vqa.episode import episode_of
from betterbench.vqa.moment import Moment
from betterbench.vqa.phrasings import phrase
from betterbench.vqa.question import Candidate, Question, QuestionDraft, QuestionType, hash_number
from betterbench.vqa.types.grounding import CELLS, grounding


@dataclass(frozen=True, slots=True)
class NamedObject:
    """Object that a trial's instruction names, with questions about its position.

    Attributes:
        name: Name of the object in the scene.
        row: Row of the record.
        questions: Questions that ask for the box of the object and for a point on it, each in :data:`TIMES_ASKED`
            wordings.
        middles: Center of the box of each clearly visible object that can be picked up, by object name. It is given as
            column and row in units of image cells (:data:`~betterbench.vqa.types.grounding.CELLS` per side). Both are 0
            at the top left corner.
    """

    name: str
    row: int
    questions: tuple[Question, ...]
    middles: Mapping[str, tuple[float, float]]


def named_object(
    record: Record, trial: TrialDiagnosis, photos: PhotoSource, *, camera: str = "front", seed: int = 0
) -> NamedObject | None:
    """Return the object that a trial's instruction names, with the questions about its position.

    Args:
        record: Record of the trial.
        trial: Diagnosis of the trial.
        photos: Source of the camera images.
        camera: Camera of the frame.
        seed: Seed for choosing wordings.

    Returns:
        The object and its questions. None if no object must be picked up, if the object is not clearly visible, or if
        another object has the same kind.
    """
    episode = episode_of(record)
    condition = episode.resolved.condition
    if condition.expected is not Expected.SUCCEED:
        return None
    analysis = analyze_episode(episode.trace, condition, training_distribution_of(episode.resolved.task))
    _, row = decisive_rows(episode, analysis, trial)
    moment = Moment(episode, row, photos.photo(record, row, camera).view)
    wanted = [moment.objects[i] for i in analysis.wanted(row)]
    named = next((o for o in wanted if moment.named.get(o.kind) is o), None)
    if named is None:
        return None
    return NamedObject(named.name, row, tuple(_questions(moment, named, seed)), dict(_middles(moment)))


def _middles(moment: Moment) -> Iterator[tuple[str, tuple[float, float]]]:
    step = 2.0 * moment.view.width / CELLS
    for o in moment.objects:
        seen = moment.seen(o.name)
        if seen is not None and moment.is_clear(o.name) and o.role in ("item", "distractor") and not o.fixed:
            left, top, right, bottom = seen.box
            yield o.name, ((left + right) / step, (top + bottom) / step)


def _questions(moment: Moment, named: ObjectInfo, seed: int) -> Iterator[Question]:
    for draft in grounding(moment):
        if draft.objects == (named.name,) and draft.family in ("box of", "point at"):
            yield from _worded(moment, draft, seed)


def _worded(moment: Moment, draft: QuestionDraft, seed: int) -> Iterator[Question]:
    """Yield a question in each of its wordings."""
    candidate = Candidate(
        type=QuestionType.GROUNDING, form=draft.form, family=draft.family, group=draft.group, bucket=draft.bucket or "",
        answer=draft.answer, words=draft.words, objects=draft.objects, source=moment.source, box=draft.box,
        runs=draft.runs,
    )  # fmt: skip
    first = hash_number("wording", candidate.id(seed))
    for number in range(TIMES_ASKED):
        yield finished(
            candidate,
            identifier=f"{candidate.id(seed)}-{WHERE}-{number + 1}",
            text=phrase(candidate, number=first + number),
            options=(),
            size=moment.view.width,
            chance=None,
            role=WHERE,
        )
