"""Goals with several targets over time: wrong places, what was there before, drawers, layers, and repeated kinds."""

from __future__ import annotations

import dataclasses

import pytest
from tests.tasks.posing import Course, center_at, drawn, foot_at, other_name, region_frame, renamed

from betterbench.geometry import Pose
from betterbench.tasks import GoalTracker, Reference, Subgoal, get_task
from betterbench.tasks.interventions import vary

DWELL = 10
"""Control steps of 0.5 s at 20 Hz."""


def condition_of(task_id, name):
    task = get_task(task_id)
    return task.train(name) if name.startswith("train") else vary(task, task.variation(name))[0]


def course_of(state, condition):
    template = get_task(condition.task).template
    return Course(GoalTracker(condition, state.info, template=template, control_rate_hz=20.0))


@pytest.fixture
def start(at_reset):
    def begin(task_id, name):
        state = at_reset(task_id, name)
        return state, course_of(state, condition_of(task_id, name))

    return begin


@pytest.fixture
def put(posed):
    """A state in which things stand at places of a target: a side, a hole, or the floor of a plate."""

    def make(state, target, **places):
        poses, touches = {}, []
        for thing, place in places.items():
            poses[thing] = foot_at(state, thing, (0.0, 0.0, 0.0), frame=region_frame(state, target, place))
            touches.append((thing, "table" if place in ("left", "right", "behind", "upper_right") else target))
        return posed(state, poses=poses, contacts=tuple(touches))

    return make


# ------------------------------------------------------------------------------------------------ sides of an anchor


def test_sides_are_done_in_any_order_and_succeed_after_the_dwell(start, put):
    state, course = start("desk_meeting", "train1")
    asked = {g.reference.kind: g.region for g in condition_of("desk_meeting", "train1").instruction.subgoals}
    assert asked == {"mouse": "right", "mug": "left"}
    assert course.done(state) == set()
    assert course.done(put(state, "laptop", mug="left")) == {"mug_left"}
    both = put(state, "laptop", mug="left", mouse="right")
    assert course.done(both) == {"mug_left", "mouse_right"}
    assert not course.see(both, DWELL - 1).success
    assert course.see(both).success


def test_a_thing_at_the_side_of_the_other_is_not_done(start, put):
    state, course = start("desk_meeting", "train1")
    course.see(state)
    truth = course.see(put(state, "laptop", mug="right", mouse="left"), 3 * DWELL)
    assert truth.subgoals == (False, False)
    assert not truth.success


@pytest.mark.parametrize("side", ["behind", "left", "right"])
def test_a_thing_brought_to_a_side_that_was_not_asked_spoils_the_goal_for_good(start, put, side):
    state, course = start("desk_meeting", "train1")
    course.see(state)
    spoilt = put(state, "laptop", mug="left", mouse="right", speaker=side)
    truth = course.see(spoilt, 3 * DWELL)
    assert all(truth.subgoals)
    assert not truth.goal
    assert not truth.success
    brought_back = put(state, "laptop", mug="left", mouse="right")
    assert not course.see(brought_back, 3 * DWELL).success, "it was carried out of its slot"


# ------------------------------------------------------------------------------------------------- holes and plates


def test_jars_in_holes_that_were_not_asked_spoil_the_goal(start, put):
    state, course = start("seasoning_rack", "train1")
    assert course.done(state) == set()
    truth = course.see(put(state, "rack", salt="hole_1", pepper="hole_3"), 3 * DWELL)
    assert truth.subgoals == (True,)
    assert not truth.goal
    assert not course.see(put(state, "rack", salt="hole_1"), 3 * DWELL).success, "the pepper was carried about"


def test_what_was_in_its_hole_from_the_start_spoils_nothing_unless_it_is_moved_to_another(start, put):
    state, course = start("seasoning_rack", "L2")
    assert course.done(state) == set()
    assert course.see(put(state, "rack", salt="hole_1"), DWELL + 1).success
    state, course = start("seasoning_rack", "L2")
    course.see(state)
    swapped = put(state, "rack", salt="hole_1", pepper="hole_3", paprika="hole_2")
    truth = course.see(swapped, 3 * DWELL)
    assert truth.subgoals == (True,)
    assert not truth.goal, "the others were to be left where they were"


def test_a_preplaced_jar_that_is_taken_out_and_put_back_was_not_left_alone(start, put, posed):
    state, course = start("seasoning_rack", "L2")
    course.see(state)
    out = posed(
        put(state, "rack", salt="hole_1"), poses={"pepper": Pose((0.4, 0.0, 0.0))}, contacts=(("pepper", "table"),)
    )
    course.see(out)
    assert not course.see(put(state, "rack", salt="hole_1"), 3 * DWELL).success


