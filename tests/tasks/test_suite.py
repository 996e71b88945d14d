"""What every task of the registry has to keep: the support law, names and axes, and references that mean something."""

from __future__ import annotations

import pytest
from tests.daily import part_of_today
from tests.looping import each
from tests.tasks.releasing import ground, releases

from betterbench.errors import UnknownNameError
from betterbench.sim.assets import build_unpainted
from betterbench.sim.scenes.appearance import look_of
from betterbench.tasks import (
    TEMPLATES,
    Axis,
    Condition,
    Expected,
    ObjectSpec,
    Reference,
    Support,
    Variation,
    all_tasks,
    get_task,
    suite_tasks,
    task_names,
    training_distribution_of,
)
from betterbench.tasks.authoring.templates import CONTAINER_LOADING, LOOSE_PACKING, RECURSIVE_STACKING
from betterbench.tasks.interventions import vary
from betterbench.tasks.relations import RELATIONS

TASKS = all_tasks()
"""Every task of the folder: one that is being added has to keep the same laws, and belongs to no suite yet."""
SUITE = tuple(get_task(name) for name in suite_tasks("better60"))
VARIATIONS = [(t, v) for t in TASKS for v in t.variations]
CONDITIONS = [(t, c) for t in TASKS for c in t.training] + [(t, vary(t, v)[0]) for t, v in VARIATIONS]
each_task = each("task", TASKS, lambda t: t.id)
each_task_of_the_suite = each("task", SUITE, lambda t: t.id)
each_variation = each("task, variation", VARIATIONS, lambda t, v: f"{t.id}/{v.name}")
each_condition = each("task, condition", CONDITIONS, lambda _, c: c.id)

RECURSIVE = (RECURSIVE_STACKING,)
"""Templates whose targets are things that are themselves put somewhere."""
BOTTOMLESS = (LOOSE_PACKING, CONTAINER_LOADING)
"""Templates whose targets hold several things at one place."""

SUITE_TABLE = {
    "desk_meeting": "LLRROT",
    "breakfast_table": "LLROOT",
    "fruit_lunch": "LROOTT",
    "fast_food": "LRROTT",
    "tidy_desk": "LLOOOT",
    "morning_coffee": "LLLLOT",
    "office_drawer": "LLROTT",
    "cheeseburger": "LRROTT",
    "seasoning_rack": "LLROOT",
    "dinner_plates": "LLROTT",
}
"""Axis letters of the variations of each task in the order of the suite's table (suite, section 3)."""


def numbered(letters: str) -> list[str]:
    return [f"{letter}{letters[: i + 1].count(letter)}" for i, letter in enumerate(letters)]


def test_suite_has_ten_tasks_and_sixty_variations():
    """Suite, section 3: 19 layout shifts, 11 recompositions, 15 perturbations and 15 extrapolations."""
    assert {t.id for t in SUITE} == set(SUITE_TABLE)
    assert all(t.template is TEMPLATES[t.template.name] for t in SUITE)
    for letters in ("".join(SUITE_TABLE.values()), [v.axis.letter for t in SUITE for v in t.variations]):
        assert {letter: letters.count(letter) for letter in "LROT"} == {"L": 19, "R": 11, "O": 15, "T": 15}


@each_task_of_the_suite
def test_variations_and_axes_are_those_of_the_suite(task):
    assert [v.name for v in task.variations] == numbered(SUITE_TABLE[task.id])


@each_task
def test_conditions_are_numbered_and_variations_begin_with_the_letter_of_their_axis(task):
    assert all(v.name[0] == v.axis.letter for v in task.variations)
    assert [c.name for c in task.training] == [f"train{i}" for i in range(1, len(task.training) + 1)]


@each_task
def test_task_is_complete_and_found_by_name(task):
    assert get_task(task.id) is task
    template = task.template.name
    same_name = [TEMPLATES.get(template), *(t.template for t in TASKS if t.template.name == template)]
    assert {id(t) for t in same_name if t is not None} == {id(task.template)}, "two templates have one name"
    assert task.template.relation in RELATIONS
    assert task.version >= 1
    assert task.title
    assert task.description.endswith(".")
    assert len({s.name for s in task.slots}) == len(task.slots)


