"""Names and texts of a user's task that no table, scene or terminal can show are refused with the field and a cure."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from tests.looping import each

from betterbench.errors import UNPRINTABLE, InvalidInputError
from betterbench.tasks import Condition, Slot
from betterbench.tasks.authoring.readable import LONGEST_TEXT, require_readable
from betterbench.tasks.authoring.registry import all_tasks, get_task
from betterbench.tasks.authoring.task import Task

TASK = get_task("breakfast_table")


def slot(word: str) -> Task:
    first, *others = TASK.slots
    return replace(TASK, slots=(replace(first, name=first.name + word), *others))


def in_training(change) -> Task:
    first, *others = TASK.training
    return replace(TASK, training=(change(first), *others))


def thing(word: str, field: str = "name") -> Task:
    def change(condition: Condition) -> Condition:
        first, *others = condition.objects
        return condition.with_(objects=(replace(first, **{field: getattr(first, field) + word}), *others))

    return in_training(change)


def instruction(word: str) -> Task:
    return in_training(lambda c: c.with_(instruction=replace(c.instruction, text=c.instruction.text + word)))


def subgoal(word: str) -> Task:
    def change(condition: Condition) -> Condition:
        first, *others = condition.instruction.subgoals
        changed = replace(first, name=first.name + word)
        return condition.with_(instruction=replace(condition.instruction, subgoals=(changed, *others)))

    return in_training(change)


def variation(word: str, field: str = "name") -> Task:
    first, *others = TASK.variations
    return replace(TASK, variations=(replace(first, **{field: getattr(first, field) + word}), *others))


NAMES = [
    (slot, "slots[0].name"),
    (thing, "training[0].objects[0].name"),
    (subgoal, "training[0].instruction.subgoals[0].name"),
    (variation, "variations[0].name"),
    (lambda word: replace(TASK, id=TASK.id + word), "id"),
]
TEXTS = [
    (lambda word: thing(word, "kind"), "training[0].objects[0].kind"),
    (instruction, "training[0].instruction.text"),
    (lambda word: variation(word, "title"), "variations[0].title"),
    (lambda word: variation(word, "hypothesis"), "variations[0].hypothesis"),
    (lambda word: replace(TASK, title=TASK.title + word), "title"),
]
STEERING = ["\x1b[2J", "\x9b2J", "\u202egnp", "\ud800", "\0", "\u2066", "\U000e0041"]


@each("change, where", NAMES)
@each("word", [*STEERING, "/../../x", "'; touch x #", "<b>", '"/>', "\n", "x" * 101])
def test_names(change, where, word):
    with pytest.raises(InvalidInputError, match="cannot be a name") as caught:
        require_readable(change(word))
    assert f": {where}: " in str(caught.value)
    assert not UNPRINTABLE.search(str(caught.value))
    require_readable(change("_2 é-x.1"))


@each("change, where", TEXTS)
@each("word", STEERING)
def test_texts(change, where, word):
    with pytest.raises(InvalidInputError, match="unprintable character") as caught:
        require_readable(change(word))
    assert f": {where}: " in str(caught.value)
    assert not UNPRINTABLE.search(str(caught.value))
    with pytest.raises(InvalidInputError, match=re.escape(f"{where}: has ")):
        require_readable(change("x" * (LONGEST_TEXT + 1)))
    require_readable(change(" <b> & $x 机器人 \N{ROBOT FACE}"))


def test_tasks_of_the_suite_pass():
    for task in all_tasks():
        require_readable(task)


def test_a_name_in_an_operation_of_a_variation_is_checked():
    first, *others = TASK.variations
    moved = replace(first.interventions[0])
    found = replace(first, interventions=(moved, (Slot("x\x1b", 0.5, 0.0),)))
    with pytest.raises(InvalidInputError, match=r"variations\[0\].interventions\[1\]\[0\].name"):
        require_readable(replace(TASK, variations=(found, *others)))
