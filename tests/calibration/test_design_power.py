"""What the suite's design leaves to policies that replay, follow one word, or do not listen; no motion is simulated."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from dataclasses import replace

import pytest
from tests.calibration.ideal import start, walk, walk_by
from tests.looping import each

from betterbench.calibration.chance import chance_of
from betterbench.policies.decisions import ExpertRule, Situation
from betterbench.policies.faulty.blind import possible_instructions
from betterbench.tasks import Condition, Expected, get_task, suite_tasks
from betterbench.tasks.interventions import vary
from betterbench.tasks.relations import RELATIONS

VARIATIONS = [(task, v.name) for task in suite_tasks("better60") for v in get_task(task).variations]
LOOKING_AT_WHAT_IS_DONE = [
    *(("fruit_lunch", "T1"), ("cheeseburger", "T1"), ("cheeseburger", "T2"), ("dinner_plates", "T2")),
]
"""The variations that a replay of their own seed's demonstration solved, because nothing else had moved."""
EITHER_BURGER = ("fast_food", "O1")
"""The one variation that some demonstrations solve: those that take the second burger, which stays in its slot."""
MOST_BY_WORD, MOST_WITHOUT_LANGUAGE = 20, 8

Step = tuple[str, str, str, str, str]
"""What is brought, or the slot that it is picked from; relation, target, region, and the slot of the target."""

each_variation = each("task, name", VARIATIONS)


def stands_in(condition: Condition, name: str, moved: dict[str, str]) -> str:
    """The slot above which an object stands, given what was put on what."""
    while name not in condition.layout or name in moved:
        mount = condition.object(name).mount
        name = moved.get(name) or (mount.target if mount else condition.preplaced[name].target)
    return condition.layout[name]


def demonstrated(condition: Condition) -> Iterator[list[Step]]:
    """Every way in which an expert may bring things, by the slots that they are picked from."""
    goals = [g for g in condition.instruction.subgoals if RELATIONS[g.relation].carried]
    for names in itertools.product(*(condition.resolve(g.reference) for g in goals)):
        if len(set(names)) < len(names):
            continue
        moved: dict[str, str] = {}
        steps: list[Step] = []
        for g, name in zip(goals, names, strict=True):
            at = stands_in(condition, g.target, moved)
            steps.append((condition.layout[name], g.relation, condition.object(g.target).kind, g.region, at))
            moved[name] = g.target
        yield steps


def brought(condition: Condition, motions: list[Step]) -> list[Step]:
    """What the same motions bring in another scene; where nothing stands nothing is brought."""
    found = ((condition.occupant(slot), rest) for slot, *rest in motions)
    return [(condition.object(name).kind, *rest) for name, rest in found if name is not None]


def wanted(condition: Condition) -> Iterator[list[Step]]:
    """What has to be brought, without what lies there already, in every valid order."""
    moved: dict[str, str] = {}
    steps: list[Step] = []
    for g in condition.instruction.subgoals:
        if not RELATIONS[g.relation].carried:
            continue
        names = condition.resolve(g.reference)
        at = stands_in(condition, g.target, moved)
        moved.update(dict.fromkeys(names, g.target))
        if not any(n in condition.preplaced for n in names):
            kind, target = (condition.object(n).kind for n in (names[0], g.target))
            steps.append((kind, g.relation, target, g.region, at))
    return iter([steps]) if condition.instruction.ordered else map(list, itertools.permutations(steps))


def solved_by_replaying(train: Condition, test: Condition) -> bool:
    if test.expected is not Expected.SUCCEED:
        return False
    right = list(wanted(test))
    return any(brought(test, motions) in right for motions in demonstrated(train))


@each_variation
def test_one_variation_alone_is_solved_by_replaying_the_demonstration_it_is_derived_from(task, name):
    variation = get_task(task).variation(name)
    condition, _ = vary(get_task(task), variation)
    assert solved_by_replaying(get_task(task).train(variation.base), condition) == ((task, name) == EITHER_BURGER)


@pytest.mark.parametrize(("task", "name"), LOOKING_AT_WHAT_IS_DONE)
def test_no_demonstration_of_the_task_solves_what_is_begun_already(task, name):
    condition, _ = vary(get_task(task), get_task(task).variation(name))
    assert not [c.name for c in get_task(task).training if solved_by_replaying(c, condition)]


def test_a_replay_is_told_from_what_has_to_be_done():
    task = get_task("fast_food")
    train = task.train("train1")
    assert solved_by_replaying(train, train)
    assert solved_by_replaying(train, train.with_(objects=train.objects[::-1]))
    assert not solved_by_replaying(train, task.train("train2"))


@functools.cache
def share_without_language(task: str, name: str) -> float:
    """Share of the instructions that make sense in a scene whose right execution counts as success."""
    _, condition, _ = start(task, name)
    situation = Situation(get_task(task), condition, 0)
    heard = possible_instructions(situation)
    rules = (ExpertRule(replace(situation, condition=condition.with_(instruction=i))) for i in heard)
    return sum(walk_by(rule, task, name, stop=True).success for rule in rules) / len(heard)


@pytest.mark.physics
def test_one_word_is_not_enough_in_two_thirds_of_the_variations():
    solved = [key for key in VARIATIONS if walk("zoo:lexical", *key).success]
    assert len(solved) <= MOST_BY_WORD, solved


@pytest.mark.physics
def test_few_variations_are_solved_without_language_more_often_than_not():
    solved = [key for key in VARIATIONS if share_without_language(*key) > 0.5]
    assert len(solved) <= MOST_WITHOUT_LANGUAGE, solved


@pytest.mark.physics
@each_variation
def test_the_chance_of_guessing_is_the_share_of_instructions_that_lead_to_success(task, name):
    """A step that is done at the start is none to guess, and whoever finished on the way has succeeded."""
    if get_task(task).variation(name).expected is Expected.SUCCEED:
        assert chance_of(task, name) == pytest.approx(share_without_language(task, name))


@pytest.mark.physics
def test_color_does_not_tell_jars_apart_that_only_their_labels_should():
    _, condition, _ = start("seasoning_rack", "O2")
    assert {o.color for o in condition.objects if o.role == "item"} == {"gray"}
    assert walk("expert", "seasoning_rack", "O2").success
    by_color = walk("zoo:color", "seasoning_rack", "O2")
    assert getattr(by_color.decisions[0], "object", None) == "plain_pepper", "what stands in the salt's slot"
    assert by_color.truth is not None
    assert not any(color in condition.instruction.text for color in ("white", "black", "red"))
