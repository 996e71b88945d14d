"""Requests come from strangers: whatever they hold, they are read or refused in one line."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from betterbench.errors import InvalidInputError
from betterbench.interface import EpisodeStart, Observation
from betterbench.policies.conventions.presets import NATIVE
from betterbench.policies.conventions.request import read_request
from betterbench.policies.protocols.wire import decode_openpi, encode_openpi
from betterbench.tasks import TrialId

SEEN = Observation(
    instruction="Put the red mug on the ring.",
    step=7,
    images={"front": np.arange(48, dtype=np.uint8).reshape(4, 4, 3)},
    joint_positions=np.linspace(-1.0, 1.0, 7),
    joint_velocities=np.linspace(0.1, 0.7, 7),
    ee_position=np.array([0.1, 0.2, 0.3]),
    ee_quaternion=np.array([0.5, 0.5, -0.5, 0.5]),
    gripper_width=0.0417,
    depth={},
    masks={},
)
START = EpisodeStart(SEEN.instruction, 3, "ee_delta")
TRIAL = TrialId("morning_coffee", "T1", 5)


def message(**changes):
    return decode_openpi(encode_openpi({**NATIVE.request(SEEN, START, TRIAL), **changes}))


def test_what_our_client_writes_is_what_our_server_reads_to_the_bit():
    request = read_request(message())
    assert (request.start, request.trial) == (START, TRIAL)
    assert (request.step, request.instruction) == (7, SEEN.instruction)
    assert read_request(NATIVE.request(SEEN, START)).trial is None
    assert request.measured
    assert request.observation is not None
    for name in ("joint_positions", "joint_velocities", "ee_position", "ee_quaternion"):
        np.testing.assert_array_equal(getattr(request.observation, name), getattr(SEEN, name))
    assert request.observation.gripper_width == SEEN.gripper_width
    np.testing.assert_array_equal(request.observation.images["front"], SEEN.images["front"])


@pytest.mark.parametrize("shape", [(), (1,)])
def test_an_instruction_may_come_as_the_array_that_transforms_make_of_it(shape):
    assert read_request(message(prompt=np.full(shape, SEEN.instruction))).instruction == SEEN.instruction


def test_a_tool_that_points_down_is_read_as_it_is_seen_here():
    """On the wire the quaternion keeps its sign near half a turn about x; observations have w >= 0."""
    for quaternion in ([0.6, -0.8, 0.0, 0.0], [0.6, 0.8, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]):
        seen = dataclasses.replace(SEEN, ee_quaternion=np.array(quaternion))
        read = read_request(decode_openpi(encode_openpi(NATIVE.request(seen, START)))).observation
        assert read is not None
        assert read.ee_quaternion.tolist() == quaternion


def test_a_policy_may_change_what_it_is_shown_as_it_may_in_its_own_process():
    seen = read_request(message()).observation
    assert seen is not None
    seen.joint_positions[:] -= 1.0
    seen.ee_quaternion[0] = 0.0
    seen.images["front"][0] = 0


anything = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63)
    | st.floats()
    | st.text(max_size=5)
    | st.binary(max_size=5)
    | st.sampled_from([np.zeros((2, 3)), np.zeros(7, np.int8), np.zeros((3, 3, 3), np.uint8), np.zeros(0)]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5) | st.integers(), inner, max_size=3),
    max_leaves=8,
)
keys = [*sorted(NATIVE.request(SEEN, START, TRIAL)), "observation/state", "observation/image", "better/images/x"]


@given(key=st.sampled_from(keys), value=anything, inner=st.sampled_from(["task", "seed", "action_space", None]))
def test_any_value_under_any_key_is_read_or_refused_in_one_line(key, value, inner):
    told = message()
    if inner is not None and key == "better/episode":
        value = {**told[key], inner: value}
    try:
        request = read_request({**told, key: value})
    except InvalidInputError as error:
        refused = str(error)
        assert "\n" not in refused
        return
    assert request.observation is not None
    assert np.isfinite(request.observation.joint_positions).all()


@pytest.mark.parametrize(
    "missing", ["prompt", "better/joint_positions", "better/ee_quaternion", "better/gripper_width"]
)
def test_a_missing_field_is_named(missing):
    told = message()
    del told[missing]
    with pytest.raises(InvalidInputError, match=missing):
        read_request(told)
