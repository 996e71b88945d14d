"""Truth tables of the predicates on states posed by hand, a tenth of a millimeter to each side of every limit."""

from __future__ import annotations

import math

import pytest

from betterbench.errors import UnknownNameError
from betterbench.geometry import Pose, from_axis_angle, from_yaw, multiply, normalize, rotate
from betterbench.tasks import THRESHOLDS
from betterbench.tasks.relations import RestWatch, arm_still, relation, released, upright
from betterbench.tasks.relations.inside import inside
from betterbench.tasks.relations.on_ring import on_ring

TENTH_MM = 1e-4


def in_bag(state, x, y, z, turn=(1.0, 0.0, 0.0, 0.0), *, thing="fries"):
    """Pose of a thing whose box has its center at (x, y, z), as fractions of the bag's inner half sizes."""
    region = state.info.object("box").region("inside")
    height = state.info.object(thing).size_m[2]
    hx, hy, hz = region.half_size
    center = (state.pose("box") @ region.pose).apply((x * hx, y * hy, z * hz))
    q = normalize(multiply(state.pose("box").quaternion, turn))
    dx, dy, dz = rotate(q, (0.0, 0.0, 0.5 * height))
    return Pose((center[0] - dx, center[1] - dy, center[2] - dz), q)


@pytest.fixture
def food(at_reset):
    return at_reset("fast_food", "train1")


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_inside_ends_at_every_wall_floor_and_rim(food, posed, axis, sign):
    half = food.info.object("box").region("inside").half_size[axis]
    for meters, expected in ((half - TENTH_MM, True), (half + TENTH_MM, False)):
        at = [0.0, 0.0, 0.0]
        at[axis] = sign * meters / half
        assert inside(posed(food, poses={"fries": in_bag(food, *at)}), "fries", "box") is expected


def test_inside_middle_corners_and_outside(food, posed):
    for x, y, z, expected in (
        (0.0, 0.0, 0.0, True),
        (0.99, -0.99, 0.99, True),
        (1.5, 0.0, 0.0, False),
        (0.0, 0.0, 3.0, False),
        (1.02, 1.02, 0.0, False),
    ):
        assert inside(posed(food, poses={"fries": in_bag(food, x, y, z)}), "fries", "box") is expected


def test_inside_judges_the_center_of_a_leaning_object_and_not_its_origin(food, posed):
    lying = from_axis_angle((0.0, math.pi / 2, 0.0))
    centered = posed(food, poses={"fries": in_bag(food, 0.0, 0.0, 0.0, lying)})
    assert inside(centered, "fries", "box")
    out = posed(food, poses={"fries": in_bag(food, 1.05, 0.0, 0.0, lying)})
    origin_in_bag = food.pose("box").inverse().apply(out.pose("fries").position)
    half = food.info.object("box").region("inside").half_size
    assert abs(origin_in_bag[0]) < half[0], "the origin of the leaning object is still within the walls"
    assert not inside(out, "fries", "box")


@pytest.mark.parametrize(
    ("degrees", "expected"), [(0.0, True), (44.9, True), (45.1, False), (90.0, False), (180.0, False)]
)
def test_a_drink_must_not_lie_on_its_side_inside_and_fries_may(food, posed, degrees, expected):
    for about in ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0)):
        turn = from_axis_angle(tuple(math.radians(degrees) * v for v in about))
        drink, fries = (posed(food, poses={n: in_bag(food, 0.0, 0.0, 0.0, turn, thing=n)}) for n in ("drink", "fries"))
        assert inside(drink, "drink", "box") is expected
        assert relation("inside").anyhow(drink, "drink", "box") == ""
        assert inside(fries, "fries", "box")


