"""Questions about premises: the objects that are present, the object in a slot, and whether a task can be done."""

from __future__ import annotations

from collections.abc import Iterator

from betterbench.vqa.moment import Moment
from betterbench.vqa.nouns import indefinite
from betterbench.vqa.question import Form, QuestionDraft
from betterbench.vqa.types.grounding import COARSE_CELLS, cell_of, written
from betterbench.vqa.types.relation import yes


def premise(moment: Moment) -> Iterator[QuestionDraft]:
    """Yield questions about the kinds that are present, the kind of each object, and whether the task can be done."""
    for kind in (*moment.episode.vocabulary, *moment.episode.foreign):
        words = {"thing": indefinite(kind)}
        members = [o.name for o in moment.objects if o.kind == kind]
        if any(moment.is_clear(name) for name in members):
            yield QuestionDraft(Form.YES_NO, "is it there", (kind,), yes(True), words, tuple(members))
        elif moment.surely_absent(kind):
            yield QuestionDraft(Form.YES_NO, "is it there", (kind,), yes(False), words, (), _absent(moment, kind))
    yield from _is_a(moment)
    yield from _can_be_done(moment)


def _absent(moment: Moment, kind: str) -> tuple[str, ...]:
    """Return the tags of a question about a kind of object that the scene does not contain.

    The question is harder if another object is in the usual slot of this kind.
    """
    tags = ["absent"]
    if kind in moment.episode.vocabulary:
        tags.append("of this task")
    if moment.episode.replaced(kind):
        tags.append("look-alike")
    return tuple(tags)


def _is_a(moment: Moment) -> Iterator[QuestionDraft]:
    """Yield questions about whether the object in a box is of a certain kind.

    They ask about the object's own kind, and about the kinds that stood in the object's slot in training.
    """
    info = moment.state.info
    for kind, o in moment.things.items():
        usual = info.slot(o.slot).trained_kinds if o.slot is not None else ()
        seen = moment.view.objects[o.name]
        cell = cell_of(seen, moment.view.width, COARSE_CELLS)
        for asked in dict.fromkeys((kind, *usual)):
            tags = () if asked == kind else ("look-alike",)
            words = {"box": written(seen.box), "thing": indefinite(asked)}
            group = (asked, cell)
            yield QuestionDraft(Form.YES_NO, "is it a", group, yes(asked == kind), words, (o.name,), tags, box=seen.box)


def _can_be_done(moment: Moment) -> Iterator[QuestionDraft]:
    """Yield the question of whether all objects of the instruction are present."""
    goals, trace = moment.condition.instruction.subgoals, moment.episode.trace
    names = [trace.info.objects[i].name for meant in trace.meant for i in meant]
    targets = [trace.info.objects[i].name for i in trace.targets]
    if not goals or not all(moment.is_clear(name) for name in (*names, *targets)):
        return
    there = all(len(trace.meant[g]) >= goal.count for g, goal in enumerate(goals))
    if not there and not all(moment.is_clear(o.name) for o in moment.objects if o.role in ("item", "distractor")):
        return
    text = moment.condition.instruction.text
    words = {"instruction": text}
    tags = () if there else ("absent", "look-alike")
    yield QuestionDraft(
        Form.YES_NO, "can it be done", (text,), yes(there), words, tuple(dict.fromkeys((*names, *targets))), tags
    )