def test_unknown_names_are_refused_with_the_closest():
    task = TASKS[0]
    with pytest.raises(UnknownNameError, match="Did you mean 'fast_food'"):
        get_task("fastfood")
    for look_up, name in ((task.slot, "nowhere"), (task.train, "train99"), (task.variation, "X9")):
        with pytest.raises(UnknownNameError, match=name):
            look_up(name)
    assert task_names() == tuple(sorted(task_names()))


@each_condition
def test_condition_is_consistent(task, condition):
    names = [o.name for o in condition.objects]
    assert len(set(names)) == len(names)
    assert condition.task == task.id
    mounted = [o.name for o in condition.objects if o.mount is not None]
    placed = [*condition.layout, *condition.preplaced, *mounted]
    assert sorted(placed) == sorted(names), "every object starts in one slot, at one target or in one mount"
    assert len(set(condition.layout.values())) == len(condition.layout), "no slot holds two objects"
    for slot in condition.layout.values():
        task.slot(slot)
    places = [*condition.preplaced.values(), *(o.mount for o in condition.objects if o.mount is not None)]
    assert all(place.target in names for place in places)
    assert len(set(places)) == len(places) or task.template in BOTTOMLESS, "no place of a target holds two objects"


@each_condition
def test_drawers_slide_in_a_fixture_and_are_drawn_out_as_in_training(task, condition):
    for o in condition.objects:
        assert (o.role == "drawer") is (o.mount is not None)
        if o.mount is not None:
            assert condition.object(o.mount.target).role == "fixture"
            assert condition.object(o.mount.target).fixed
            assert not o.fixed
    trained = {(c.object(n).kind, distance) for c in task.training for n, distance in c.opened.items()}
    drawn = {(condition.object(n).kind, distance) for n, distance in condition.opened.items()}
    assert drawn <= trained
    assert all(condition.object(n).role == "drawer" and distance > 0.0 for n, distance in condition.opened.items())


@each_condition
def test_every_reference_resolves(task, condition):
    goals = condition.instruction.subgoals
    assert goals
    for goal in goals:
        assert goal.relation in (task.template.relation, *task.template.also)
        target = condition.object(goal.target).role
        assert target in ("container", "fixture", "drawer") or (target == "item" and task.template in RECURSIVE)
        assert goal.word in condition.instruction.text.lower()
        if condition.premise_broken:
            continue
        names = condition.resolve(goal.reference)
        assert len(names) >= goal.count
        assert all(condition.object(n).role in RELATIONS[goal.relation].roles for n in names)
        assert goal.target not in names, "nothing is put on itself"
    assert len({g.name for g in goals}) == len(goals)
    if task.template not in (CONTAINER_LOADING, *RECURSIVE):
        assert len({g.target for g in goals}) == 1, "only drawers and stacks are targets side by side"
    if not task.template.also:
        assert len({g.relation for g in goals}) == 1


def with_each_place():
    """The last condition with each of the places that are asked for."""
    found = {}
    for task, condition in CONDITIONS:
        for goal in condition.instruction.subgoals:
            place = (task.id, goal.relation, goal.target, condition.object(goal.target).category, goal.region)
            found[place] = (task, condition)
    return {condition.id: (task, condition) for task, condition in found.values()}.values()


@each("task, condition", with_each_place, lambda _, c: c.id)
def test_every_target_offers_the_place_that_is_asked_for(at_reset, task, condition):
    info = at_reset(task.id, condition.name).info
    for goal in condition.instruction.subgoals:
        assert goal.region in RELATIONS[goal.relation].regions(info.object(goal.target)), goal.name


def specs_of(task):
    return {o.category: o for _, c in CONDITIONS if c.task == task.id for o in c.objects}


def looks_drawn(task, spec):
    """The looks that the default of twenty trials draws."""
    return sorted({look_of(task.id, seed, spec) for seed in range(20)})


def looks_differ(task, specs):
    """Even without their textures, no two looks of a category are the same."""
    for spec in specs:
        drawn = looks_drawn(task, spec)
        built = {build_unpainted(spec.category, look=look, color=spec.color).content_hash() for look in drawn}
        assert len(built) == len(drawn), spec.category


