"""Truth tables of the relations with places, half a millimeter to each side of every limit.

Every verdict is asked for by :func:`tests.tasks.posing.where`, which asks again with the scene turned, moved and
renamed.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.tasks.posing import (
    HALF_MM,
    MM,
    MOVES,
    along,
    base_of,
    center_at,
    drawn,
    foot_at,
    half_size,
    moved,
    other_name,
    region_frame,
    renamed,
    where,
)

from betterbench.geometry import Pose, distance, from_axis_angle, from_yaw, multiply, normalize, rotate, tilt_of
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import THRESHOLDS, GoalTracker, get_task
from betterbench.tasks.interventions import vary
from betterbench.tasks.interventions.balanced import balanced_conditions
from betterbench.tasks.relations import RELATIONS, relation, released
from betterbench.tasks.relations.beside import side_of
from betterbench.tasks.relations.loose import lowest
from betterbench.tasks.relations.relation import SHARED

LIMITS = THRESHOLDS.to_json()
ANGLES = (0.0, 0.9, math.pi / 2, 2.4, math.pi, -1.1)
FLAWS = (
    {"contacts": (("left_finger", "?"),)},
    {"contacts": (("?", "right_finger"),)},
    {"contacts": (("hand", "?"),)},
    {"moved": THRESHOLDS.rest_travel + 1e-6},
    {"turned": THRESHOLDS.rest_turn + 1e-6},
)
"""What keeps a thing at its place from counting: something of the hand still touches it, or it still moves."""


def condition_of(task_id, name):
    task = get_task(task_id)
    return task.train(name) if name.startswith("train") else vary(task, task.variation(name))[0]


def subgoals(states, task_id, name):
    """Returns which subgoals are done in the last of some states, or in the only one."""
    states = states if isinstance(states, tuple) else (states,)
    condition = condition_of(task_id, name)
    tracker = GoalTracker(condition, states[0].info, template=get_task(task_id).template, control_rate_hz=20.0)
    truths = [tracker.update(state) for state in states]
    return dict(zip(tracker.subgoal_names, truths[-1].subgoals, strict=True))


def spoil(posed, state, thing, flaw):
    """Returns states of which the last has a flaw of :data:`FLAWS`; the thing lies as in the state given."""
    if "contacts" in flaw:
        mine = tuple((thing if a == "?" else a, thing if b == "?" else b) for a, b in flaw["contacts"])
        return (posed(state, contacts=mine),)
    pose, turn = state.pose(thing), from_yaw(flaw.get("turned", 0.0))
    x, y, z = pose.position
    before = Pose((x + flaw.get("moved", 0.0), y, z), normalize(multiply(turn, pose.quaternion)))
    return (posed(state, poses={thing: before}), state)


def test_points_of_view_differ_and_keep_distances(at_reset):
    state = at_reset("dinner_plates", "T1")
    for motion in MOVES:
        seen = moved(state, motion)
        assert seen.pose("red_plate") != state.pose("red_plate")
        for a, b in (("red_plate", "white_plate"), ("red_plate", "blue_plate")):
            before = distance(state.pose(a).position, state.pose(b).position)
            assert distance(seen.pose(a).position, seen.pose(b).position) == pytest.approx(before)
            assert tilt_of(seen.pose(a).quaternion) == pytest.approx(tilt_of(state.pose(a).quaternion), abs=1e-6)
    seen = renamed(state)
    assert not {o.name for o in seen.info.objects} & {o.name for o in state.info.objects}
    for o in state.info.objects:
        assert seen.pose(other_name(o.name)) == state.pose(o.name)
        assert seen.touching("table", other_name(o.name)) == state.touching(o.name, "table")


def test_every_relation_has_its_truth_table():
    """`inside` and `on_ring` of open containers and machines have theirs in test_predicates, a new one in its file."""
    here = {"inside", "on_ring", "beside", "in_hole", "layer", "on_plate", "closed"}
    assert here <= set(RELATIONS)
    for name in set(RELATIONS) - here:
        file = Path(__file__).with_name(f"test_{name}.py")
        assert file.is_file(), f"write {file.name} with posed objects at every limit (docs/adding-a-relation.md)"
        assert f'where("{name}", ' in file.read_text(), "ask tests.tasks.posing.where about every limit"


# ------------------------------------------------------------------------------------------------------------ beside


class Spot(NamedTuple):
    """A side of an anchor and something to put there."""

    task: str
    anchor: str
    side: str
    thing: str


SIDES = [
    *(Spot("desk_meeting", "laptop", side, t) for side in ("left", "right", "behind") for t in ("mug", "speaker")),
    *(Spot("breakfast_table", "plate", side, t) for side in ("left", "right", "upper_right") for t in ("cup", "fork")),
]
each_side = pytest.mark.parametrize("spot", SIDES, ids=[f"{s.side}-{s.thing}" for s in SIDES])
each_border = pytest.mark.parametrize("border", [(axis, sign) for axis in (0, 1) for sign in (-1.0, 1.0)])


def lay(state, posed, anchor, side, thing, *, at=(0.0, 0.0, 0.0), contacts=None, **pose):
    frame = region_frame(state, anchor, side)
    touches = ((thing, "table"),) if contacts is None else contacts
    return posed(state, poses={thing: foot_at(state, thing, at, frame=frame, **pose)}, contacts=touches)


@each_side
def test_beside_in_the_middle_of_a_side_and_of_no_other(at_reset, posed, spot):
    task, anchor, side, thing = spot
    state = at_reset(task, "train1")
    assert where("beside", state, thing, anchor) is None, "nothing is beside the anchor at the start"
    there = lay(state, posed, anchor, side, thing)
    assert where("beside", there, thing, anchor) == side
    for place in RELATIONS["beside"].regions(state.info.object(anchor)):
        assert relation("beside").holds(there, thing, anchor, place) is (place == side)


def at_side(state, posed, anchor, thing, at):
    """Return the state with the foot of a thing on the table at a point of the anchor's frame [m]."""
    pose = foot_at(state, thing, (*at, 0.0), frame=state.pose(anchor))
    return posed(state, poses={thing: pose}, contacts=((thing, "table"),))


