"""Named random streams: nothing but suite, task, seed and purpose decides what is drawn."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.looping import each

from betterbench.sim.scenes.appearance import LOOK_SETS, UNSEEN_LOOK_SETS, look_of
from betterbench.sim.scenes.builder import slot_pose
from betterbench.tasks import ObjectSpec, all_tasks, get_task, stream

names = st.text(st.characters(codec="ascii", exclude_characters="|"), min_size=1, max_size=12)


@given(names, st.integers(0, 1 << 40), names)
def test_stream_depends_on_its_names_alone(task, seed, purpose):
    first = stream(task, seed, purpose).random(4)
    stream(task, seed, purpose + "x").random(100)
    assert np.array_equal(first, stream(task, seed, purpose).random(4))


@given(names, st.integers(0, 1 << 40), names)
def test_any_other_name_is_another_stream(task, seed, purpose):
    first = stream(task, seed, purpose).random(2)
    for other in (
        stream(task + "x", seed, purpose),
        stream(task, seed + 1, purpose),
        stream(task, seed, purpose + "x"),
    ):
        assert not np.array_equal(first, other.random(2))


def test_stream_is_the_same_in_every_process_and_version():
    """A changed derivation would silently change every trial of the suite: it needs a new suite version."""
    assert stream("fast_food", 3, "slot:first").integers(1 << 32, size=2).tolist() == STORED


STORED = [216552836, 741785841]


def test_streams_of_neighboring_seeds_are_uncorrelated():
    draws = np.array([stream("fast_food", seed, "slot:first").uniform(-1, 1) for seed in range(400)])
    assert abs(np.corrcoef(draws[:-1], draws[1:])[0, 1]) < 0.15
    assert abs(draws.mean()) < 4 / math.sqrt(3 * 400)


SLOTS = [(t, s) for t in all_tasks() for s in t.slots]


@each("task, slot", SLOTS)
def test_slot_jitter_stays_in_its_box_and_fills_it(task, slot):
    drawn = [slot_pose(task, seed, slot.name) for seed in range(60)]
    dx = np.array([p[0] - slot.x for p, _ in drawn])
    dy = np.array([p[1] - slot.y for p, _ in drawn])
    dyaw = np.array([yaw - slot.yaw for _, yaw in drawn])
    for offsets, half in ((dx, slot.jitter_m), (dy, slot.jitter_m), (dyaw, slot.yaw_jitter)):
        assert np.abs(offsets).max() <= half + 1e-12
        assert half == 0.0 or np.ptp(offsets) > 1.6 * half
    assert all(p[2] == 0.0 for p, _ in drawn)


def test_like_things_look_alike_and_names_have_no_say():
    a, b = ObjectSpec("burger_1", "burger", "burger"), ObjectSpec("other", "sandwich", "burger")
    for seed in range(20):
        assert look_of("fast_food", seed, a) == look_of("fast_food", seed, b)


def test_looks_vary_over_seeds_within_the_promised_number_of_sets():
    specs = get_task("fast_food").train("train1").objects
    for shown, most in (("seen", LOOK_SETS), ("unseen", UNSEEN_LOOK_SETS)):
        sets = {tuple(look_of("fast_food", seed, o, shown=shown) for o in specs) for seed in range(400)}
        assert 8 <= len(sets) <= most