def test_a_jar_in_the_wrong_hole_is_not_done_and_two_swapped_ones_are_neither(start, put):
    state, course = start("seasoning_rack", "train4")
    assert course.done(state) == set()
    assert course.done(put(state, "rack", salt="hole_2", pepper="hole_1")) == set()
    assert course.done(put(state, "rack", salt="hole_1", pepper="hole_3")) == {"salt_hole_1"}
    assert course.see(put(state, "rack", salt="hole_1", pepper="hole_2"), DWELL + 1).success


def test_a_plate_already_on_its_plate_is_done_from_the_start_and_the_rest_follows(start, put):
    state, course = start("dinner_plates", "T2")
    assert course.done(state) == {"red_plate_on_white_plate"}
    assert course.see(put(state, "red_plate", blue_plate="floor"), DWELL + 1).success


def test_the_upper_plate_first_is_out_of_order(start, put, posed):
    state, course = start("dinner_plates", "T1")
    course.see(state)
    assert not course.see(put(state, "red_plate", blue_plate="floor")).in_order
    whole = put(put(state, "white_plate", red_plate="floor"), "white_plate")
    whole = put(whole, "red_plate", blue_plate="floor")
    truth = course.see(whole, 3 * DWELL)
    assert truth.subgoals == (True, True)
    assert not truth.success


def test_a_second_plate_on_the_plate_that_is_asked_for_spoils_the_goal(start, put, posed):
    """Judged by poses alone: two plates that both have their foot on the white one."""
    state, course = start("dinner_plates", "train1")
    course.see(state)
    truth = course.see(put(state, "white_plate", red_plate="floor", blue_plate="floor"), 3 * DWELL)
    assert truth.subgoals == (True,)
    assert not truth.goal, "the blue plate was not asked for"


# ----------------------------------------------------------------------------------------------------------- drawers


@pytest.fixture
def fill(posed):
    """A state in which things lie in drawers that stand open by a distance [m]."""

    def make(state, *, opened, **drawers):
        state = posed(state, poses={d: drawn(state, d, meters) for d, meters in opened.items()})
        for thing, drawer in drawers.items():
            pose = center_at(state, thing, (0.0, 0.0, 0.0), frame=region_frame(state, drawer, "inside"))
            state = posed(state, poses={thing: pose}, contacts=((thing, drawer),))
        return state

    return make


def test_a_drawer_is_closed_only_on_what_was_to_go_into_it(start, fill):
    state, course = start("office_drawer", "train1")
    assert course.done(state) == set(), "shut and empty is nothing done"
    assert course.done(fill(state, opened={"upper": 0.15})) == set()
    assert course.done(fill(state, opened={"upper": 0.15}, stapler="upper")) == {"load_stapler"}
    assert course.done(fill(state, opened={"upper": 0.006}, stapler="upper")) == {"load_stapler"}
    shut = fill(state, opened={"upper": 0.001}, stapler="upper")
    assert course.done(shut) == {"load_stapler", "close_upper"}
    assert course.see(shut, DWELL).success


def test_shutting_the_drawer_on_nothing_or_on_the_wrong_thing_is_nothing_done(start, fill):
    state, course = start("office_drawer", "train2")
    assert course.done(state) == set()
    assert course.done(fill(state, opened={"upper": 0.0})) == set()
    assert course.done(fill(state, opened={"upper": 0.0}, tape="upper")) == set()
    assert not course.see(fill(state, opened={"upper": 0.0}, tape="upper"), 3 * DWELL).goal


def test_the_right_thing_in_the_wrong_drawer_is_nothing_done_and_spoils_the_goal(start, fill):
    state, course = start("office_drawer", "train1")
    course.see(state)
    assert course.done(fill(state, opened={"lower": 0.0}, stapler="lower")) == set()
    truth = course.see(fill(state, opened={}, stapler="upper", tape="lower"), 3 * DWELL)
    assert all(truth.subgoals)
    assert not truth.goal, "the tape was to stay on the table"
    assert not course.see(fill(state, opened={}, stapler="upper"), 3 * DWELL).success, "and was carried about"


def test_a_second_thing_in_the_right_drawer_spoils_the_goal(start, fill, posed):
    state, course = start("office_drawer", "train1")
    course.see(state)
    truth = course.see(fill(state, opened={}, stapler="upper", tape="upper"), 3 * DWELL)
    assert all(truth.subgoals)
    assert not truth.goal


