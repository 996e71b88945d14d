"""Patterns: the suite's tasks are instances, unfit objects are refused, and variations change the solution."""

from __future__ import annotations

import functools
from dataclasses import replace

import pytest
from tests.generation.casting import CASTS, SUITE, desk, jars, mugs, spice
from tests.looping import each

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.generation.patterns import PATTERNS, pattern_of
from betterbench.tasks import Expected, TrainingDistribution, get_task, task_from_json, task_to_json
from betterbench.tasks import authoring as a
from betterbench.tasks.authoring.no_test import require_no_test
from betterbench.tasks.authoring.regimes import named_regimes
from betterbench.tasks.authoring.training_distribution import pairing, training_distribution_of
from betterbench.tasks.interventions import vary
from betterbench.tasks.interventions.balanced import balanced_conditions


def made(cast):
    """Return what the pattern of a cast makes."""
    return pattern_of(cast.scenario.template)(cast)


@functools.cache
def made_of(name):
    """Return what the pattern makes of the cast with this name."""
    return made(CASTS[name])


@functools.cache
def registered(cast, name="made"):
    """Return the task of a cast with the names that the registry gives, and with its balanced regime."""
    found = made_of(cast)
    training = tuple(c.with_(task=name, name=f"train{i}") for i, c in enumerate(found.task.training, start=1))
    regimes = named_regimes({"balanced": a.ListedRegime(found.balanced, found.crossed, found.aside)}, name)
    return replace(found.task, id=name, training=training, regimes=regimes)


def anonymous(conditions):
    return [condition.with_(task="", name="") for condition in conditions]


@each("name", SUITE, str)
def test_a_task_of_the_suite_is_an_instance_of_its_pattern(name):
    found, task = made_of(name), get_task(name)
    assert list(found.task.training) == anonymous(task.training)
    assert list(found.balanced) == anonymous(balanced_conditions(name))
    assert found.task.slots == task.slots
    mine = {v.name: v for v in found.task.variations}
    for variation in task.variations:
        same = mine[variation.name]
        assert same.interventions == variation.interventions
        assert (same.base, same.expected, same.support) == (variation.base, variation.expected, variation.support)


@each("name", CASTS, str)
def test_a_generated_task_follows_its_template_and_has_variations_on_three_axes(name):
    task = registered(name)
    conditions = [*task.training, *task.regimes["balanced"].conditions]
    conditions += [vary(task, variation)[0] for variation in task.variations]
    assert [task.template.problems(condition) for condition in conditions] == [()] * len(conditions)
    found = made_of(name)
    assert found.confounds
    assert found.crossed
    if not any(u.axis == "O" for u in found.unbuilt if "look-alike" in u.title):
        assert len(task.variations) >= 4
        assert len({v.axis for v in task.variations}) >= 3
    assert {u.axis for u in found.unbuilt} | {v.name[0] for v in task.variations} == set("LROT")
    assert all(u.reason for u in found.unbuilt)


@each("name", CASTS, str)
def test_a_generated_task_is_read_back_from_its_form_with_its_regime(name):
    task = registered(name)
    assert task_from_json(task_to_json(task)) == task


@each("name", CASTS, str)
def test_balanced_conditions_hold_no_test_and_break_the_words_apart(name):
    task = registered(name)
    require_no_test(task)
    balanced = task.regimes["balanced"].conditions
    assert len({pairing(c) for c in balanced}) == len(balanced)
    tests = {pairing(vary(task, v)[0])[0] for v in task.variations} - {c.instruction.text for c in task.training}
    assert not tests & {c.instruction.text for c in balanced}
    words = training_distribution_of(replace(task, training=balanced)).word_slots
    places = {"top", "bottom", "middle"}
    assert all(len(slots) > 1 for word, slots in words.items() if slots and word not in places)
    used = {slot for c in balanced for slot in c.layout.values()}
    assert used <= {slot.name for slot in (*task.slots, *task.regimes["balanced"].slots)}


def solution(condition):
    """Return the picked slots and the places: what a policy does that replays a demonstration of the condition."""
    done = []
    for goal in condition.instruction.subgoals:
        names = condition.resolve(goal.reference)
        assert len(names) == 1, (condition.name, goal)
        target = condition.object(goal.target)
        stand = condition.layout[target.mount.target if target.mount is not None else target.name]
        done.append((condition.layout.get(names[0]), goal.target, goal.region, stand))
    return done, {name for name, distance in condition.opened.items() if distance}


@each("name", CASTS, str)
def test_the_demonstration_of_the_twin_does_not_solve_a_variation(name):
    task = registered(name)
    for variation in task.variations:
        if variation.expected is Expected.SUCCEED:
            condition, _ = vary(task, variation)
            assert solution(condition) != solution(task.train(variation.base)), variation.name


@each("name", CASTS, str)
def test_the_demonstration_of_the_same_instruction_does_not_solve_a_variation(name):
    """Except where a place word keeps its place, as in L1 and L2 of the suite's morning coffee."""
    task = registered(name)
    for variation in task.variations:
        condition, _ = vary(task, variation)
        if variation.expected is not Expected.SUCCEED or condition.instruction.subgoals[0].reference.slot:
            continue
        said = [c for c in task.training if c.instruction.text == condition.instruction.text]
        elsewhere = [c for c in said if solution(c) != solution(condition)]
        assert not said or elsewhere, variation.name


