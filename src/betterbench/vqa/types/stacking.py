"""Questions about stacking: the object on top of another one, the higher of two objects, and the order of a stack."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from betterbench.interface.state import ObjectInfo
from betterbench.tasks.relations.layer import LAYER
from betterbench.tasks.relations.on_plate import ON_PLATE
from betterbench.vqa.moment import Moment
from betterbench.vqa.nouns import definite
from betterbench.vqa.question import Form, QuestionDraft
from betterbench.vqa.types.relation import yes
from betterbench.wording import listed

HIGHER_M = 0.008
"""Minimum difference in height for "higher" [m]. Layers are at least 10 mm thick."""


def stacking(moment: Moment) -> Iterator[QuestionDraft]:
    """Yield questions about the objects on each base or plate, and about the order of objects in stacks."""
    stacked: set[str] = set()
    for base in _bases(moment):
        try:
            stack = _stack(moment, base)
        except LookupError:
            continue
        stacked |= set(stack)
        shown = base.kind in moment.single and moment.is_large(base.name)
        if shown and all(moment.is_large(name) for name in stack[:1]):
            yield from _directly_on(moment, base, stack)
        if shown:
            yield from _order(moment, base, stack)
    yield from _higher(moment, frozenset(stacked))


def _bases(moment: Moment) -> list[ObjectInfo]:
    """Return the objects on which others can be stacked: the bases of layered stacks, and all plates."""
    return [o for o in moment.objects if LAYER.regions(o) or (ON_PLATE.regions(o) and o.role == "item")]


def _stack(moment: Moment, base: ObjectInfo) -> list[str]:
    """Return the objects on a base, from the bottom up.

    Raises:
        LookupError: If the state does not determine whether an object is on the base.
    """
    others = [
        o.name for o in moment.objects if o.role in ("item", "distractor") and o.name != base.name and not o.fixed
    ]
    if LAYER.regions(base):
        layers = {name: moment.place(LAYER, name, base.name) for name in others}
        return sorted((n for n, layer in layers.items() if layer is not None), key=lambda n: int(layers[n] or 0))
    found = [base.name]
    while True:
        above = [n for n in others if n not in found and ON_PLATE.where(moment.state, n, found[-1]) is not None]
        loose = [n for n in others if n not in found and ON_PLATE.anyhow(moment.state, n, found[-1]) is not None]
        if len(above) > 1 or (moment.state.held in loose) or (loose and not above):
            raise LookupError(base.name)
        if not above:
            return found[1:]
        found.append(above[0])


def _directly_on(moment: Moment, base: ObjectInfo, stack: list[str]) -> Iterator[QuestionDraft]:
    info = moment.state.info
    items = sorted(k for k, o in moment.single.items() if o.role == "item" and o.name != base.name)
    on_it = info.object(stack[0]).kind if stack else "nothing"
    names = (base.name, *stack[:1])
    if on_it in (*items, "nothing"):
        words = {"base": definite(base.kind)}
        yield QuestionDraft(Form.CHOICE, "what is on", (base.kind, *items), on_it, words, names)
    for kind in items:
        if moment.is_large(moment.single[kind].name):
            words = {"a": definite(kind), "base": definite(base.kind)}
            pair = (moment.single[kind].name, base.name)
            yield QuestionDraft(Form.YES_NO, "is it on", (kind, base.kind), yes(kind == on_it), words, pair)


def _order(moment: Moment, base: ObjectInfo, stack: list[str]) -> Iterator[QuestionDraft]:
    """Yield the question about the order of two or more objects on a base.

    All of them must be visible, and no other object in the scene may have the same kind.
    """
    kinds = [moment.state.info.object(name).kind for name in stack]
    if len(stack) >= 2 and all(k in moment.single and moment.is_large(moment.single[k].name) for k in kinds):
        words = {"base": definite(base.kind), "things": listed([definite(k) for k in sorted(kinds)])}
        answer = ", ".join(kinds)
        group = (base.kind, *sorted(kinds))
        yield QuestionDraft(Form.CHOICE, "order", group, answer, words, (base.name, *stack), ("several steps",))


def _higher(moment: Moment, stacked: frozenset[str]) -> Iterator[QuestionDraft]:
    """Yield the question of which of two objects has the higher center, if at least one of them is on a stack."""
    for (a, first), (b, second) in itertools.combinations(moment.things.items(), 2):
        if {first.name, second.name} & stacked and moment.state.held not in (first.name, second.name):
            up, down = (moment.center(o.name)[2] for o in (first, second))
            if abs(up - down) >= HIGHER_M:
                words = {"a": definite(a), "b": definite(b)}
                answer = a if up > down else b
                yield QuestionDraft(Form.CHOICE, "higher", (a, b), answer, words, (first.name, second.name))