def test_both_drawers_need_their_own_thing(start, fill):
    state, course = start("office_drawer", "T2")
    assert course.done(state) == set()
    everything = {"load_stapler", "close_upper", "load_tape", "close_lower"}
    assert course.done(fill(state, opened={}, stapler="upper")) == {"load_stapler", "close_upper"}
    assert course.done(fill(state, opened={"lower": 0.15}, stapler="upper", tape="lower")) == everything - {
        "close_lower"
    }
    swapped = fill(state, opened={}, stapler="lower", tape="upper")
    assert course.done(swapped) == set()
    right = fill(state, opened={}, stapler="upper", tape="lower")
    assert course.done(right) == everything
    assert course.see(right, DWELL).success


def test_an_open_drawer_after_all_is_undone_again(start, fill):
    state, course = start("office_drawer", "train1")
    course.see(state)
    course.see(fill(state, opened={}, stapler="upper"), DWELL)
    assert not course.see(fill(state, opened={"upper": 0.02}, stapler="upper")).goal
    assert not course.see(fill(state, opened={}, stapler="upper"), DWELL).success
    assert course.see(fill(state, opened={}, stapler="upper")).success


# ------------------------------------------------------------------------------------------------------------ layers


@pytest.fixture
def pile(posed):
    def make(state, *things):
        poses, touches = {}, []
        z, below = state.info.object("bottom_bun").region("top").position[2], "bottom_bun"
        for thing in things:
            poses[thing] = foot_at(state, thing, (0.0, 0.0, z), frame=state.pose("bottom_bun"))
            touches.append((thing, below))
            z += state.info.object(thing).region("top").position[2]
            below = thing
        return posed(state, poses=poses, contacts=tuple(touches))

    return make


def test_layers_one_after_the_other_succeed(start, pile):
    state, course = start("cheeseburger", "train1")
    course.see(state)
    for things in (("patty",), ("patty", "cheese")):
        truth = course.see(pile(state, *things))
        assert sum(truth.subgoals) == len(things)
        assert truth.in_order
    assert course.see(pile(state, "patty", "cheese", "top_bun"), DWELL + 1).success


def test_a_burger_built_in_another_order_is_not_the_one_that_was_asked_for(start, pile):
    state, course = start("cheeseburger", "train1")
    course.see(state)
    for things in (("cheese",), ("cheese", "patty"), ("cheese", "patty", "top_bun")):
        truth = course.see(pile(state, *things), 3 * DWELL)
        assert not truth.goal
    assert not truth.success


def test_a_top_bun_in_the_second_layer_is_not_done_in_the_third(start, pile):
    state, course = start("cheeseburger", "train1")
    course.see(state)
    course.see(pile(state, "patty"))
    assert course.see(pile(state, "patty", "top_bun"), 3 * DWELL).subgoals == (True, False, False)
    assert not course.see(pile(state, "patty", "top_bun", "cheese"), 3 * DWELL).success


def test_a_layer_too_many_spoils_the_goal(start, pile):
    state, course = start("cheeseburger", "train1")
    for things in ((), ("patty",), ("patty", "cheese")):
        course.see(pile(state, *things))
    truth = course.see(pile(state, "patty", "cheese", "top_bun", "lettuce"), 3 * DWELL)
    assert all(truth.subgoals)
    assert not truth.goal
    assert not truth.success


def test_a_preplaced_patty_is_done_from_the_start(start, pile):
    state, course = start("cheeseburger", "T1")
    assert course.done(state) == {"layer_1_patty"}
    course.see(pile(state, "patty", "cheese"))
    assert course.see(pile(state, "patty", "cheese", "top_bun"), DWELL + 1).success


@pytest.mark.parametrize(("first", "second"), [("patty", "patty_2"), ("patty_2", "patty")])
def test_two_patties_are_two_patties_in_either_order(start, pile, first, second):
    state, course = start("cheeseburger", "T2")
    course.see(state)
    assert course.see(pile(state, first)).subgoals == (True, False, False), "one patty is not two"
    assert course.see(pile(state, first, second)).subgoals == (True, True, False)
    assert course.see(pile(state, first, second, "top_bun"), DWELL + 1).success


def test_one_patty_and_something_else_are_not_two_patties(start, pile):
    state, course = start("cheeseburger", "T2")
    course.see(state)
    course.see(pile(state, "patty"))
    truth = course.see(pile(state, "patty", "lettuce", "top_bun"), 3 * DWELL)
    assert truth.subgoals == (True, False, True)
    assert not truth.success


