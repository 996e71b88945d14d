from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.looping import each

from betterbench.errors import InvalidActionError, InvalidInputError, UnknownNameError
from betterbench.interface.actions import ACTION_SPACES, EE_DELTA, JOINT_POSITION, ActionSpace, action_space

SPACES = pytest.mark.parametrize("space", ACTION_SPACES.values(), ids=ACTION_SPACES.keys())


@SPACES
def test_json_form_round_trips(space: ActionSpace) -> None:
    assert ActionSpace.from_json(json.loads(json.dumps(space.to_json()))) == space


@SPACES
def test_gripper_is_the_last_number_and_its_polarity_is_declared(space: ActionSpace) -> None:
    assert space.components[-1] == "gripper"
    assert (space.low[-1], space.high[-1]) == (-1.0, 1.0)
    assert "positive closes" in space.convention


@given(st.lists(st.floats(-1e6, 1e6), min_size=7, max_size=7))
def test_clipping_stays_inside_and_is_idempotent(numbers: list[float]) -> None:
    once = EE_DELTA.clip(np.array(numbers))
    assert (np.abs(once) <= 1.0).all()
    assert once.tobytes() == EE_DELTA.clip(once).tobytes()


@SPACES
@settings(max_examples=30)
@given(data=st.data())
def test_as_many_actions_are_counted_as_clipping_changes(space: ActionSpace, data: st.DataObject) -> None:
    near = st.sampled_from([*space.low, *space.high, 0.0, -0.0]) | st.floats(-4.0, 4.0, width=32)
    rows = data.draw(st.lists(st.lists(near, min_size=space.dim, max_size=space.dim), max_size=5))
    for kind in (np.float64, np.float32):
        actions = np.array(rows, dtype=kind).reshape(-1, space.dim)
        changed = sum(space.clip(action).tolist() != action.tolist() for action in actions)
        assert space.count_clipped(actions.astype(np.float64)) == changed


def test_of_no_actions_none_is_clipped_whatever_their_width() -> None:
    """A record that lies about its components is told so by name and does not break the check."""
    assert EE_DELTA.count_clipped(np.zeros((0, 3))) == EE_DELTA.count_clipped(np.zeros((0, 7))) == 0


def test_clipping_leaves_the_given_array_alone() -> None:
    given_action = np.full(7, 3.0)
    EE_DELTA.clip(given_action)
    assert (given_action == 3.0).all()


@each(
    "action, words",
    [
        (np.zeros(6), r"expected shape \(7,\), got \(6,\)"),
        (np.zeros((1, 7)), r"expected shape \(7,\), got \(1, 7\)"),
        (np.array([0, 0, np.nan, 0, 0, 0, np.inf]), "z = nan, gripper = inf"),
        (np.zeros(7, dtype=bool), "expected real numbers, got bool"),
        (np.zeros(7, dtype=complex), "expected real numbers, got complex128"),
        (["a"] * 7, "expected real numbers"),
        ([[0.0], [0.0, 1.0]], "expected an array of numbers"),
        (None, "expected real numbers"),
    ],
)
def test_an_invalid_action_is_refused_with_its_fault(action: object, words: str) -> None:
    with pytest.raises(InvalidActionError, match=words):
        EE_DELTA.clip(action)


def test_integers_and_float32_are_accepted() -> None:
    assert EE_DELTA.clip(np.ones(7, dtype=np.int64)).dtype == np.float64
    assert EE_DELTA.clip(np.full(7, 0.5, dtype=np.float32)).tolist() == [0.5] * 7


def test_an_unknown_name_gets_the_closest_one() -> None:
    with pytest.raises(UnknownNameError, match="ee_delta"):
        action_space("ee_detla")


def test_only_deltas_have_a_neutral_action() -> None:
    assert EE_DELTA.neutral is not None
    assert EE_DELTA.neutral.tolist() == [0.0] * 7
    assert JOINT_POSITION.neutral is None


@pytest.mark.parametrize("field", ["units", "low", "components"])
def test_a_malformed_declaration_is_refused(field: str) -> None:
    form = EE_DELTA.to_json()
    form[field] = form[field][:-1]
    with pytest.raises(InvalidInputError):
        ActionSpace.from_json(form)
    del form[field]
    with pytest.raises(InvalidInputError, match="action space"):
        ActionSpace.from_json(form)
