"""Readers of the engine's memory: they see every change, and make nothing anew where there is none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from betterbench.sim.robots.readers import number_reader, number_writer, row_reader, speed_reader

changes = st.lists(st.tuples(st.integers(0, 20), st.sampled_from([0.0, -0.0, 1.5, -2.0, 1e-300])), max_size=12)


@settings(max_examples=50)
@given(st.lists(st.integers(0, 6), min_size=1, max_size=5, unique=True), changes)
def test_rows_are_those_of_the_array_whatever_changes(rows, changes):
    array = np.arange(21.0).reshape(7, 3)
    read = row_reader(array, rows)
    for place, value in [(0, 0.0), *changes]:
        array.flat[place] = value
        assert np.array_equal(np.array(read()), array[rows])
        assert [str(v) for row in read() for v in row] == [str(v) for v in array[rows].ravel().tolist()]


def test_rows_that_stay_are_the_very_ones_of_before():
    array = np.arange(12.0).reshape(4, 3)
    read = row_reader(array, [2, 1])
    first = read()
    array[0] = array[3] = 7.0  # others
    assert read() is first
    array[1, 2] = 7.0
    assert read() == ((6.0, 7.0, 8.0), (3.0, 4.0, 7.0))


def test_no_rows_are_none():
    assert row_reader(np.zeros((3, 2)), [])() == ()


@settings(max_examples=50)
@given(st.lists(st.tuples(st.integers(0, 29), st.floats(-3.0, 3.0)), max_size=12))
def test_speeds_are_the_norms_of_the_velocities(changes):
    array = np.zeros(30)
    free, slides = [9, -1, -1, 16, -1], [-1, -1, 15, -1, -1]
    read = speed_reader(array, free, slides)
    for place, value in [(0, 0.0), *changes]:
        array[place] = value
        linear, angular = read()
        for i in range(5):
            v = array[free[i] : free[i] + 6] if free[i] >= 0 else np.zeros(6)
            sliding = abs(array[slides[i]]) if slides[i] >= 0 else 0.0
            assert linear[i] == pytest.approx(np.linalg.norm(v[:3]) + sliding, abs=1e-12)
            assert angular[i] == pytest.approx(np.linalg.norm(v[3:]), abs=1e-12)


def test_things_that_cannot_move_have_no_speed():
    assert speed_reader(np.ones(9), [-1, -1], [-1, -1])() == ((0.0, 0.0), (0.0, 0.0))


def test_numbers_are_read_and_written_in_place():
    array = np.zeros(4)
    number_writer(array)(1.0, 2.0, 3.0, 4.0)
    assert number_reader(array, [3, 1])() == (4.0, 2.0)
    array[1] = 5.0
    assert number_reader(array, range(4))() == (1.0, 5.0, 3.0, 4.0)


def test_numbers_of_another_type_are_refused():
    with pytest.raises(TypeError, match="float32"):
        row_reader(np.zeros((2, 3), np.float32), [0])
