"""Question sets made by ``better vqa``, used as a benchmark.

The questions are about recorded frames, and their answers are computed from the records.
"""

from __future__ import annotations

from pathlib import Path

from betterbench.vlm.benchmarks.benchmark import Benchmark, DataSource, Headline, missing
from betterbench.vlm.items import AXIS, TRAINING, Detail, Gold, Item, ItemSet
from betterbench.vqa.dataset import SET_NAME, QuestionSet, read_set
from betterbench.vqa.question import Form, Question, letter
from betterbench.vqa.twins import axis_of, static_twins

_LAYOUT = ("a folder written by better vqa",)


def _read(folder: Path) -> ItemSet:
    if not (folder / SET_NAME).is_file():
        raise missing("better-vqa", folder, _LAYOUT)
    return items_of(read_set(folder))


def items_of(asked: QuestionSet) -> ItemSet:
    """Convert a question set to the items of a benchmark.

    The items have the same content hash as the question set, so a model's answers to one can be used for the other.
    """
    reference = {b.name: {"chance": 100 * b.chance, "blind": 100 * b.blind / max(1, b.n)} for b in asked.baselines}
    items = tuple(map(_item, asked.questions))
    twins = static_twins(asked.questions)
    return ItemSet("better-vqa", items, asked.image, reference=reference, content=asked.sha256, twins=twins)


def _item(question: Question) -> Item:
    has_place = question.form in (Form.BOX, Form.POINT)
    source = question.source
    box = None if question.box is None else tuple(map(float, question.box))
    gold = Gold(
        text=None if has_place else _text(question),
        box=box if question.form is Form.BOX else None,
        runs=question.runs if question.form is Form.POINT else None,
    )
    return Item(
        id=question.id,
        form=question.form,
        question=question.text,
        gold=gold,
        pictures=(question.image,),
        cluster=f"{source.task}/{source.condition}/{source.seed}",
        options=question.options,
        groups={
            "type": question.type.value,
            "difficulty": question.difficulty.value,
            AXIS: axis_of(source.task, source.condition) or TRAINING,
            "family": question.family,
        },
        width=question.width if has_place else 0,
        height=question.height if has_place else 0,
        detail=_detail(question),
        chance=question.chance,
    )


def _detail(question: Question) -> Detail | None:
    smallest = question.smallest
    return None if smallest is None else Detail(*smallest, (question.width, question.height))


def _text(question: Question) -> str:
    return letter(question.options.index(question.answer)) if question.options else question.answer


BETTER_VQA = Benchmark(
    name="better-vqa",
    title="better vqa",
    read=_read,
    source=DataSource(
        repository="",
        files=(),
        license="as betterbench",
        terms="Needs no download: better vlm makes a set when no --data is given.",
        layout=_LAYOUT,
    ),
    headline=Headline(),
    groups=("type", "difficulty", AXIS, "family"),
    coordinates="pixels",
)
"""Questions of eight types, each tagged with its difficulty. They are balanced so that guessing without the image does
not help."""
