"""Questions about containment: objects in a container, in a hole or on a ring, and the container of an object."""

from __future__ import annotations

from collections.abc import Iterator

from betterbench.interface.state import ObjectInfo
from betterbench.tasks.relations import Relation
from betterbench.vqa.moment import Moment
from betterbench.vqa.nouns import definite
from betterbench.vqa.question import Form, QuestionDraft
from betterbench.vqa.types.relation import yes

IN_WORDS = {"inside": "in", "in_hole": "in a hole of", "on_ring": "on the ring of"}
"""Relations that are treated as containment, each with its wording."""

IN_GRIPPER, ON_TABLE = "in the gripper", "on the table"


def containment(moment: Moment) -> Iterator[QuestionDraft]:
    """Yield questions about the objects in a target, and about the location of an object."""
    for kind, target in moment.named.items():
        for relation in moment.relations_of(target):
            if relation.name in IN_WORDS:
                yield from _with_target(moment, relation, kind, target)


def _with_target(moment: Moment, relation: Relation, kind: str, target: ObjectInfo) -> Iterator[QuestionDraft]:
    where = f"{IN_WORDS[relation.name]} {definite(kind)}"
    held: list[str] = []
    doubtful = False
    for o in moment.objects:
        if o.role not in relation.roles or o.fixed or o.name == target.name:
            continue
        try:
            inside = moment.place(relation, o.name, target.name) is not None
        except LookupError:
            doubtful = True
            continue
        if inside:
            held.append(o.name)
        if o.kind in moment.things:
            names, words = (o.name, target.name), {"a": definite(o.kind), "where": where}
            yield QuestionDraft(Form.YES_NO, "is it in", (o.kind, where), yes(inside), words, names)
            place = where if inside else IN_GRIPPER if moment.state.held == o.name else _on_table(moment, o.name)
            if place is not None:
                yield QuestionDraft(Form.CHOICE, "where is it", (o.kind, where), place, {"a": definite(o.kind)}, names)
    if doubtful or len(held) > 1 or not all(moment.is_clear(name) for name in held):
        return
    items = sorted(o.kind for o in moment.objects if o.role == "item" and o.kind in moment.single)
    answer = moment.state.info.object(held[0]).kind if held else "nothing"
    if answer in (*items, "nothing"):
        yield QuestionDraft(
            Form.CHOICE, "what is in", (where, *items), answer, {"where": where}, (target.name, *held)
        )  # fmt: skip


def _on_table(moment: Moment, name: str) -> str | None:
    return ON_TABLE if moment.state.touching(name, "table") else None
