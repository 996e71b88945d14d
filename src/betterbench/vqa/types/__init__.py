"""Question types, one per file.

Each file generates questions about a moment. The answers follow from the recorded state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from betterbench.interface.state import Box
from betterbench.vqa.moment import Moment
from betterbench.vqa.question import Candidate, QuestionDraft, QuestionType
from betterbench.vqa.types.containment import containment
from betterbench.vqa.types.counting import counting
from betterbench.vqa.types.execution import execution
from betterbench.vqa.types.grounding import grounding
from betterbench.vqa.types.premise import premise
from betterbench.vqa.types.relation import spatial_relation
from betterbench.vqa.types.stacking import stacking
from betterbench.vqa.types.state import object_state

QuestionMaker = Callable[[Moment], Iterator[QuestionDraft]]

GENERATORS: dict[QuestionType, QuestionMaker] = {
    QuestionType.GROUNDING: grounding,
    QuestionType.COUNTING: counting,
    QuestionType.RELATION: spatial_relation,
    QuestionType.CONTAINMENT: containment,
    QuestionType.STACKING: stacking,
    QuestionType.STATE: object_state,
    QuestionType.EXECUTION: execution,
    QuestionType.PREMISE: premise,
}
"""Generator of the questions of each type."""


def candidates_of(moment: Moment, types: tuple[QuestionType, ...] = tuple(QuestionType)) -> Iterator[Candidate]:
    """Yield all possible questions about a moment."""
    for kind in types:
        for draft in GENERATORS[kind](moment):
            yield Candidate(
                type=kind, form=draft.form, family=draft.family, group=draft.group,
                bucket=draft.answer if draft.bucket is None else draft.bucket, answer=draft.answer, words=draft.words,
                objects=draft.objects, source=moment.source, tags=(*draft.tags, *_tags(moment, draft)), box=draft.box,
                runs=draft.runs, boxes=tuple(_boxes(moment, draft)),
            )  # fmt: skip


def _boxes(moment: Moment, draft: QuestionDraft) -> Iterator[Box | None]:
    """Return the box around the visible part of each object that a question is about."""
    for name in draft.objects:
        seen = moment.seen(name)
        yield None if seen is None else seen.box


def _tags(moment: Moment, draft: QuestionDraft) -> Iterator[str]:
    """Yield the tags of a question that depend on its objects: out of place, small, partly hidden."""
    info = moment.episode.trace.info
    if any(moment.episode.out_of_place(info.index(name)) for name in draft.objects if name in info):
        yield "out of place"
    seen = [s for name in draft.objects if (s := moment.seen(name)) is not None]
    if any(s.side < 16 for s in seen):
        yield "small"
    if any(s.fraction < 0.7 for s in seen):
        yield "partly hidden"