def test_inside_turns_with_the_bag(food, posed):
    half = food.info.object("box").region("inside").half_size
    bag = Pose(food.pose("box").position, from_yaw(math.pi / 2))
    turned = posed(food, poses={"box": bag})
    beyond = 0.5 * (half[0] + half[1])
    world_x, world_y = (
        posed(turned, poses={"fries": Pose((bag.position[0] + dx, bag.position[1] + dy, 0.02))})
        for dx, dy in ((beyond, 0.0), (0.0, beyond))
    )
    assert inside(world_x, "fries", "box")
    assert not inside(world_y, "fries", "box")


def test_what_touches_the_table_is_not_inside_whatever_its_pose(food, posed):
    pose = in_bag(food, 0.0, 0.0, 0.0)
    assert inside(posed(food, poses={"fries": pose}, contacts=(("fries", "box"),)), "fries", "box")
    assert not inside(posed(food, poses={"fries": pose}, contacts=(("fries", "table"),)), "fries", "box")
    assert not inside(posed(food, poses={"fries": pose}, contacts=(("table", "fries"),)), "fries", "box")


def resting(*states):
    """Returns what a watch says of the fries and the drink after some states, seen at 20 Hz."""
    watch = RestWatch(rate_hz=20.0)
    for state in states:
        watch.see(state)
    return watch.at_rest("fries"), watch.at_rest("drink")


def test_a_held_object_is_inside_but_not_released(food, posed):
    pose = {"fries": in_bag(food, 0.0, 0.0, 0.0)}
    held = posed(food, poses=pose, contacts=(("left_finger", "fries"), ("right_finger", "fries")), held="fries")
    assert inside(held, "fries", "box")
    assert not released(held, "fries")
    assert released(held, "drink")


@pytest.mark.parametrize("part", ["left_finger", "right_finger", "hand"])
def test_released_means_no_part_of_the_gripper_touches(food, posed, part):
    assert released(food, "fries")
    assert not released(posed(food, contacts=((part, "fries"),)), "fries")
    assert not released(posed(food, contacts=(("fries", part),)), "fries")
    assert released(posed(food, contacts=(("arm", "fries"), ("fries", "drink"))), "fries")


def shifted(food, posed, meters=0.0, radians=0.0):
    pose = food.pose("fries")
    turned = normalize(multiply(from_yaw(radians), pose.quaternion))
    return posed(food, poses={"fries": Pose((pose.position[0] + meters, *pose.position[1:]), turned)})


def test_rest_ends_at_its_displacement_within_a_quarter_second(food, posed):
    assert resting(food) == (True, True), "what stands at reset is at rest"
    for meters, radians, expected in (
        (THRESHOLDS.rest_travel - 1e-6, 0.0, True),
        (THRESHOLDS.rest_travel + 1e-6, 0.0, False),
        (0.0, THRESHOLDS.rest_turn - 1e-6, True),
        (0.0, THRESHOLDS.rest_turn + 1e-6, False),
    ):
        before = shifted(food, posed, meters, radians)
        assert resting(before, food) == (expected, True)
        assert resting(before, *[food] * 5) == (expected, True), "a quarter second lies between first and last"
        assert resting(before, *[food] * 6) == (True, True)


def test_a_thing_that_trembles_without_moving_is_at_rest(food, posed):
    """The top bun of a finished burger read 0.3 to 1.0 rad/s for six seconds, and moved by 0.06 mm."""
    trembling = [
        posed(shifted(food, posed, 3e-5 * (-1) ** k, 0.002 * (-1) ** k), speeds={"fries": 0.03}, turning={"fries": 1.0})
        for k in range(20)
    ]
    assert resting(*trembling) == (True, True)


def test_slow_motion_and_swaying_are_no_rest(food, posed):
    creeping = [shifted(food, posed, 0.02 * 0.05 * k) for k in range(20)]
    assert resting(*creeping) == (False, True), "2 cm/s"
    swaying = [shifted(food, posed, 0.004 * math.sin(1.3 * k)) for k in range(20)]
    assert resting(*swaying) == (False, True)


