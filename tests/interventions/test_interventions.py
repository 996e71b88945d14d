"""Interventions: pure functions that change what they declare and nothing else, and refuse what makes no sense."""

from __future__ import annotations

import copy
import dataclasses

import pytest

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.interventions import Changes, apply, operations, vary
from betterbench.tasks import Condition, Expected, Instruction, ObjectSpec, TargetRegion, all_tasks, do, get_task

VARIATIONS = [(t, v) for t in all_tasks() for v in t.variations]
each_variation = pytest.mark.parametrize(
    ("task", "variation"), VARIATIONS, ids=[f"{t.id}/{v.name}" for t, v in VARIATIONS]
)
CUBE = ObjectSpec("cube", "cube", "round_block", role="distractor")


def where(condition: Condition, name: str) -> tuple[object, ...]:
    spec = next((o for o in condition.objects if o.name == name), None)
    return spec, condition.layout.get(name), condition.preplaced.get(name), condition.opened.get(name, 0.0)


def names(*conditions: Condition) -> set[str]:
    return {o.name for c in conditions for o in c.objects}


@each_variation
def test_declared_changes_are_the_only_differences(task, variation):
    base = task.train(variation.base)
    condition, changes = vary(task, variation)
    differing = {n for n in names(base, condition) if where(base, n) != where(condition, n)}
    assert differing == changes.objects
    assert (condition.instruction != base.instruction) is changes.language
    allowed = {
        "name",
        "expected",
        "mid_task_look",
        "premise_broken",
        "objects",
        "layout",
        "preplaced",
        "opened",
        "instruction",
    }
    for field in dataclasses.fields(Condition):
        if field.name not in allowed:
            assert getattr(condition, field.name) == getattr(base, field.name)


@each_variation
def test_vary_carries_the_variation_s_own_facts(task, variation):
    condition, changes = vary(task, variation)
    assert condition.id == f"{task.id}/{variation.name}"
    assert condition.expected is variation.expected
    assert condition.mid_task_look is variation.mid_task_look
    assert condition.premise_broken is variation.premise_broken
    assert changes.objects or changes.language, "a variation that changes nothing tests nothing"


@each_variation
def test_interventions_are_pure_and_repeatable(task, variation):
    base = task.train(variation.base)
    before = copy.deepcopy(base)
    first = vary(task, variation)
    second = vary(task, variation)
    assert base == before
    assert first == second
    assert [o.name for o in base.objects] == [o.name for o in before.objects]


@each_variation
def test_untouched_objects_keep_their_order(task, variation):
    base = task.train(variation.base)
    condition, changes = vary(task, variation)
    kept = [o for o in base.objects if o.name not in changes.objects]
    assert [o for o in condition.objects if o.name not in changes.objects] == kept


@each_variation
def test_interventions_are_shown_as_text(task, variation):
    for intervention in variation.interventions:
        assert intervention.operation in operations()
        assert str(intervention).startswith(f"do({intervention.operation}")
        assert "ObjectSpec(" not in str(intervention)
        assert "Instruction(" not in str(intervention)


@pytest.fixture
def food() -> Condition:
    return get_task("fast_food").train("train1")


def test_the_operations_are_those_of_the_suite():
    named = "add chain draw_out instruct move preplace remove repeat replace swap"
    assert operations() == tuple(named.split())


def test_swap_is_its_own_inverse_and_symmetric(food):
    swapped, changes = apply(food, [do("swap", a="burger_1", b="fries")])
    assert swapped.layout["burger_1"] == "third"
    assert swapped.layout["fries"] == "first"
    assert changes == Changes(frozenset({"burger_1", "fries"}))
    assert apply(food, [do("swap", a="fries", b="burger_1")])[0] == swapped
    assert apply(swapped, [do("swap", a="burger_1", b="fries")])[0] == food


def test_remove_then_add_back_is_the_same_scene(food):
    removed, _ = apply(food, [do("remove", object="drink")])
    assert "drink" not in names(removed) | set(removed.layout)
    back, changes = apply(removed, [do("add", object=food.object("drink"), slot="fourth")])
    assert set(back.objects) == set(food.objects)
    assert dict(back.layout) == dict(food.layout)
    assert changes.objects == {"drink"}


def test_replace_is_remove_and_add_in_one_slot(food):
    replaced, changes = apply(food, [do("replace", object="burger_1", by=CUBE)])
    stepwise, both = apply(food, [do("remove", object="burger_1"), do("add", object=CUBE, slot="first")])
    assert replaced == stepwise
    assert changes == both == Changes(frozenset({"burger_1", "cube"}))


def test_move_needs_a_free_slot_and_frees_the_old_one(food):
    empty, _ = apply(food, [do("remove", object="drink")])
    moved, changes = apply(empty, [do("move", object="burger_1", slot="fourth")])
    assert moved.occupant("first") is None
    assert moved.occupant("fourth") == "burger_1"
    assert changes.objects == {"burger_1"}


def test_preplace_takes_the_object_off_its_slot(food):
    placed, _ = apply(food, [do("preplace", object="fries", target="box")])
    assert placed.preplaced == {"fries": TargetRegion("box")}
    assert "fries" not in placed.layout
    assert apply(placed, [do("remove", object="fries")])[0].preplaced == {}


