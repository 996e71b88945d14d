"""Rotation formats against scipy's, and their round trips."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from betterbench.policies.conventions.rotation import ROTATION_SIZES, RotationFormat, from_format, to_format

FORMATS = get_args(RotationFormat)
QUATERNIONS = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 0.01)


def scipys(rotation: Rotation, form: str) -> np.ndarray:
    matrix = rotation.as_matrix()
    return {
        "quaternion_wxyz": lambda: rotation.as_quat(canonical=True, scalar_first=True),
        "quaternion_xyzw": lambda: rotation.as_quat(canonical=True),
        "axis_angle": rotation.as_rotvec,
        "rpy": lambda: rotation.as_euler("xyz"),
        "rotation_6d": lambda: np.concatenate([matrix[:, 0], matrix[:, 1]]),
        "rotation_6d_rows": lambda: np.concatenate([matrix[0], matrix[1]]),
        "rotation_6d_interleaved": lambda: matrix[:, :2].reshape(6),
        "matrix": lambda: matrix.reshape(9),
    }[form]()


@pytest.mark.parametrize("form", FORMATS)
def test_each_format_is_what_scipy_computes(form):
    for rotation in Rotation.random(200, rng=np.random.default_rng(3)):
        q = rotation.as_quat(scalar_first=True)
        for sign in (1.0, -1.0):  # both signs of a quaternion are one rotation, and give one vector
            assert np.allclose(to_format(sign * q, form), scipys(rotation, form), atol=1e-9)
        expected = rotation.as_quat(canonical=True, scalar_first=True)
        assert np.allclose(from_format(scipys(rotation, form), form), expected, atol=1e-9)


@pytest.mark.parametrize("form", FORMATS)
@given(q=QUATERNIONS)
@settings(max_examples=25)
def test_there_and_back_is_the_same_rotation(form, q):
    values = to_format(q, form)
    assert len(values) == ROTATION_SIZES[form]
    back = Rotation.from_quat(from_format(values, form), scalar_first=True)
    assert (back.inv() * Rotation.from_quat(q, scalar_first=True)).magnitude() < 1e-6


def test_the_sign_rule_keeps_rotation_vectors_within_half_a_turn():
    q = (-math.cos(0.2), math.sin(0.2), 0.0, 0.0)  # w < 0: without the rule the vector would be 5.88 long
    assert np.allclose(to_format(q, "axis_angle"), [-0.4, 0, 0])


def test_gimbal_lock_gives_angles_of_the_same_rotation():
    for pitch in (math.pi / 2, -math.pi / 2):
        rotation = Rotation.from_euler("xyz", [0.3, pitch, 0.4])
        back = from_format(to_format(rotation.as_quat(scalar_first=True), "rpy"), "rpy")
        assert (Rotation.from_quat(back, scalar_first=True).inv() * rotation).magnitude() < 1e-6


def test_six_numbers_need_not_be_orthonormal():
    assert np.allclose(from_format([2, 0, 0, 1, 3, 0], "rotation_6d"), [1, 0, 0, 0])


@pytest.mark.parametrize(
    ("values", "form"),
    [
        ((0, 0, 0, 0), "quaternion_xyzw"),
        ((0,) * 6, "rotation_6d"),
        ((1, 0, 0, 2, 0, 0), "rotation_6d"),
        ((0,) * 9, "matrix"),
        ((1, 0, 0, 1, 0, 0), "rotation_6d_rows"),
    ],
)
def test_what_is_no_rotation_is_refused(values, form):
    with pytest.raises(ValueError, match="is not a rotation"):
        from_format(values, form)