def test_upright_ends_at_five_degrees_whatever_the_yaw(food, posed):
    for degrees, expected in ((4.9, True), (5.1, False), (180.0, False)):
        for yaw in (0.0, 1.0, -2.5):
            q = normalize(multiply(from_axis_angle((math.radians(degrees), 0.0, 0.0)), from_yaw(yaw)))
            state = posed(food, poses={"fries": Pose(food.pose("fries").position, q)})
            assert upright(state, "fries") is expected


def test_arm_still_looks_at_every_joint(food, posed):
    for joint in range(7):
        for speed, expected in ((0.049, True), (0.051, False), (-0.051, False)):
            speeds = [0.0] * 7
            speeds[joint] = speed
            assert arm_still(posed(food, joint_velocities=tuple(speeds))) is expected


@pytest.fixture
def coffee(at_reset):
    return at_reset("morning_coffee", "train1")


def on_tray(state, *, dx=0.0, dy=0.0, dz=0.0, turn=0.0, tilt=0.0, name="red_mug"):
    """Pose of the mug whose foot is off the ring's center by (dx, dy, dz) [m] in the machine's frame."""
    machine = state.pose("coffee_machine")
    ring = state.info.object("coffee_machine").region("ring").position
    goal = machine.apply((ring[0] + dx, ring[1] + dy, ring[2] + dz))
    q = normalize(multiply(machine.quaternion, multiply(from_yaw(turn), from_axis_angle((0.0, tilt, 0.0)))))
    base = next((r.position for r in state.info.object(name).regions if r.name == "base"), (0.0, 0.0, 0.0))
    x, y, z = rotate(q, base)
    return Pose((goal[0] - x, goal[1] - y, goal[2] - z), q)


def judged(state, posed, **where):
    return on_ring(posed(state, poses={"red_mug": on_tray(state, **where)}), "red_mug", "coffee_machine")


@pytest.mark.parametrize("angle", [0.0, 0.7, math.pi / 2, 2.5, math.pi, -1.2])
def test_on_ring_ends_at_fifteen_millimeters_in_every_direction(coffee, posed, angle):
    for millimeters, expected in ((0.0, True), (14.9, True), (15.1, False), (30.0, False)):
        r = millimeters * 1e-3
        assert judged(coffee, posed, dx=r * math.cos(angle), dy=r * math.sin(angle)) is expected


@pytest.mark.parametrize(("degrees", "expected"), [(0.0, True), (4.0, True), (-4.0, True), (6.0, False), (-6.0, False)])
def test_on_ring_ends_at_five_degrees_of_tilt(coffee, posed, degrees, expected):
    assert judged(coffee, posed, tilt=math.radians(degrees)) is expected


@pytest.mark.parametrize(
    ("dz", "expected"), [(0.0, True), (0.0059, True), (-0.0059, True), (0.0061, False), (-0.0061, False), (0.05, False)]
)
def test_on_ring_ends_at_its_height(coffee, posed, dz, expected):
    assert judged(coffee, posed, dz=dz) is expected


def test_on_ring_wants_the_handle_clear_of_the_spout(coffee, posed):
    """The spout is on the machine's side of the ring, -x: a handle that points there is under it."""
    assert judged(coffee, posed, turn=0.0)
    assert judged(coffee, posed, turn=0.5)
    assert not judged(coffee, posed, turn=math.pi)


def test_a_thing_without_a_handle_may_be_turned_any_way(at_reset, posed):
    state = at_reset("morning_coffee", "O1")
    for turn in (0.0, math.pi / 2, math.pi):
        there = posed(state, poses={"red_can": on_tray(state, turn=turn, name="red_can")})
        assert on_ring(there, "red_can", "coffee_machine")


def test_mugs_at_their_slots_are_not_on_the_ring(coffee):
    assert not on_ring(coffee, "red_mug", "coffee_machine")
    assert not on_ring(coffee, "blue_mug", "coffee_machine")


def test_unknown_relation_is_refused_with_those_that_exist():
    assert relation("inside").holds
    with pytest.raises(UnknownNameError, match="Did you mean 'inside'"):
        relation("insid")