@pytest.fixture
def drawers() -> Condition:
    return get_task("office_drawer").train("train3")


def test_draw_out_opens_one_drawer_and_touches_nothing_else(drawers):
    drawn, changes = apply(drawers, [do("draw_out", drawer="upper", distance_m=0.1)])
    assert drawn == drawers.with_(opened={"upper": 0.1})
    assert changes == Changes(frozenset({"upper"}))
    both, _ = apply(drawn, [do("draw_out", drawer="lower", distance_m=0.05)])
    assert both.opened == {"upper": 0.1, "lower": 0.05}
    shut, _ = apply(drawn, [do("draw_out", drawer="upper", distance_m=0.0)])
    assert shut.opened == {"upper": 0.0}
    assert drawers.opened == {}


def test_only_drawers_are_drawn_out(drawers):
    with pytest.raises(InvalidInputError, match="it is no drawer") as caught:
        apply(drawers, [do("draw_out", drawer="stapler", distance_m=0.1)])
    assert "\n" not in str(caught.value)
    with pytest.raises(UnknownNameError, match="Did you mean 'upper'"):
        apply(drawers, [do("draw_out", drawer="uper", distance_m=0.1)])


def test_changes_add_up():
    assert Changes(frozenset({"a"})) | Changes(frozenset({"b"}), language=True) == Changes(frozenset({"a", "b"}), True)
    assert apply(get_task("fast_food").train("train1"), ()) == (get_task("fast_food").train("train1"), Changes())


TWO = get_task("fast_food").train("train2").instruction
LONG = get_task("fast_food").variation("T2").interventions[0].arguments["instruction"]


def test_language_leaves_the_scene_alone(food):
    for intervention in (
        do("instruct", instruction=TWO),
        do("chain", instruction=LONG),
        do("repeat", instruction=LONG),
    ):
        changed, changes = apply(food, [intervention])
        assert changes == Changes(language=True)
        assert changed == food.with_(instruction=intervention.arguments["instruction"])


BAD = {
    "unknown operation": (do("swop", a="fries", b="drink"), UnknownNameError, "Did you mean 'swap'"),
    "swap unknown": (do("swap", a="frise", b="drink"), UnknownNameError, "Did you mean 'fries'"),
    "move to a taken slot": (
        do("move", object="fries", slot="first"),
        InvalidInputError,
        "burger_1 already stands there",
    ),
    "add to a taken slot": (do("add", object=CUBE, slot="first"), InvalidInputError, "burger_1 already stands there"),
    "move unknown": (do("move", object="salad", slot="first"), UnknownNameError, "salad"),
    "remove unknown": (do("remove", object="salad"), UnknownNameError, "salad"),
    "replace unknown": (do("replace", object="frise", by=CUBE), UnknownNameError, "Did you mean 'fries'"),
    "preplace at nothing": (do("preplace", object="fries", target="basket"), UnknownNameError, "basket"),
    "chain that is not longer": (do("chain", instruction=TWO), InvalidInputError, "not longer"),
    "repeat without repetition": (do("repeat", instruction=TWO), InvalidInputError, "no subgoal is repeated"),
}


@pytest.mark.parametrize(("intervention", "error", "text"), BAD.values(), ids=BAD.keys())
def test_bad_arguments_give_one_clear_error(food, intervention, error, text):
    with pytest.raises(error, match=text) as caught:
        apply(food, [intervention])
    assert "\n" not in str(caught.value)


def test_a_name_in_use_is_refused(food):
    empty, _ = apply(food, [do("remove", object="drink")])
    again = dataclasses.replace(CUBE, name="fries")
    with pytest.raises(InvalidInputError, match="the name is in use"):
        apply(empty, [do("add", object=again, slot="fourth")])


def test_what_is_preplaced_starts_in_no_slot(food):
    placed, _ = apply(food, [do("preplace", object="fries", target="box")])
    for intervention in (
        do("move", object="fries", slot="third"),
        do("swap", a="fries", b="drink"),
        do("preplace", object="fries", target="box"),
        do("replace", object="fries", by=CUBE),
    ):
        with pytest.raises(InvalidInputError, match="starts in no slot"):
            apply(placed, [intervention])


@pytest.mark.parametrize("arguments", [{}, {"a": "fries"}, {"a": "fries", "b": "drink", "c": "box"}])
def test_missing_or_unknown_arguments_are_named(food, arguments):
    with pytest.raises(InvalidInputError, match="swap"):
        apply(food, [do("swap", **arguments)])


def test_an_unknown_slot_is_found_when_the_scene_is_built_at_the_latest(food):
    from betterbench.scenes import place_objects

    empty, _ = apply(food, [do("remove", object="drink")])
    moved, _ = apply(empty, [do("move", object="burger_1", slot="fifth")])
    with pytest.raises(UnknownNameError, match="Unknown slot of fast_food 'fifth'"):
        place_objects(get_task("fast_food"), moved, 0)


def test_expected_behavior_is_no_intervention(food):
    changed, _ = apply(food, [do("swap", a="fries", b="drink")])
    assert changed.expected is Expected.SUCCEED
    assert changed.name == food.name
    assert isinstance(changed.instruction, Instruction)