@each_side
def test_beside_holds_in_the_whole_place_of_each_side(at_reset, posed, spot):
    """The places that were accepted before, within which experts put things, are part of the sides."""
    task, anchor, side, thing = spot
    state = at_reset(task, "train1")
    dx, dy, _ = half_size(state, anchor, side)
    for sx, sy in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        at = (sx * (dx - HALF_MM), sy * (dy - HALF_MM), 0.0)
        if side == "upper_right" and (sx, sy) == (1, 1):
            continue  # the corner nearest to the right
        assert where("beside", lay(state, posed, anchor, side, thing, at=at), thing, anchor) == side


@pytest.mark.parametrize(
    "case",
    [
        ("desk_meeting", "laptop", "mouse", "side_reach", "side_least"),
        ("breakfast_table", "plate", "cup", "side_close", "side_close_least"),
    ],
    ids=["laptop", "plate"],
)
def test_beside_ends_far_from_the_edge_and_beyond_the_corners(at_reset, posed, case):
    task, anchor, thing, reach, nearest = case
    state = at_reset(task, "train1")
    width, depth, _ = (0.5 * size for size in state.info.object(anchor).size_m)
    beyond, least = LIMITS["side_beyond"], LIMITS[nearest]
    for sign, side in ((1.0, "right"), (-1.0, "left")):
        for away, expected in (
            (least - HALF_MM, None),
            (least + HALF_MM, side),
            (LIMITS[reach] - HALF_MM, side),
            (LIMITS[reach] + HALF_MM, None),
        ):
            there = at_side(state, posed, anchor, thing, (0.0, sign * (depth + away)))
            assert where("beside", there, thing, anchor) == expected
        for x, expected in ((width + beyond - HALF_MM, side), (width + beyond + HALF_MM, None)):
            there = at_side(state, posed, anchor, thing, (x, sign * (depth + 0.05)))
            assert where("beside", there, thing, anchor) == expected
        there = at_side(state, posed, anchor, thing, (width + 0.02, sign * (depth + 0.016)))
        assert where("beside", there, thing, anchor) is None, "nearer to the front than to the side"


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [
        (23.0, {"right"}),
        (25.0, {"right", "upper_right"}),
        (44.0, {"right", "upper_right"}),
        (46.0, {"upper_right"}),
        (76.0, {"upper_right"}),
        (78.0, set()),
    ],
)
def test_upper_right_of_a_plate_is_between_right_and_behind_and_shares_its_lower_half_with_right(
    at_reset, posed, degrees, expected
):
    state = at_reset("breakfast_table", "train1")
    away = 0.5 * state.info.object("plate").size_m[0] + 0.05
    x, y = -away * math.sin(math.radians(degrees)), away * math.cos(math.radians(degrees))
    there = at_side(state, posed, "plate", "cup", (x, y))
    kind, sides = relation("beside"), ("left", "right", "upper_right")
    assert {side for side in sides if kind.holds(there, "cup", "plate", side)} == expected
    condition = condition_of("breakfast_table", "train1")
    tracker = GoalTracker(condition, state.info, template=get_task("breakfast_table").template, control_rate_hz=20.0)
    truth = dict(zip(tracker.relation_names, tracker.update(there).relations, strict=True))
    assert {side for side in sides if truth[kind.label("cup", "plate", side)]} == expected


@pytest.mark.parametrize("degrees", [50.0, 60.0, 75.0])
def test_the_upper_right_of_a_plate_reaches_equally_far_in_its_directions(at_reset, posed, degrees):
    state = at_reset("breakfast_table", "train1")
    radius, reach = 0.5 * state.info.object("plate").size_m[0], LIMITS["side_close_diagonal"]
    for away, expected in ((reach - HALF_MM, "upper_right"), (reach + HALF_MM, None)):
        r = radius + away
        x, y = -r * math.sin(math.radians(degrees)), r * math.cos(math.radians(degrees))
        assert where("beside", at_side(state, posed, "plate", "cup", (x, y)), "cup", "plate") == expected


def test_the_upper_right_of_a_plate_ends_where_its_right_side_ends(at_reset, posed):
    """Otherwise a cup that starts to the right of the plate might be at the upper right."""
    state = at_reset("breakfast_table", "train1")
    edge = 0.5 * state.info.object("plate").size_m[0] + LIMITS["side_close"]
    for y, expected in ((edge - HALF_MM, f"right{SHARED}upper_right"), (edge + HALF_MM, None)):
        assert where("beside", at_side(state, posed, "plate", "cup", (-0.09, y)), "cup", "plate") == expected


def test_the_edge_of_a_plate_is_round(at_reset, posed):
    """A piece low beside a plate is on its right, although it is not to the right of the plate's rightmost point."""
    state = at_reset("breakfast_table", "train1")
    r = 0.5 * state.info.object("plate").size_m[0] + LIMITS["side_close_least"]
    for degrees, more, expected in (
        (30.0, HALF_MM, "right"),
        (30.0, -HALF_MM, None),
        (44.0, HALF_MM, "right"),
        (46.0, HALF_MM, None),
    ):
        x, y = (r + more) * math.sin(math.radians(degrees)), (r + more) * math.cos(math.radians(degrees))
        for sign, side in ((1.0, "right"), (-1.0, "left")):
            there = at_side(state, posed, "plate", "spoon", (x, sign * y))
            assert where("beside", there, "spoon", "plate") == (side if expected else None)


@pytest.mark.parametrize("turn", [0.5, math.pi / 2, 3.0])
def test_a_mouse_may_face_any_way_beside_a_laptop(at_reset, posed, turn):
    state = at_reset("desk_meeting", "train1")
    assert where("beside", lay(state, posed, "laptop", "right", "mouse", turn=turn), "mouse", "laptop") == "right"