@each_task
def test_every_thing_is_seen_in_at_least_five_looks(task):
    """The default of twenty trials shows each of them in five or more of its eight looks."""
    for category, spec in specs_of(task).items():
        assert len(looks_drawn(task, spec)) >= 5, category


@each_task
def test_looks_of_a_thing_differ(task):
    """Those of every sixth object, of others each day."""
    looks_differ(task, part_of_today([*specs_of(task).values()], 6))


@pytest.mark.slow
@each_task
def test_looks_of_everything_differ(task):
    looks_differ(task, specs_of(task).values())


@each_condition
def test_condition_survives_json_as_plain_data(task, condition):
    form = condition.to_json()
    assert form["name"] == condition.name
    assert form["layout"] == dict(condition.layout)
    assert form["preplaced"] == {n: {"target": p.target, "region": p.region} for n, p in condition.preplaced.items()}
    assert form["opened"] == dict(condition.opened)
    for o, written in zip(condition.objects, form["objects"], strict=True):
        assert written["mount"] == (None if o.mount is None else {"target": o.mount.target, "region": o.mount.region})
    assert [o["name"] for o in form["objects"]] == [o.name for o in condition.objects]


@each_condition
def test_instructed_objects_can_be_told_apart_from_look_alikes(task, condition):
    """Two objects of one kind are interchangeable, so they must be the same category and color."""
    by_kind: dict[str, set[tuple[str, str | None]]] = {}
    for o in condition.objects:
        by_kind.setdefault(o.kind, set()).add((o.category, o.color))
    assert all(len(looks) == 1 for looks in by_kind.values())


@each_task_of_the_suite
def test_expected_behavior_is_that_of_the_suite(task):
    exceptions = {"fruit_lunch/O1": Expected.REFUSE, "morning_coffee/T1": Expected.STAY_STILL}
    for variation in task.variations:
        assert variation.expected is exceptions.get(f"{task.id}/{variation.name}", Expected.SUCCEED), variation.name


@each_variation
def test_a_variation_says_what_it_tests(task, variation):
    assert variation.hypothesis.endswith(".")
    assert variation.title


@each_variation
def test_support_every_pick_slot_target_and_grasped_kind_was_trained(task, variation):
    """Suite, section 3: what may be new is the combination, never a slot, a target or a grasp."""
    condition, _ = vary(task, variation)
    trained = training_distribution_of(task)
    picked = {slot for slots in trained.kind_slots.values() for slot in slots}
    stood = set(trained.standing_kinds)
    assert releases(condition) <= {r for c in task.training for r in releases(c)}
    if variation.support is Support.NOVEL:
        return
    assert set(condition.layout.values()) <= stood, "something stands where nothing ever stood in training"
    for goal in condition.instruction.subgoals:
        for name in condition.resolve(goal.reference):
            assert condition.object(name).kind in trained.kind_slots, f"{name} was never grasped in training"
            if name in condition.layout:
                assert condition.layout[name] in picked, f"{name} stands where nothing was picked in training"


def test_support_follows_what_carries_a_target():
    """Blue on red was trained with the red plate on the white one, so the place is the white plate's slot."""
    task = get_task("dinner_plates")
    stacked, single = task.train("train3"), task.train("train1")
    assert releases(stacked) == {("on_plate", "red plate", "", "stand_right")}
    assert releases(single) == {("on_plate", "white plate", "", "stand_right")}
    blue_on_red = single.with_(instruction=stacked.instruction)
    assert releases(blue_on_red) == {("on_plate", "red plate", "", "left_back")}
    whole, _ = vary(task, task.variation("T1"))
    assert releases(whole) == releases(stacked) | releases(single)
    drawers = get_task("office_drawer").train("train8")
    assert ground(drawers, "lower") == ground(drawers, "cabinet") == "cabinet_front"


@each_variation
def test_support_what_is_preplaced_rests_where_training_put_it(task, variation):
    condition, _ = vary(task, variation)
    trained = {
        (c.object(n).kind, g.target, g.region)
        for c in task.training
        for g in c.instruction.subgoals
        for n in c.resolve(g.reference)
    }
    assert {(condition.object(n).kind, p.target, p.region) for n, p in condition.preplaced.items()} <= trained