def test_every_object_of_an_instruction_can_be_told_apart():
    for name in CASTS:
        task = registered(name)
        for condition in (*task.training, *(vary(task, v)[0] for v in task.variations)):
            kinds = [o.kind for o in condition.objects]
            assert len(set(kinds)) == len(kinds), condition.name


def test_place_words_are_true_in_the_image():
    """The far slot is at the top of the front image: the camera looks along -x."""
    task = registered("three_mugs")
    x = {word: task.slot(slots[0]).x for word, slots in words_of_places(task).items()}
    assert x["top"] < x["middle"] < x["bottom"]


def words_of_places(task) -> dict:
    found: TrainingDistribution = training_distribution_of(task)
    return {word: slots for word, slots in found.word_slots.items() if word in ("top", "middle", "bottom")}


def test_items_without_a_common_noun_are_named_by_their_kind():
    cast = mugs("red", "blue")
    tall = a.item("tall_mug", "latte glass", "mug", "white")
    cast = replace(cast, groups={**cast.groups, "items": (cast.groups["items"][0], tall)})
    texts = [c.instruction.text for c in made(cast).task.training]
    assert texts[0].startswith("Put the red mug inside")
    assert texts[1].startswith("Put the latte glass inside")
    assert texts[2].startswith("Put the top vessel inside")


REFUSED = {
    "'cup' (cup): would be grasped 0 mm in front of its middle": lambda: mugs_with(a.item("cup", "cup", "cup", "red")),
    "'glass' (tumbler): is 112.5 mm high": lambda: mugs_with(a.item("glass", "tumbler", "tumbler", "red")),
    "'bowl' (bowl): has no grasp": lambda: mugs_with(a.item("bowl", "bowl", "cereal_bowl", "white")),
    "'plate' (plate): is 163.5 mm long": lambda: mugs_with(a.item("plate", "plate", "dinner_plate", "red")),
    "has no region 'ring'": lambda: mugs("red", "blue", machine="speaker"),
    "'items': has 1 objects (red_mug)": lambda: mugs("red"),
    "'items': has 4 objects": lambda: mugs("red", "blue", "white", "green"),
    "'keyboard' (keyboard): is": lambda: mugs("red", "blue", distractors=[a.distractor("keyboard")]),
    "'apple' (apple): is 7": lambda: desk(("apple", "apple", "red"), ("tape", "tape_roll", "blue")),
    "'fork' (fork): is 160 mm long": lambda: desk(("fork", "fork", "silver"), ("tape", "tape_roll", "blue")),
    "'keyboard' (keyboard): has no grasp": lambda: desk(("keyboard", "keyboard", None), ("tape", "tape_roll", None)),
    "'napkin_stack' (napkin stack): would be grasped": lambda: desk(
        ("tape", "tape_roll", "blue"), ("napkin stack", "napkin_stack", "white")
    ),
    "'salt' (salt shaker): would be grasped 32.9 mm above its foot": lambda: jars(
        ("salt", "salt shaker", "salt_shaker", "white"), spice("pepper"), spice("paprika")
    ),
    "'jam' (jam jar): has a clearance of -": lambda: jars(
        ("jam", "jam jar", "jam_jar", "red"), spice("pepper"), spice("paprika")
    ),
    "'rack' (rack): has no region 'hole_1'": lambda: other_rack("takeaway_box"),
}


def mugs_with(item):
    cast = mugs("red", "blue")
    return replace(cast, groups={**cast.groups, "items": (cast.groups["items"][0], item)})


def other_rack(category):
    cast = CASTS["seasoning_rack"]
    return replace(cast, groups={**cast.groups, "rack": (a.ObjectSpec("rack", "rack", category, None, "fixture"),)})


@each("problem", REFUSED, str)
def test_an_object_that_does_not_fit_is_refused_with_its_name(problem):
    with pytest.raises(InvalidInputError) as caught:
        made(REFUSED[problem]())
    assert problem in str(caught.value)
    assert caught.value.cure


def test_drawers_of_other_cabinets_are_refused():
    cast = CASTS["office_drawer"]
    upper, lower = cast.groups["drawers"]
    with pytest.raises(InvalidInputError, match="an upper and a lower drawer"):
        made(replace(cast, groups={**cast.groups, "drawers": (upper, upper)}))
    with pytest.raises(InvalidInputError, match="does not belong to the cabinet"):
        made(replace(cast, groups={**cast.groups, "cabinet": (replace(cast.groups["cabinet"][0], category="mug"),)}))
    assert made(replace(cast, groups={**cast.groups, "drawers": (lower, upper)})) is not None


def test_a_template_without_a_pattern_is_unknown():
    assert {"constrained_positioning", "container_loading", "precision_insertion"} <= PATTERNS.keys()
    with pytest.raises(UnknownNameError, match="constrained_positioning"):
        pattern_of("constrained_positionin")