def test_what_stands_at_a_side_was_brought_there_only_if_it_is_in_its_place(at_reset, posed):
    state = at_reset("desk_meeting", "train1")
    kind, depth = relation("beside"), 0.5 * state.info.object("laptop").size_m[1]
    far = at_side(state, posed, "laptop", "speaker", (0.0, depth + 0.15))
    assert (kind.where(far, "speaker", "laptop"), kind.brought(far, "speaker", "laptop")) == ("right", None)
    there = lay(state, posed, "laptop", "right", "speaker")
    assert kind.brought(there, "speaker", "laptop") == "right"
    assert [r.name for r in RELATIONS.values() if r.wide] == ["beside"]


@pytest.mark.parametrize("task", ["desk_meeting", "breakfast_table"])
def test_nothing_is_at_a_side_at_the_start_wherever_it_may_stand(task):
    """Slots keep 3 mm more than their jitter from every side, in training, variations and balanced training alike."""
    anchor = {"desk_meeting": "laptop", "breakfast_table": "plate"}[task]
    definition = get_task(task)
    conditions = (
        *definition.training,
        *(vary(definition, v)[0] for v in definition.variations),
        *balanced_conditions(task),
    )
    for condition in conditions:
        scene = Scene(definition, condition, seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
        state = scene.reset(check_premise=False)
        slots = {s.name: s for s in definition.slots}
        for name, slot in condition.layout.items():
            if state.info.object(name).role != "item":
                continue
            mine, its = slots[slot], slots[condition.layout[anchor]]
            off = mine.jitter_m + its.jitter_m + 0.003
            middle = Pose((its.x, its.y, 0.0), from_yaw(0.0)).inverse().apply((mine.x, mine.y, 0.0))
            for sx, sy in itertools.product((-off, 0.0, off), repeat=2):
                found = side_of(state.info.object(anchor), middle[0] + sx, middle[1] + sy)
                assert found is None, f"{condition.name}: {name} may stand at {found} in {slot}"


@each_side
def test_beside_wants_it_upright_on_the_table(at_reset, posed, spot):
    task, anchor, side, thing = spot
    state = at_reset(task, "train1")
    limit = LIMITS["side_level"] if thing == "fork" else THRESHOLDS.upright_tilt
    for tilt, expected in ((limit - 0.002, side), (0.002 - limit, side), (limit + 0.002, None), (-limit - 0.002, None)):
        assert where("beside", lay(state, posed, anchor, side, thing, tilt=tilt), thing, anchor) == expected
    assert where("beside", lay(state, posed, anchor, side, thing, tilt=math.pi / 2), thing, anchor) is None
    if thing != "fork":
        assert where("beside", lay(state, posed, anchor, side, thing, tilt=math.pi), thing, anchor) is None
    assert where("beside", lay(state, posed, anchor, side, thing, contacts=()), thing, anchor) is None
    on_anchor = lay(state, posed, anchor, side, thing, contacts=((thing, anchor),))
    assert where("beside", on_anchor, thing, anchor) is None


@each_side
def test_beside_ends_above_the_table_even_if_an_edge_touches_it(at_reset, posed, spot):
    task, anchor, side, thing = spot
    state = at_reset(task, "train1")
    for z, expected in ((LIMITS["side_height"] - HALF_MM, side), (LIMITS["side_height"] + HALF_MM, None)):
        assert where("beside", lay(state, posed, anchor, side, thing, at=(0.0, 0.0, z)), thing, anchor) == expected


@pytest.mark.parametrize(("anchor_yaw", "sign"), [(0.0, 1.0), (0.0, -1.0), (2.5, 1.0), (-3.0, -1.0)])
def test_cutlery_at_a_plate_points_away_from_the_eater(at_reset, posed, anchor_yaw, sign):
    state = at_reset("breakfast_table", "train1")
    state = posed(state, poses={"plate": Pose(state.pose("plate").position, from_yaw(anchor_yaw))})
    for turn, expected in (
        (0.0, "left"),
        (LIMITS["side_turn"] - 0.005, "left"),
        (LIMITS["side_turn"] + 0.005, None),
        (math.pi / 2, None),
        (math.pi, None),
    ):
        there = lay(state, posed, "plate", "left", "fork", turn=sign * turn)
        assert where("beside", there, "fork", "plate") == expected


@pytest.mark.parametrize("thing", ["fork", "spoon"])
@pytest.mark.parametrize("anchor_yaw", [0.0, 2.5])
def test_cutlery_at_a_plate_may_lie_on_any_side(at_reset, posed, thing, anchor_yaw):
    state = at_reset("breakfast_table", "train1")
    state = posed(state, poses={"plate": Pose(state.pose("plate").position, from_yaw(anchor_yaw))})
    turn = LIMITS["side_turn"]
    for roll, heading, z, expected in (
        (math.pi, 0.0, 0.0, "left"),
        (math.pi / 2, 0.0, 0.0, "left"),
        (-math.pi / 2, 0.0, 0.0, "left"),
        (2.0, 0.0, 0.0, "left"),
        (math.pi, turn - 0.005, 0.0, "left"),
        (math.pi, -turn - 0.005, 0.0, None),
        (math.pi, math.pi, 0.0, None),
        (math.pi / 2, math.pi, 0.0, None),
        (math.pi, 0.0, LIMITS["side_height"] - HALF_MM, "left"),
        (math.pi, 0.0, LIMITS["side_height"] + HALF_MM, None),
    ):
        there = lay(state, posed, "plate", "left", thing)
        assert (
            where("beside", rolled_over(there, posed, thing, roll=roll, heading=heading, z=z), thing, "plate")
            == expected
        )


def rolled_over(state, posed, thing, *, roll, heading, z):
    """Return the state with a thing rolled about its length; its lowest point is at a height, where its middle was."""
    pose, height = state.pose(thing), state.info.object(thing).size_m[2]
    q = normalize(multiply(pose.quaternion, multiply(from_yaw(heading), from_axis_angle((roll, 0.0, 0.0)))))
    px, py, pz = pose.apply((0.0, 0.0, 0.5 * height))
    x, y, up = rotate(q, (0.0, 0.0, 0.5 * height))
    there = posed(state, poses={thing: Pose((px - x, py - y, pz - up), q)}, contacts=((thing, "table"),))
    raised = z - lowest(there, thing)
    return posed(there, poses={thing: Pose((px - x, py - y, pz - up + raised), q)}, contacts=((thing, "table"),))


def test_cutlery_may_lie_on_cutlery_that_lies_on_the_table(at_reset, posed):
    state = at_reset("breakfast_table", "train1")
    limit = LIMITS["side_crossing"]
    state = dataclasses.replace(state, contacts=())
    on_spoon, on_plate = (("fork", "spoon"), ("spoon", "table")), (("fork", "plate"), ("plate", "table"))
    for z, contacts, expected in (
        (0.014, on_spoon, "left"),
        (0.014, (*on_spoon, ("fork", "table")), "left"),
        (limit - HALF_MM, on_spoon, "left"),
        (limit + HALF_MM, on_spoon, None),
        (0.014, (("fork", "spoon"), ("spoon", "left_finger")), None),
        (0.014, on_plate, None),
        (0.014, (("fork", "table"),), None),
        (0.014, (("fork", "cup"), ("cup", "table")), None),
    ):
        there = lay(state, posed, "plate", "left", "fork", at=(0.0, 0.0, z), contacts=contacts)
        assert where("beside", there, "fork", "plate") == expected, (z, contacts)


def test_cutlery_that_leans_on_the_plate_is_not_next_to_it(at_reset, posed):
    state, contacts = at_reset("breakfast_table", "train1"), (("fork", "table"), ("fork", "plate"))
    for tilt, expected in ((THRESHOLDS.upright_tilt - 0.002, "left"), (THRESHOLDS.upright_tilt + 0.002, None)):
        there = lay(state, posed, "plate", "left", "fork", tilt=tilt, contacts=contacts)
        assert where("beside", there, "fork", "plate") == expected


@pytest.mark.parametrize("turn", [0.5, math.pi / 2, 3.0])
def test_beside_lets_what_has_no_direction_face_any_way(at_reset, posed, turn):
    state = at_reset("breakfast_table", "train1")
    assert where("beside", lay(state, posed, "plate", "left", "cup", turn=turn), "cup", "plate") == "left"


@each_side
@pytest.mark.parametrize("flaw", FLAWS)
def test_beside_counts_once_let_go_and_at_rest(at_reset, posed, spot, flaw):
    task, anchor, side, thing = spot
    state = at_reset(task, "train1")
    there = lay(state, posed, anchor, side, thing)
    flawed = spoil(posed, there, thing, flaw)
    assert where("beside", flawed[-1], thing, anchor) == side, "the place does not depend on the hand"
    name = f"{thing}_{side}"
    condition = next((c for c in get_task(task).training if any(g.name == name for g in c.instruction.subgoals)), None)
    if condition is not None:
        assert subgoals(there, task, condition.name)[name]
        assert not subgoals(flawed, task, condition.name)[name]


def test_beside_between_two_sides_is_none(at_reset, posed):
    state = at_reset("breakfast_table", "train1")
    frame = state.pose("plate")
    for angle in (0.0, 0.5, math.pi):
        pose = foot_at(state, "cup", along(angle, 0.14), frame=frame)
        assert where("beside", posed(state, poses={"cup": pose}, contacts=(("cup", "table"),)), "cup", "plate") is None
    on_it = posed(
        state, poses={"cup": foot_at(state, "cup", (0.0, 0.0, 0.007), frame=frame)}, contacts=(("cup", "plate"),)
    )
    assert where("beside", on_it, "cup", "plate") is None


# ----------------------------------------------------------------------------------------------------------- in_hole


@pytest.fixture
def rack(at_reset):
    return at_reset("seasoning_rack", "train1")


def stand(state, posed, hole, *, jar="salt", at=(0.0, 0.0, 0.0), **pose):
    frame = region_frame(state, "rack", hole)
    return posed(state, poses={jar: foot_at(state, jar, at, frame=frame, **pose)}, contacts=((jar, "rack"),))


HOLES = ("hole_1", "hole_2", "hole_3")


@pytest.mark.parametrize("hole", HOLES)
@pytest.mark.parametrize("jar", ["salt", "pepper", "paprika"])
def test_in_hole_on_the_floor_of_one_hole_and_of_no_other(rack, posed, hole, jar):
    assert where("in_hole", rack, jar, "rack") is None
    there = stand(rack, posed, hole, jar=jar)
    assert where("in_hole", there, jar, "rack") == hole
    assert [relation("in_hole").holds(there, jar, "rack", h) for h in HOLES] == [h == hole for h in HOLES]


@pytest.mark.parametrize("hole", HOLES)
@each_border
def test_in_hole_ends_at_the_clearance(rack, posed, hole, border):
    axis, sign = border
    half = half_size(rack, "rack", hole)[axis]
    for reach, expected in ((half - HALF_MM, hole), (half + HALF_MM, None)):
        at = [0.0, 0.0, 0.0]
        at[axis] = sign * reach
        assert where("in_hole", stand(rack, posed, hole, at=tuple(at)), "salt", "rack") == expected


@pytest.mark.parametrize("hole", HOLES)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_in_hole_ends_above_and_below_its_floor(rack, posed, hole, sign):
    for z, expected in ((LIMITS["hole_depth"] - HALF_MM, hole), (LIMITS["hole_depth"] + HALF_MM, None)):
        assert where("in_hole", stand(rack, posed, hole, at=(0.0, 0.0, sign * z)), "salt", "rack") == expected


@pytest.mark.parametrize("turn", [0.0, 1.0, -2.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_in_hole_ends_at_its_tilt(rack, posed, turn, sign):
    for tilt, expected in ((LIMITS["hole_tilt"] - 0.003, "hole_2"), (LIMITS["hole_tilt"] + 0.003, None)):
        assert where("in_hole", stand(rack, posed, "hole_2", turn=turn, tilt=sign * tilt), "salt", "rack") == expected
    assert where("in_hole", stand(rack, posed, "hole_2", tilt=math.pi), "salt", "rack") is None


def test_leaning_on_the_rim_standing_on_the_rack_and_standing_beside_it_are_in_no_hole(rack, posed):
    top = rack.info.object("rack").size_m[2]
    floor = rack.info.object("rack").region("hole_1").position[2]
    radius = 0.5 * rack.info.object("salt").size_m[0]
    y1, y2 = (rack.info.object("rack").region(h).position[1] for h in ("hole_1", "hole_2"))
    frame = rack.pose("rack")
    for what, point, tilt in (
        ("on the rack between two holes", (0.0, 0.5 * (y1 + y2), top), 0.0),
        ("across the mouth of a hole", (0.0, y1, top), 0.0),
        ("over the edge of a hole", (0.012, y1, top), 0.0),
        ("leaning out of a hole on its rim", (-0.003, y1, floor), 0.3),
        ("leaning on the rim with its foot in the air", (0.0, y1, floor + 0.01), 0.2),
        ("leaning from the table on the rack", (0.5 * rack.info.object("rack").size_m[0] + radius, y1, 0.0), -0.3),
        ("on the table before the hole", (0.5 * rack.info.object("rack").size_m[0] + radius + 0.002, y1, 0.0), 0.0),
        ("on the table under the rack", (0.0, y1, -0.001), 0.0),
    ):
        pose = foot_at(rack, "salt", point, frame=frame, tilt=tilt)
        there = posed(rack, poses={"salt": pose}, contacts=(("salt", "rack"), ("salt", "table")))
        if what == "on the table under the rack":
            # The floor of a hole is too near to the table for a foot to tell them apart by more than its tolerance.
            there = posed(rack, poses={"salt": pose.translated(z=-0.004)}, contacts=(("salt", "table"),))
        assert where("in_hole", there, "salt", "rack") is None, what


def test_what_stands_on_a_jar_is_in_no_hole_but_the_jar_is(rack, posed):
    floor = region_frame(rack, "rack", "hole_1")
    height = rack.info.object("salt").region("top").position[2]
    there = posed(
        rack,
        poses={
            "salt": foot_at(rack, "salt", (0.0, 0.0, 0.0), frame=floor),
            "pepper": foot_at(rack, "pepper", (0.0, 0.0, height), frame=floor),
        },
        contacts=(("salt", "rack"), ("salt", "pepper")),
    )
    assert where("in_hole", there, "salt", "rack") == "hole_1"
    assert where("in_hole", there, "pepper", "rack") is None


@pytest.mark.parametrize("flaw", FLAWS)
def test_in_hole_counts_once_let_go_and_at_rest(rack, posed, flaw):
    there = stand(rack, posed, "hole_1")
    assert subgoals(there, "seasoning_rack", "train1") == {"salt_hole_1": True}
    assert subgoals(spoil(posed, there, "salt", flaw), "seasoning_rack", "train1") == {"salt_hole_1": False}
    wrong = stand(rack, posed, "hole_2")
    assert subgoals(wrong, "seasoning_rack", "train1") == {"salt_hole_1": False}


# ------------------------------------------------------------------------------------------------------------- layer


@pytest.fixture
def burger(at_reset):
    return at_reset("cheeseburger", "train1")


def height_of(state, name):
    """Returns the height of the surface of an object on which the next one lies [m]."""
    return state.info.object(name).region("top").position[2]


def pile(state, posed, *things, tilt=0.0, base="bottom_bun", shift=None, lift=None, contacts=None):
    """Returns a state with things piled on the base, each with its offset [m] and extra height [m]."""
    poses, touches, z, below = {}, [], height_of(state, base), base
    for thing in things:
        dx, dy = (shift or {}).get(thing, (0.0, 0.0))
        z += (lift or {}).get(thing, 0.0)
        lean = tilt if thing == things[-1] else 0.0
        poses[thing] = foot_at(state, thing, (dx, dy, z), frame=state.pose(base), tilt=lean)
        touches.append((thing, below))
        z += height_of(state, thing)
        below = thing
    return posed(state, poses=poses, contacts=tuple(touches) if contacts is None else contacts)


def numbers(state, *things):
    return tuple(where("layer", state, thing, "bottom_bun") for thing in things)


def test_layers_are_counted_from_the_base_in_whatever_order_they_lie(burger, posed):
    assert numbers(burger, "patty", "cheese", "lettuce", "top_bun") == (None,) * 4
    for order in (("patty", "cheese", "top_bun"), ("top_bun", "cheese", "patty"), ("cheese",), ("lettuce", "patty")):
        assert numbers(pile(burger, posed, *order), *order) == ("1", "2", "3")[: len(order)]
    whole = ("patty", "cheese", "lettuce", "top_bun")
    assert numbers(pile(burger, posed, *whole), *whole) == ("1", "2", "3", "4")


@pytest.mark.parametrize("angle", ANGLES)
def test_layer_ends_at_its_offset_in_every_direction(burger, posed, angle):
    for meters, first, second in (
        (LIMITS["layer_offset"] - HALF_MM, "1", "2"),
        (LIMITS["layer_offset"] + HALF_MM, None, None),
    ):
        x, y, _ = along(angle, meters)
        low = pile(burger, posed, "patty", shift={"patty": (x, y)})
        assert numbers(low, "patty") == (first,)
        high = pile(burger, posed, "patty", "cheese", shift={"cheese": (x, y)})
        assert numbers(high, "patty", "cheese") == ("1", second)
        outside = pile(burger, posed, "patty", "cheese", shift={"patty": (x, y)})
        assert numbers(outside, "patty", "cheese") == (first, second), "what lies on a thing off the bun is no layer"


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_layer_ends_at_its_gap(burger, posed, sign):
    for meters, expected in ((LIMITS["layer_gap"] - HALF_MM, "2"), (LIMITS["layer_gap"] + HALF_MM, None)):
        there = pile(burger, posed, "patty", "cheese", lift={"cheese": sign * meters})
        assert numbers(there, "patty", "cheese") == ("1", expected)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_layer_ends_at_its_tilt(burger, posed, sign):
    for tilt, expected in ((LIMITS["layer_tilt"] - 0.003, "2"), (LIMITS["layer_tilt"] + 0.003, None)):
        assert numbers(pile(burger, posed, "patty", "top_bun", tilt=sign * tilt), "patty", "top_bun") == ("1", expected)
    assert numbers(pile(burger, posed, "patty", "top_bun", tilt=math.pi), "top_bun") == (None,), "upside down"


def test_layer_wants_touch_all_the_way_down(burger, posed):
    stack = ("patty", "cheese", "top_bun")
    links = (("bottom_bun", "patty"), ("patty", "cheese"), ("cheese", "top_bun"))
    for missing, expected in (
        (None, ("1", "2", "3")),
        (0, (None, None, None)),
        (1, ("1", None, None)),
        (2, ("1", "2", None)),
    ):
        kept = tuple(link for i, link in enumerate(links) if i != missing)
        assert numbers(pile(burger, posed, *stack, contacts=kept), *stack) == expected


def side_by_side(state, posed, *, bridge=None):
    """Returns a state with patty and cheese side by side on the bun, and perhaps something that lies on both."""
    shift = {"patty": (0.015, 0.0), "cheese": (-0.015, 0.0)}
    z = height_of(state, "bottom_bun")
    frame = state.pose("bottom_bun")
    poses = {n: foot_at(state, n, (*shift[n], z), frame=frame) for n in shift}
    touches = [("patty", "bottom_bun"), ("cheese", "bottom_bun")]
    if bridge is not None:
        poses[bridge] = foot_at(state, bridge, (0.0, 0.0, z + height_of(state, "patty")), frame=frame)
        touches += [(bridge, "patty"), (bridge, "cheese")]
    return posed(state, poses=poses, contacts=tuple(touches))


def test_two_things_in_one_layer_are_none(burger, posed):
    assert numbers(side_by_side(burger, posed), "patty", "cheese") == (None, None)


def test_what_bridges_two_things_is_no_layer(burger, posed):
    there = side_by_side(burger, posed, bridge="top_bun")
    assert numbers(there, "patty", "cheese", "top_bun") == (None, None, None)


def test_layer_under_the_bun_on_the_table_or_beside_it_is_none(burger, posed):
    frame = burger.pose("bottom_bun")
    patty = height_of(burger, "patty")
    upside_down = posed(
        burger,
        poses={
            "bottom_bun": frame.translated(z=patty),
            "patty": foot_at(burger, "patty", (0.0, 0.0, 0.0), frame=frame),
        },
        contacts=(("bottom_bun", "patty"), ("patty", "table")),
    )
    assert numbers(upside_down, "patty") == (None,), "the bun lies on the patty"
    beside = foot_at(burger, "patty", (0.08, 0.0, 0.0), frame=frame)
    leaning = foot_at(burger, "patty", (0.05, 0.0, 0.008), frame=frame, tilt=-0.6)
    for pose in (beside, leaning):
        there = posed(burger, poses={"patty": pose}, contacts=(("patty", "bottom_bun"), ("patty", "table")))
        assert numbers(there, "patty") == (None,)


@pytest.mark.parametrize("flaw", FLAWS)
def test_layer_counts_once_let_go_and_at_rest(burger, posed, flaw):
    names = ("layer_1_patty", "layer_2_cheese", "layer_3_top_bun")
    there = pile(burger, posed, "patty", "cheese")
    for state, expected in ((there, (True, True, False)), (spoil(posed, there, "cheese", flaw), (True, False, False))):
        done = subgoals(state, "cheeseburger", "train1")
        assert tuple(done[n] for n in names) == expected
    swapped = subgoals(pile(burger, posed, "cheese", "patty", "top_bun"), "cheeseburger", "train1")
    assert tuple(swapped[n] for n in names) == (False, False, True), "what lies in the wrong layer is not done"


# ---------------------------------------------------------------------------------------------------------- on_plate


@pytest.fixture
def plates(at_reset):
    return at_reset("dinner_plates", "T1")


def put_on(state, posed, *pairs, at=(0.0, 0.0, 0.0), tilt=0.0, contacts=None):
    """Returns a state with plates put on plates, from below; offset and tilt are those of the last."""
    poses, touches = {}, []
    for upper, lower in pairs:
        last = (upper, lower) == pairs[-1]
        on = poses.get(lower) or state.pose(lower)
        frame = on @ state.info.object(lower).region("floor").pose
        poses[upper] = foot_at(state, upper, at if last else (0.0,) * 3, frame=frame, tilt=tilt if last else 0.0)
        touches.append((upper, lower))
    return posed(state, poses=poses, contacts=tuple(touches) if contacts is None else contacts)


PAIRS = (("red_plate", "white_plate"), ("blue_plate", "white_plate"), ("blue_plate", "red_plate"))


def stacked(state):
    """Returns all pairs of plates of which one is seen on the other."""
    names = ("red_plate", "blue_plate", "white_plate")
    return {(a, b) for a in names for b in names if where("on_plate", state, a, b) is not None}


@pytest.mark.parametrize("pair", PAIRS)
def test_on_plate_sees_who_is_on_whom_and_nothing_else(plates, posed, pair):
    assert stacked(plates) == set()
    assert stacked(put_on(plates, posed, pair)) == {pair}


def test_on_plate_of_whole_stacks_right_and_wrong_way_up(plates, posed):
    red, blue, white = "red_plate", "blue_plate", "white_plate"
    assert stacked(put_on(plates, posed, (red, white), (blue, red))) == {(red, white), (blue, red)}
    assert stacked(put_on(plates, posed, (blue, white), (red, blue))) == {(blue, white), (red, blue)}
    assert stacked(put_on(plates, posed, (white, red))) == {(white, red)}
    goal = ("red_plate_on_white_plate", "blue_plate_on_red_plate")
    for pairs, expected in (
        (((red, white), (blue, red)), (True, True)),
        (((blue, white), (red, blue)), (False, False)),
        (((white, red), (blue, white)), (False, False)),
        (((red, blue),), (False, False)),
    ):
        done = subgoals(put_on(plates, posed, *pairs), "dinner_plates", "T1")
        assert tuple(done[g] for g in goal) == expected, pairs


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("angle", ANGLES)
def test_on_plate_ends_at_the_play_within_the_rim(plates, posed, pair, angle):
    for meters, expected in ((LIMITS["plate_offset"] - HALF_MM, ""), (LIMITS["plate_offset"] + HALF_MM, None)):
        assert where("on_plate", put_on(plates, posed, pair, at=along(angle, meters)), *pair) == expected


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_on_plate_ends_at_its_height_and_tilt(plates, posed, pair, sign):
    for meters, expected in ((LIMITS["plate_gap"] - HALF_MM, ""), (LIMITS["plate_gap"] + HALF_MM, None)):
        assert where("on_plate", put_on(plates, posed, pair, at=(0.0, 0.0, sign * meters)), *pair) == expected
    for tilt, expected in ((THRESHOLDS.upright_tilt - 0.002, ""), (THRESHOLDS.upright_tilt + 0.002, None)):
        assert where("on_plate", put_on(plates, posed, pair, tilt=sign * tilt), *pair) == expected
    assert where("on_plate", put_on(plates, posed, pair, tilt=math.pi), *pair) is None, "upside down"


@pytest.mark.parametrize("pair", PAIRS)
def test_on_plate_wants_touch_and_not_the_rim_or_the_table(plates, posed, pair):
    upper, lower = pair
    assert where("on_plate", put_on(plates, posed, pair, contacts=()), *pair) is None
    assert where("on_plate", put_on(plates, posed, pair, contacts=((upper, "table"),)), *pair) is None
    info = plates.info.object(lower)
    rim = info.region("rim").position[2] - info.region("floor").position[2]
    for at, tilt in (
        ((0.0, 0.0, rim), 0.0),
        ((0.03, 0.0, 0.5 * rim), 0.3),
        ((0.6 * info.size_m[0], 0.0, -0.016), -0.2),
    ):
        assert where("on_plate", put_on(plates, posed, pair, at=at, tilt=tilt), *pair) is None, "leaning on the rim"
    under = foot_at(plates, upper, (0.0, 0.0, 0.0), frame=plates.pose(lower))
    lifted = plates.pose(lower).translated(z=plates.info.object(upper).region("rim").position[2])
    there = posed(plates, poses={upper: under, lower: lifted}, contacts=((upper, "table"), (upper, lower)))
    assert where("on_plate", there, *pair) is None, "on the table, under the plate"


def test_a_plate_is_not_on_itself_and_a_bowl_on_a_plate_is_seen(at_reset, posed, plates):
    assert where("on_plate", plates, "red_plate", "red_plate") is None
    state = at_reset("dinner_plates", "O1")
    assert where("on_plate", put_on(state, posed, ("red_bowl", "white_plate")), "red_bowl", "white_plate") == ""


@pytest.mark.parametrize("flaw", FLAWS)
def test_on_plate_counts_once_let_go_and_at_rest(plates, posed, flaw):
    there = put_on(plates, posed, PAIRS[0])
    assert subgoals(there, "dinner_plates", "T1")["red_plate_on_white_plate"]
    assert not subgoals(spoil(posed, there, "red_plate", flaw), "dinner_plates", "T1")["red_plate_on_white_plate"]


# ------------------------------------------------------------------------------------------------------------ closed


@pytest.fixture
def drawers(at_reset):
    return at_reset("office_drawer", "T2")


@pytest.mark.parametrize("drawer", ["upper", "lower"])
def test_closed_ends_at_its_gap(drawers, posed, drawer):
    for millimeters, expected in (
        (0.0, drawer),
        (1.0, drawer),
        (4.5, drawer),
        (5.5, None),
        (6.0, None),
        (20.0, None),
        (150.0, None),
    ):
        there = posed(drawers, poses={drawer: drawn(drawers, drawer, millimeters * MM)})
        assert where("closed", there, drawer, "cabinet") == expected
        other = "lower" if drawer == "upper" else "upper"
        assert where("closed", there, other, "cabinet") == other, "the other drawer has no say"
        assert not relation("closed").holds(there, drawer, "cabinet", other)


def test_scenes_show_which_drawers_are_open(at_reset):
    for name, upper, lower in (("train1", "upper", "lower"), ("train2", None, "lower"), ("train4", "upper", None)):
        state = at_reset("office_drawer", name)
        assert where("closed", state, "upper", "cabinet") == upper
        assert where("closed", state, "lower", "cabinet") == lower


def test_a_drawer_in_the_wrong_mount_is_not_closed_where_it_belongs(drawers, posed):
    there = posed(drawers, poses={"upper": drawn(drawers, "lower", 0.0)})
    assert where("closed", there, "upper", "cabinet") == "lower"
    assert not relation("closed").holds(there, "upper", "cabinet", "upper")


@pytest.mark.parametrize("drawer", ["upper", "lower"])
@pytest.mark.parametrize("sideways", [(0.0, 0.006, 0.0), (0.0, 0.0, 0.006), (0.0, -0.006, 0.0), (-0.006, 0.0, 0.0)])
def test_a_drawer_off_its_rails_is_not_closed(drawers, posed, drawer, sideways):
    there = posed(drawers, poses={drawer: drawn(drawers, drawer, 0.0) @ Pose(sideways)})
    assert where("closed", there, drawer, "cabinet") is None


# ------------------------------------------------------------------------------------------------- inside of drawers


def into(state, posed, drawer, *, at=(0.0, 0.0, 0.0), thing="tape", opened=0.15, **fields):
    """Returns a state with a thing whose box has its center at a point of the opened drawer's inside."""
    pulled = posed(state, poses={drawer: drawn(state, drawer, opened)})
    pose = center_at(pulled, thing, at, frame=region_frame(pulled, drawer, "inside"))
    return posed(pulled, poses={thing: pose}, **fields)


@pytest.mark.parametrize("drawer", ["upper", "lower"])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_inside_of_a_drawer_ends_at_every_wall_its_floor_and_its_rim(drawers, posed, drawer, axis, sign):
    half = half_size(drawers, drawer, "inside")[axis]
    other = "lower" if drawer == "upper" else "upper"
    for meters, expected in ((half - HALF_MM, ""), (half + HALF_MM, None)):
        at = [0.0, 0.0, 0.0]
        at[axis] = sign * meters
        there = into(drawers, posed, drawer, at=tuple(at))
        assert where("inside", there, "tape", drawer) == expected
        assert where("inside", there, "tape", other) is None, "the wrong drawer"


@pytest.mark.parametrize("drawer", ["upper", "lower"])
@pytest.mark.parametrize("opened", [0.0, 0.001, 0.006, 0.15])
def test_a_thing_goes_with_its_drawer_whether_open_or_shut(drawers, posed, drawer, opened):
    there = into(drawers, posed, drawer, opened=opened)
    assert where("inside", there, "tape", drawer) == ""
    assert where("closed", there, drawer, "cabinet") == (drawer if opened < 0.005 else None)
    left_behind = posed(there, poses={drawer: drawn(drawers, drawer, opened + 0.12)})
    assert where("inside", left_behind, "tape", drawer) is None, "the drawer has gone and the thing has not"


def test_inside_a_drawer_under_or_on_something(drawers, posed):
    rim = half_size(drawers, "upper", "inside")[2]
    under = into(drawers, posed, "upper", at=(0.0, 0.0, 0.012 - rim))
    assert where("inside", under, "tape", "upper") == ""
    frame = region_frame(under, "upper", "inside")
    low = center_at(under, "stapler", (0.0, 0.0, rim - HALF_MM), frame=frame)
    high = center_at(under, "stapler", (0.0, 0.0, rim + HALF_MM), frame=frame)
    on = (("stapler", "tape"), ("tape", "upper"))
    assert where("inside", posed(under, poses={"stapler": low}, contacts=on), "stapler", "upper") == ""
    heaped = posed(under, poses={"stapler": high}, contacts=on)
    assert where("inside", heaped, "stapler", "upper") is None, "heaped above the rim"
    assert where("inside", heaped, "tape", "upper") == "", "under the stapler, and inside"


def test_on_the_table_under_a_drawer_and_on_the_cabinet_are_not_inside(drawers, posed):
    for drawer in ("upper", "lower"):
        there = into(drawers, posed, drawer, contacts=(("tape", "table"),))
        assert where("inside", there, "tape", drawer) is None, "it still touches the table"
    pulled = posed(drawers, poses={"lower": drawn(drawers, "lower", 0.15)})
    x, y, _ = pulled.pose("lower").position
    for pose, touches in (
        (Pose((x, y, 0.0)), (("tape", "table"),)),
        (Pose((x, y, -0.02)), ()),
        (drawers.pose("cabinet").translated(z=drawers.info.object("cabinet").size_m[2]), (("tape", "cabinet"),)),
    ):
        there = posed(pulled, poses={"tape": pose}, contacts=touches)
        assert [where("inside", there, "tape", d) for d in ("upper", "lower")] == [None, None]


def test_a_stapler_across_the_front_of_a_drawer_is_inside_with_its_center(drawers, posed):
    hx, _, hz = half_size(drawers, "upper", "inside")
    for tilt in (0.3, -0.3):
        for x, expected in ((hx - 2 * MM, ""), (hx + 2 * MM, None)):
            pulled = posed(drawers, poses={"upper": drawn(drawers, "upper", 0.15)})
            frame = region_frame(pulled, "upper", "inside")
            q = normalize(multiply(frame.quaternion, from_axis_angle((0.0, tilt, 0.0))))
            at = Pose(frame.apply((x, 0.0, hz - 5 * MM)), q)
            pose = at @ Pose((0.0, 0.0, -0.5 * drawers.info.object("stapler").size_m[2]))
            there = posed(pulled, poses={"stapler": pose}, contacts=(("stapler", "upper"),))
            assert where("inside", there, "stapler", "upper") == expected


@pytest.mark.parametrize("flaw", FLAWS)
def test_things_in_drawers_and_drawers_count_once_let_go_and_at_rest(drawers, posed, flaw):
    there = into(drawers, posed, "upper", thing="stapler", opened=0.001)
    assert subgoals(there, "office_drawer", "train1") == {"load_stapler": True, "close_upper": True}
    thing = spoil(posed, there, "stapler", flaw)
    assert subgoals(thing, "office_drawer", "train1") == {"load_stapler": False, "close_upper": False}
    if "turned" not in flaw:
        drawer = spoil(posed, there, "upper", flaw)
        assert subgoals(drawer, "office_drawer", "train1") == {"load_stapler": True, "close_upper": False}


def test_a_held_thing_at_its_place_is_there_but_not_released(drawers, posed):
    there = into(drawers, posed, "upper", thing="stapler")
    held = posed(there, contacts=(("left_finger", "stapler"), ("right_finger", "stapler")))
    held = dataclasses.replace(held, held="stapler")
    assert where("inside", held, "stapler", "upper") == ""
    assert not released(held, "stapler")
    assert subgoals(held, "office_drawer", "train1")["load_stapler"] is False


def test_feet_are_where_the_poses_of_this_file_put_them(at_reset):
    state = at_reset("desk_meeting", "train1")
    pose = foot_at(state, "mug", (0.1, 0.2, 0.0), turn=1.0, tilt=0.4)
    assert pose.apply(base_of(state, "mug")) == pytest.approx((0.1, 0.2, 0.0))