def test_two_napkins_need_two_napkins_in_the_bin(start, posed):
    state, course = start("tidy_desk", "T1")
    frame = region_frame(state, "bin", "inside")
    spots = {"napkin": (-0.03, 0.0, 0.0), "napkin_2": (0.03, 0.0, 0.0), "crushed_can": (0.0, 0.0, 0.04)}

    def thrown(*things):
        return posed(state, poses={n: center_at(state, n, spots[n], frame=frame) for n in things})

    course.see(state)
    assert course.see(thrown("napkin_2"), 3 * DWELL).subgoals == (True, False, False)
    assert course.see(thrown("napkin_2", "crushed_can"), 3 * DWELL).subgoals == (True, False, True)
    assert course.see(thrown("napkin_2", "crushed_can", "napkin"), DWELL + 1).success


# --------------------------------------------------------------------------------------------------------- any names


@pytest.mark.parametrize(
    "task_id", ["desk_meeting", "seasoning_rack", "office_drawer", "cheeseburger", "dinner_plates"]
)
def test_names_and_listing_order_change_no_verdict(start, put, fill, pile, task_id):
    """The same course under other names, of which the condition says the same."""
    name = {"office_drawer": "T2", "dinner_plates": "T1", "cheeseburger": "T2"}.get(task_id, "train1")
    state, course = start(task_id, name)
    one, two = {
        "desk_meeting": lambda: (put(state, "laptop", mug="left"), put(state, "laptop", mug="left", mouse="right")),
        "seasoning_rack": lambda: (
            put(state, "rack", salt="hole_1"),
            put(state, "rack", salt="hole_1", pepper="hole_3"),
        ),
        "office_drawer": lambda: (fill(state, opened={}, stapler="upper"), fill(state, opened={}, tape="upper")),
        "cheeseburger": lambda: (pile(state, "patty_2"), pile(state, "patty_2", "patty", "top_bun")),
        "dinner_plates": lambda: (
            put(state, "white_plate", red_plate="floor"),
            put(state, "red_plate", blue_plate="floor"),
        ),
    }[task_id]()
    condition = condition_of(task_id, name)
    goals = tuple(dataclasses.replace(goal, target=other_name(goal.target)) for goal in condition.instruction.subgoals)
    other = condition.with_(
        objects=tuple(
            dataclasses.replace(
                o,
                name=other_name(o.name),
                mount=None if o.mount is None else dataclasses.replace(o.mount, target=other_name(o.mount.target)),
            )
            for o in reversed(condition.objects)
        ),
        layout={other_name(n): slot for n, slot in condition.layout.items()},
        instruction=dataclasses.replace(condition.instruction, subgoals=goals),
    )
    twin = course_of(renamed(state), other)
    seen = [course.see(s, n) for s, n in ((state, 1), (one, DWELL), (two, DWELL + 2))]
    again = [twin.see(renamed(s), n) for s, n in ((state, 1), (one, DWELL), (two, DWELL + 2))]
    for a, b in zip(seen, again, strict=True):
        assert (a.subgoals, a.in_order, a.goal, a.forbidden, a.success) == (
            b.subgoals,
            b.in_order,
            b.goal,
            b.forbidden,
            b.success,
        )
        assert sum(a.relations) == sum(b.relations)
    assert any(any(t.subgoals) for t in seen)


def test_two_targets_of_one_kind_are_told_apart(at_reset, fill):
    """Both drawers are watched even where only one is asked for, each with its own columns."""
    state = at_reset("office_drawer", "train1")
    course = course_of(state, condition_of("office_drawer", "train1"))
    truth = course.see(fill(state, opened={}, tape="lower"))
    holds = {n for n, h in zip(course.tracker.relation_names, truth.relations, strict=True) if h}
    assert holds == {"inside(tape, lower)", "closed(upper, cabinet.upper)", "closed(lower, cabinet.lower)"}


def test_one_object_does_not_stand_for_two_steps_of_its_kind(at_reset, put):
    """Salt is asked for in two holes at once: one jar cannot do both."""
    state = at_reset("seasoning_rack", "train1")
    condition = condition_of("seasoning_rack", "train1")
    goals = tuple(
        Subgoal(f"salt_{hole}", "in_hole", Reference(kind="salt jar"), "rack", "salt", region=hole)
        for hole in ("hole_1", "hole_3")
    )
    both = condition.with_(instruction=dataclasses.replace(condition.instruction, subgoals=goals))
    course = course_of(state, both)
    course.see(state)
    for hole in ("hole_1", "hole_3"):
        truth = course.see(put(state, "rack", salt=hole), 3 * DWELL)
        assert sum(truth.subgoals) == 1
        assert not truth.success