@each_variation
def test_variation_is_new(task, variation):
    """A variation that equals a training condition would test nothing."""
    condition, _ = vary(task, variation)

    def setting(c: Condition) -> tuple[object, ...]:
        kinds = frozenset((slot, c.object(n).kind) for n, slot in c.layout.items())
        preplaced = frozenset((c.object(n).kind, t) for n, t in c.preplaced.items())
        opened = frozenset((c.object(n).kind, distance) for n, distance in c.opened.items())
        return c.instruction.text, kinds, preplaced, opened

    assert setting(condition) not in {setting(c) for c in task.training}


@each_variation
def test_look_alikes_and_distractors_are_not_meant(task, variation):
    condition, _ = vary(task, variation)
    meant = {n for g in condition.instruction.subgoals for n in condition.resolve(g.reference)}
    assert not {o.name for o in condition.objects if o.role == "distractor"} & meant


@each_condition
def test_step_limit_grows_with_the_steps_asked(task, condition):
    limit = task.step_limit(condition)
    if condition.expected is Expected.STAY_STILL:
        assert limit == task.template.still_steps
    else:
        steps = task.template.steps_per_subgoal * len(condition.instruction.subgoals)
        assert limit == task.template.base_steps + steps + condition.watch_steps


def test_axis_letters():
    assert [a.letter for a in Axis] == ["L", "R", "O", "T"]


def test_variation_named_against_its_axis_is_refused():
    with pytest.raises(ValueError, match="must begin with the letter of its axis: L"):
        Variation("X1", (), "t", "h.")
    assert Variation("R1", (), "t", "h.").axis is Axis.PRIMITIVE_RECOMPOSITION


def test_reference_names_exactly_one_thing():
    for arguments in ({}, {"kind": "burger", "slot": "near"}):
        with pytest.raises(ValueError, match="either a kind or a slot"):
            Reference(**arguments)


def test_resolve_by_kind_is_sorted_and_by_slot_follows_the_layout():
    task = get_task("fast_food")
    condition = task.train("train1")
    backwards = condition.with_(objects=condition.objects[::-1])
    assert backwards.resolve(Reference(kind="burger")) == ("burger_1", "burger_2")
    assert condition.resolve(Reference(slot="third")) == ("fries",)
    assert condition.resolve(Reference(slot="nowhere")) == ()
    assert condition.resolve(Reference(kind="nothing")) == ()
    assert condition.occupant("third") == "fries"
    assert condition.occupant("nowhere") is None
    assert condition.object("box") == ObjectSpec("box", "box", "takeaway_box", role="container")
    with pytest.raises(UnknownNameError, match="burger_1"):
        condition.object("burger1")


def test_fast_food_regime_has_the_confounds_of_the_suite():
    trained = training_distribution_of(get_task("fast_food"))
    assert trained.first_kinds == (("burger", 2),)
    assert set(trained.sequences) == {("burger", "fries"), ("burger", "drink")}
    assert trained.word_slots == {"burger": ("first", "second"), "fries": ("third",), "drink": ("fourth",)}
    assert trained.standing_kinds["first"] == ("burger",)
    assert trained.initial_items == 4


def test_morning_coffee_regime_ties_colors_to_layout_1_and_places_to_layout_2():
    task = get_task("morning_coffee")
    trained = training_distribution_of(task)
    assert trained.word_slots == {"red": ("near",), "blue": ("far",), "top": ("far",), "bottom": ("near",)}
    assert trained.kind_slots == {"red mug": ("far", "near"), "blue mug": ("far", "near")}
    assert trained.standing_kinds["near"] == ("blue mug", "red mug")
    assert trained.first_kinds == (("blue mug", 2), ("red mug", 2))
    assert trained.initial_items == 2


@each_task
def test_regime_is_computed_from_all_training_conditions(task):
    trained = training_distribution_of(task)
    assert len(trained.sequences) == len(task.training)
    assert sum(n for _, n in trained.first_kinds) == len(task.training)
    assert [n for _, n in trained.first_kinds] == sorted((n for _, n in trained.first_kinds), reverse=True)
    words = {g.word for c in task.training for g in c.instruction.subgoals}
    assert set(trained.word_slots) == words
