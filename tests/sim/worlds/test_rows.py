"""Rows: what is packed comes out again, and a form that is none is refused."""

import json

import numpy as np
import pytest
from tests.looping import each

from betterbench.sim.worlds.rows import MAX_NUMBERS, RowForm, form_of, row_of

ARRAYS = {"one": np.arange(6.0).reshape(2, 3), "none": np.zeros(0), "number": np.array(7.5), "last": np.array([-1.0])}


def test_what_is_packed_comes_out_again():
    form, row = RowForm(json.loads(json.dumps(form_of(ARRAYS)))), row_of(ARRAYS)
    assert row.shape == (form.size,) == (8,)
    for name, array in ARRAYS.items():
        assert form.array(row, name).tolist() == array.tolist()
        assert form.array(row, name).shape == array.shape
    assert row[form.places["last"]].tolist() == [-1.0]


def test_it_is_said_which_arrays_hold_what_is_no_number():
    row = row_of({**ARRAYS, "last": np.array([np.inf])})
    row[1] = np.nan
    assert RowForm(form_of(ARRAYS)).not_finite(row) == ["one", "last"]
    assert not RowForm(form_of(ARRAYS)).not_finite(row_of(ARRAYS))


@each(
    "form",
    [
        None,
        {"one": [3]},
        [["one"]],
        [["one", 3]],
        [[1, [3]]],
        [["one", [3]], ["one", [3]]],
        [["one", [-1]]],
        [["one", [True]]],
        [["one", [1.5]]],
        [["one", [MAX_NUMBERS + 1]]],
        [["one", [MAX_NUMBERS]], ["two", [1]]],
        [["one", [MAX_NUMBERS, MAX_NUMBERS]]],
    ],
)
def test_a_form_that_is_none_is_refused(form):
    with pytest.raises((TypeError, ValueError), match="rows"):
        RowForm(form)
