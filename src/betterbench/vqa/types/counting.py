"""Questions about numbers of objects: visible objects of a kind or a group, and objects in a container."""

from __future__ import annotations

from collections.abc import Iterator

from betterbench.tasks.relations.inside import INSIDE
from betterbench.vqa.episode import kinds_in_numbers
from betterbench.vqa.moment import Moment
from betterbench.vqa.nouns import definite, plural_of
from betterbench.vqa.question import Form, QuestionDraft

GROUPS = {
    "plates": ("dinner_plate", "place_plate", "serving_plate"),
    "mugs": ("mug",),
    "spice jars": ("spice_jar", "plain_salt_jar", "plain_pepper_jar", "plain_paprika_jar"),
    "pieces of fruit": ("apple", "orange", "lemon"),
    "pieces of cutlery": ("fork", "spoon"),
    "drawers": ("upper_drawer", "lower_drawer"),
}
"""Words that cover several kinds of objects, each with the categories of these objects."""
SIMILAR = {"plates": ("shallow_bowl", "cereal_bowl"), "mugs": ("cup", "tumbler", "drink_cup")}
"""Categories that could be confused with the categories of a word.

A scene with objects of these categories is not used for questions with this word.
"""


def counting(moment: Moment) -> Iterator[QuestionDraft]:
    """Yield questions about numbers of objects, for kinds that occur several times, groups of kinds, and containers."""
    own = [o.kind for o in moment.objects]
    for kind in sorted({*kinds_in_numbers(), *(kind for kind in own if own.count(kind) > 1)}):
        members = [o.name for o in moment.objects if o.kind == kind]
        if members or moment.surely_absent(kind):
            yield from _count(moment, "how many of kind", kind, plural_of(kind), members)
    for word, categories in GROUPS.items():
        members = [o.name for o in moment.objects if o.category in categories]
        if not any(o.category in SIMILAR.get(word, ()) for o in moment.objects):
            yield from _count(moment, "how many of group", word, word, members)
    for kind, target in moment.named.items():
        if INSIDE.regions(target):
            yield from _count_inside(moment, kind, target.name)


def _count(moment: Moment, family: str, key: str, plural: str, members: list[str]) -> Iterator[QuestionDraft]:
    """Yield the question about the number of objects.

    The question is asked only if each object is either clearly visible or completely hidden.
    """
    shown = [name for name in members if moment.is_clear(name)]
    if all(moment.is_clear(name) or moment.is_hidden(name) for name in members):
        tags = () if members else ("absent",)
        yield QuestionDraft(Form.NUMBER, family, (key,), str(len(shown)), {"things": plural}, tuple(shown), tags)


def _count_inside(moment: Moment, kind: str, target: str) -> Iterator[QuestionDraft]:
    """Yield the question about the number of objects in a container.

    The question is not asked if an object in the container is not clearly visible, or if the state is ambiguous.
    """
    inside = []
    for o in moment.objects:
        if o.role not in ("item", "distractor") or o.fixed or o.name == target:
            continue
        try:
            if moment.place(INSIDE, o.name, target) is not None:
                inside.append(o.name)
        except LookupError:
            return
    if all(moment.is_clear(name) for name in inside):
        words = {"target": definite(kind)}
        yield QuestionDraft(Form.NUMBER, "how many inside", (kind,), str(len(inside)), words, (target, *inside))
