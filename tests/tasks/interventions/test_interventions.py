"""Interventions: pure functions that change what they declare and nothing else, and refuse what makes no sense."""

from __future__ import annotations

import copy
import dataclasses

import pytest
from tests.looping import each

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.tasks import (
    Changes,
    Condition,
    Expected,
    Instruction,
    ObjectSpec,
    Slot,
    TargetRegion,
    all_tasks,
    get_task,
    operation_names,
)
from betterbench.tasks.authoring.operations import (
    add,
    chain,
    draw_out,
    instruct,
    move,
    preplace,
    remove,
    repeat,
    replace,
    swap,
)
from betterbench.tasks.interventions import apply, resolve_condition, vary

VARIATIONS = [(t, v) for t in all_tasks() for v in t.variations]
each_variation = each("task, variation", VARIATIONS, lambda t, v: f"{t.id}/{v.name}")
FOOD, OFFICE = get_task("fast_food"), get_task("office_drawer")


def thing(name: str, condition: Condition | None = None) -> ObjectSpec:
    """Returns an object of a condition (of fast_food if none is given), or one that no condition has."""
    known = (condition or FOOD.training[0]).objects
    return next((o for o in known if o.name == name), ObjectSpec(name, name, name))


def at(name: str) -> Slot:
    return FOOD.slot(name)


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
        "watch_steps",
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
    assert condition.watch_steps == variation.watch_steps
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
        assert intervention.name in operation_names()
        assert str(intervention).startswith(f"do({intervention.name} ")
        assert "ObjectSpec(" not in str(intervention)
        assert "Instruction(" not in str(intervention)


@pytest.fixture
def food() -> Condition:
    return get_task("fast_food").train("train1")


def test_the_operations_are_those_of_the_suite():
    named = "add chain draw_out instruct move preplace remove repeat replace swap"
    assert operation_names() == tuple(named.split())


def test_swap_is_its_own_inverse_and_symmetric(food):
    swapped, changes = apply(food, [swap(thing("burger_1"), thing("fries"))])
    assert swapped.layout["burger_1"] == "third"
    assert swapped.layout["fries"] == "first"
    assert changes == Changes(frozenset({"burger_1", "fries"}))
    assert apply(food, [swap(thing("fries"), thing("burger_1"))])[0] == swapped
    assert apply(swapped, [swap(thing("burger_1"), thing("fries"))])[0] == food


def test_remove_then_add_back_is_the_same_scene(food):
    removed, _ = apply(food, [remove(thing("drink"))])
    assert "drink" not in names(removed) | set(removed.layout)
    back, changes = apply(removed, [add(thing("drink"), at("fourth"))])
    assert set(back.objects) == set(food.objects)
    assert dict(back.layout) == dict(food.layout)
    assert changes.objects == {"drink"}


def test_replace_is_remove_and_add_in_one_slot(food):
    replaced, changes = apply(food, [replace(thing("burger_1"), CUBE)])
    stepwise, both = apply(food, [remove(thing("burger_1")), add(CUBE, at("first"))])
    assert replaced == stepwise
    assert changes == both == Changes(frozenset({"burger_1", "cube"}))


def test_move_needs_a_free_slot_and_frees_the_old_one(food):
    empty, _ = apply(food, [remove(thing("drink"))])
    moved, changes = apply(empty, [move(thing("burger_1"), at("fourth"))])
    assert moved.occupant("first") is None
    assert moved.occupant("fourth") == "burger_1"
    assert changes.objects == {"burger_1"}


def test_preplace_takes_the_object_off_its_slot(food):
    placed, _ = apply(food, [preplace(thing("fries"), thing("box"))])
    assert placed.preplaced == {"fries": TargetRegion("box")}
    assert "fries" not in placed.layout
    assert apply(placed, [remove(thing("fries"))])[0].preplaced == {}


@pytest.fixture
def drawers() -> Condition:
    return get_task("office_drawer").train("train3")


def test_draw_out_opens_one_drawer_and_touches_nothing_else(drawers):
    drawn, changes = apply(drawers, [draw_out(thing("upper", OFFICE.training[2]), distance_m=0.1)])
    assert drawn == drawers.with_(opened={"upper": 0.1})
    assert changes == Changes(frozenset({"upper"}))
    both, _ = apply(drawn, [draw_out(thing("lower", OFFICE.training[2]), distance_m=0.05)])
    assert both.opened == {"upper": 0.1, "lower": 0.05}
    shut, _ = apply(drawn, [draw_out(thing("upper", OFFICE.training[2]), distance_m=0.0)])
    assert shut.opened == {"upper": 0.0}
    assert drawers.opened == {}


def test_only_drawers_are_drawn_out(drawers):
    with pytest.raises(InvalidInputError, match="it is not a drawer") as caught:
        apply(drawers, [draw_out(thing("stapler", OFFICE.training[2]), distance_m=0.1)])
    assert "\n" not in str(caught.value)
    with pytest.raises(UnknownNameError, match="Did you mean 'upper'"):
        apply(drawers, [draw_out(thing("uper", OFFICE.training[2]), distance_m=0.1)])


