"""Laws of rotations and poses: inverses, associativity, round trips and the ends of interpolation."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from betterbench.geometry import (
    IDENTITY_QUATERNION,
    TOOL_DOWN,
    Pose,
    angle_between,
    conjugate,
    distance,
    from_axis_angle,
    from_yaw,
    horizontal_distance,
    multiply,
    normalize,
    rotate,
    slerp,
    straight_way,
    tilt_of,
    to_axis_angle,
    to_axis_angle_near,
    turn_between,
    yaw_of,
)

NEAR = 1e-9
unit = st.floats(-1.0, 1.0)
meters = st.floats(-2.0, 2.0)
vectors = st.tuples(meters, meters, meters)
angles = st.floats(-3.1, 3.1)


@st.composite
def quaternions(draw):
    q = draw(st.tuples(unit, unit, unit, unit))
    assume(math.hypot(*q) > 1e-3)
    return normalize(q)


poses = st.builds(Pose, vectors, quaternions())


def law(*drawn):
    """Check a law for 40 examples: drawing the numbers of three poses takes a millisecond."""
    return lambda test: settings(max_examples=40)(given(*drawn)(test))


def same_vector(a, b, tolerance=NEAR):
    return all(abs(x - y) < tolerance for x, y in zip(a, b, strict=True))


def same_rotation(a, b, tolerance=1e-7):
    return angle_between(normalize(a), normalize(b)) < tolerance


def same_pose(a, b, tolerance=1e-7):
    return same_vector(a.position, b.position, tolerance) and same_rotation(a.quaternion, b.quaternion, tolerance)


@law(quaternions())
def test_normalized_is_unit_with_positive_w_and_idempotent(q):
    assert math.isclose(math.hypot(*q), 1.0, rel_tol=1e-12)
    assert q[0] >= 0.0
    assert same_vector(normalize(q), q, 1e-15)
    assert same_vector(normalize([-c for c in q]), q, 1e-15) or q[0] == 0.0


def test_zero_quaternion_is_refused():
    with pytest.raises(ValueError, match="zero length"):
        normalize((0.0, 0.0, 0.0, 0.0))


@law(quaternions())
def test_conjugate_is_the_inverse(q):
    assert same_vector(multiply(q, conjugate(q)), IDENTITY_QUATERNION)
    assert same_vector(multiply(conjugate(q), q), IDENTITY_QUATERNION)


@law(quaternions(), quaternions(), quaternions())
def test_product_is_associative(a, b, c):
    assert same_vector(multiply(multiply(a, b), c), multiply(a, multiply(b, c)))


@law(quaternions(), quaternions(), vectors)
def test_product_rotates_by_the_right_factor_first(a, b, v):
    assert same_vector(rotate(multiply(a, b), v), rotate(a, rotate(b, v)))


@law(quaternions(), vectors, vectors)
def test_rotation_keeps_lengths_angles_and_handedness(q, v, w):
    rv, rw = rotate(q, v), rotate(q, w)
    assert math.isclose(math.hypot(*rv), math.hypot(*v), abs_tol=NEAR)
    assert math.isclose(
        sum(a * b for a, b in zip(rv, rw, strict=True)), sum(a * b for a, b in zip(v, w, strict=True)), abs_tol=NEAR
    )

    def cross(a, b):
        return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])

    assert same_vector(cross(rv, rw), rotate(q, cross(v, w)), 1e-8)


@law(st.tuples(angles, angles, angles))
def test_axis_angle_round_trip_up_to_half_a_turn(v):
    assume(math.hypot(*v) < math.pi - 1e-3)
    assert same_vector(to_axis_angle(from_axis_angle(v)), v, 1e-8)


@law(quaternions(), quaternions())
def test_axis_angle_near_is_the_same_rotation_whatever_the_sign(q, near):
    v = to_axis_angle_near(q, near)
    assert angle_between(from_axis_angle(v), q) < 1e-6
    assert (
        to_axis_angle_near(tuple(-c for c in q), near) == v or sum(a * b for a, b in zip(q, near, strict=True)) == 0.0
    )


@law(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-2.5, 2.5))
def test_axis_angle_near_a_tool_that_points_down_is_continuous(roll, pitch, yaw):
    def turned(extra):
        tilted = multiply(from_axis_angle((roll + extra, pitch, 0.0)), from_yaw(yaw))
        return to_axis_angle_near(multiply(tilted, TOOL_DOWN), TOOL_DOWN)

    assert math.dist(turned(0.0), turned(1e-6)) < 1e-5


@law(quaternions())
def test_quaternion_round_trip_through_axis_angle(q):
    v = to_axis_angle(q)
    assert math.hypot(*v) <= math.pi + NEAR
    assert same_rotation(from_axis_angle(v), q)


@pytest.mark.parametrize("tiny", [0.0, 1e-15, 1e-13, 1e-11, 1e-6])
def test_axis_angle_of_hardly_a_turn(tiny):
    assert same_vector(to_axis_angle(from_axis_angle((tiny, 0.0, -tiny))), (tiny, 0.0, -tiny), 1e-16)


def test_axis_angle_turns_by_the_right_hand():
    assert same_vector(rotate(from_axis_angle((0.0, 0.0, math.pi / 2)), (1.0, 0.0, 0.0)), (0.0, 1.0, 0.0))
    assert same_vector(rotate(from_axis_angle((math.pi / 2, 0.0, 0.0)), (0.0, 1.0, 0.0)), (0.0, 0.0, 1.0))


@law(angles)
def test_yaw_round_trip(yaw):
    assert math.isclose(yaw_of(from_yaw(yaw)), yaw, abs_tol=1e-8)
    assert tilt_of(from_yaw(yaw)) < 1e-7


@law(angles, st.floats(0.0, math.pi), angles)
def test_tilt_is_the_angle_of_the_z_axis_whatever_the_yaw(yaw, tilt, about):
    axis = (tilt * math.cos(about), tilt * math.sin(about), 0.0)
    q = normalize(multiply(from_axis_angle(axis), from_yaw(yaw)))
    assert math.isclose(tilt_of(q), tilt, abs_tol=1e-6)


@law(quaternions(), quaternions())
def test_angle_between_is_symmetric_and_blind_to_sign(a, b):
    assert math.isclose(angle_between(a, b), angle_between(b, a), abs_tol=1e-8)
    negated = tuple(-c for c in b)
    assert math.isclose(angle_between(a, b), angle_between(a, negated), abs_tol=1e-8)
    assert 0.0 <= angle_between(a, b) <= math.pi + NEAR
    assert angle_between(a, a) < 1e-7


@law(quaternions(), quaternions())
def test_slerp_starts_at_one_end_and_ends_at_the_other(a, b):
    assert same_rotation(slerp(a, b, 0.0), a)
    assert same_rotation(slerp(a, b, 1.0), b)


@law(quaternions(), quaternions(), st.floats(0.0, 1.0))
def test_slerp_turns_evenly_along_the_shorter_way(a, b, f):
    whole = angle_between(a, b)
    assume(whole < math.pi - 1e-3)
    middle = slerp(a, b, f)
    assert math.isclose(angle_between(a, middle), f * whole, abs_tol=1e-6)
    assert math.isclose(angle_between(middle, b), (1.0 - f) * whole, abs_tol=1e-6)


@law(quaternions(), quaternions())
def test_the_turn_between_two_rotations_takes_one_to_the_other(a, b):
    # The same bits, signs of zeros included: records of experts depend on them.
    assert list(map(str, turn_between(a, b))) == list(map(str, multiply(b, conjugate(a))))
    assert same_rotation(multiply(turn_between(a, b), a), b)


@pytest.mark.parametrize("zero", [0.0, -0.0])
@pytest.mark.parametrize("other", [0.0, -0.0])
def test_the_turn_between_two_rotations_keeps_the_signs_of_zeros(zero, other):
    for q in itertools.product((1.0, zero), (zero, 0.5), (other, -0.5), (zero, other)):
        for p in itertools.product((1.0, other), (zero, other), (other, 0.25), (other, -0.0)):
            assert list(map(str, turn_between(q, p))) == list(map(str, multiply(p, conjugate(q))))


@law(poses, poses, st.floats(0.0, 1.0))
def test_a_straight_way_turns_as_slerp_does_and_leads_from_one_end_to_the_other(a, b, f):
    way = straight_way(a, b)
    assert same_pose(way(0.0), a)
    assert same_pose(way(1.0), b)
    assert way(f).quaternion == slerp(a.quaternion, b.quaternion, f)
    assert math.isclose(distance(a.position, way(f).position), f * distance(a.position, b.position), abs_tol=1e-9)


@law(poses, vectors, st.floats(0.0, 1.0))
def test_a_straight_way_without_a_turn_keeps_its_rotation(pose, step, f):
    assert same_rotation(straight_way(pose, pose.translated(*step))(f).quaternion, pose.quaternion)


@law(poses)
def test_pose_inverse(pose):
    assert same_pose(pose @ pose.inverse(), Pose())
    assert same_pose(pose.inverse() @ pose, Pose())


@law(poses, poses, poses)
def test_poses_compose_associatively(a, b, c):
    assert same_pose((a @ b) @ c, a @ (b @ c))


@law(poses, poses, vectors)
def test_composed_pose_applies_the_right_one_first(a, b, point):
    assert same_vector((a @ b).apply(point), a.apply(b.apply(point)), 1e-8)
    assert same_vector(a.inverse().apply(a.apply(point)), point, 1e-8)


@law(poses, vectors)
def test_translated_moves_in_the_outer_frame(pose, by):
    moved = pose.translated(*by)
    assert same_vector(moved.position, [p + d for p, d in zip(pose.position, by, strict=True)])
    assert moved.quaternion == pose.quaternion


@law(vectors, vectors, poses)
def test_distances_survive_motion_and_seen_from_above_are_shorter(a, b, pose):
    assert math.isclose(distance(pose.apply(a), pose.apply(b)), distance(a, b), abs_tol=1e-8)
    assert horizontal_distance(a, b) <= distance(a, b) + NEAR
    assert horizontal_distance(a, (*a[:2], b[2])) == 0.0