def test_changes_add_up():
    assert Changes(frozenset({"a"})) | Changes(frozenset({"b"}), language=True) == Changes(frozenset({"a", "b"}), True)
    assert apply(get_task("fast_food").train("train1"), ()) == (get_task("fast_food").train("train1"), Changes())


TWO = get_task("fast_food").train("train2").instruction
LONG = get_task("fast_food").variation("T2").interventions[-1].arguments["instruction"]


def test_language_leaves_the_scene_alone(food):
    for intervention in (
        instruct(TWO),
        chain(LONG),
        repeat(LONG),
    ):
        changed, changes = apply(food, [intervention])
        assert changes == Changes(language=True)
        assert changed == food.with_(instruction=intervention.arguments["instruction"])


BAD = {
    "swap unknown": (swap(thing("frise"), thing("drink")), UnknownNameError, "Did you mean 'fries'"),
    "move to a taken slot": (
        move(thing("fries"), at("first")),
        InvalidInputError,
        "it already contains burger_1",
    ),
    "add to a taken slot": (add(CUBE, at("first")), InvalidInputError, "it already contains burger_1"),
    "move unknown": (move(thing("salad"), at("first")), UnknownNameError, "salad"),
    "remove unknown": (remove(thing("salad")), UnknownNameError, "salad"),
    "replace unknown": (replace(thing("frise"), CUBE), UnknownNameError, "Did you mean 'fries'"),
    "preplace at nothing": (preplace(thing("fries"), thing("basket")), UnknownNameError, "basket"),
    "chain that is not longer": (chain(TWO), InvalidInputError, "not longer"),
    "repeat without repetition": (repeat(TWO), InvalidInputError, "no subgoal is repeated"),
}


@pytest.mark.parametrize(("intervention", "error", "text"), BAD.values(), ids=BAD.keys())
def test_bad_arguments_give_one_clear_error(food, intervention, error, text):
    with pytest.raises(error, match=text) as caught:
        apply(food, [intervention])
    assert "\n" not in str(caught.value)


def test_a_name_in_use_is_refused(food):
    empty, _ = apply(food, [remove(thing("drink"))])
    again = dataclasses.replace(CUBE, name="fries")
    with pytest.raises(InvalidInputError, match="an object with this name already exists"):
        apply(empty, [add(again, at("fourth"))])


def test_what_is_preplaced_starts_in_no_slot(food):
    placed, _ = apply(food, [preplace(thing("fries"), thing("box"))])
    for intervention in (
        move(thing("fries"), at("third")),
        swap(thing("fries"), thing("drink")),
        preplace(thing("fries"), thing("box")),
        replace(thing("fries"), CUBE),
    ):
        with pytest.raises(InvalidInputError, match="does not start in a slot"):
            apply(placed, [intervention])


def test_missing_or_unknown_arguments_are_found_where_the_task_is_written():
    with pytest.raises(TypeError, match="'b'"):
        swap(thing("fries"))
    with pytest.raises(TypeError, match="too many"):
        swap(thing("fries"), thing("drink"), thing("box"))


def test_equal_operations_are_equal_and_others_are_not():
    assert swap(thing("fries"), thing("drink")) == swap(a=thing("fries"), b=thing("drink"))
    assert swap(thing("fries"), thing("drink")) != swap(thing("drink"), thing("fries"))
    assert str(move(thing("fries"), at("fourth"))) == "do(move object=fries slot=fourth)"


def test_a_name_becomes_a_condition_in_one_place():
    for task in all_tasks():
        for training in task.training:
            found = resolve_condition(task.id, training.name)
            assert (found.condition, found.variation, found.base, found.axis) == (training, None, training.name, None)
        for variation in task.variations:
            found = resolve_condition(task.id, variation.name)
            assert (found.condition, found.changes) == vary(task, variation)
            assert (found.base, found.axis) == (variation.base, variation.axis.value)
    with pytest.raises(UnknownNameError, match="Did you mean 'train1'"):
        resolve_condition("fast_food", "trian1")


def test_an_unknown_slot_is_found_when_the_scene_is_built_at_the_latest(food):
    from betterbench.sim.scenes import place_objects

    empty, _ = apply(food, [remove(thing("drink"))])
    moved, _ = apply(empty, [move(thing("burger_1"), Slot("fifth", 0.5, 0.0))])
    with pytest.raises(UnknownNameError, match="Unknown slot of fast_food 'fifth'"):
        place_objects(get_task("fast_food"), moved, 0)


def test_expected_behavior_is_no_intervention(food):
    changed, _ = apply(food, [swap(thing("fries"), thing("drink"))])
    assert changed.expected is Expected.SUCCEED
    assert changed.name == food.name
    assert isinstance(changed.instruction, Instruction)
