"""What pages and devices send: one page drives, nothing counts twice, and nothing that comes in can do harm."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from betterbench.browser.keys import MARK, NO_PUSH
from betterbench.demonstrations.teleop.controls import HELD_FOR_S, ControlInput, Controls, calmed
from betterbench.geometry import Pose


def page(**form):
    return MARK + json.dumps(form)


@pytest.fixture
def controls():
    made = Controls()
    assert made.connected(1)
    return made


def test_only_one_page_drives_until_another_takes_over(controls):
    assert not controls.connected(2)
    assert controls.tapped(1, "gripper")
    assert not controls.tapped(2, "save")
    assert not controls.dragged(2, Pose(), is_over=False)
    assert not controls.sent(2, page(held=["KeyW"]), 0.0)
    assert controls.take(0.0) == ControlInput(taps=("gripper",), driver=1)
    controls.dragged(1, Pose(), is_over=False)
    controls.take_over(2)
    assert controls.take(0.0) == ControlInput(driver=2)  # what the first page held is let go
    assert controls.disconnected(2)
    assert controls.take(0.0).driver == 1
    assert controls.disconnected(1)
    assert controls.take(0.0) == ControlInput()


def test_held_keys_lapse_unless_they_are_renewed(controls):
    controls.sent(1, page(held=["KeyW", "KeyA"], n=1), 10.0)
    assert controls.take(10.0 + HELD_FOR_S).push == (1.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    controls.sent(1, page(held=["KeyW"], slow=True, n=2), 11.0)
    assert controls.take(11.1).push == (0.25, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert controls.take(11.1 + HELD_FOR_S).push == NO_PUSH
    controls.sent(1, page(held=["KeyW", "KeyS", "KeyX"], n=3), 12.0)
    assert controls.take(12.0).push == NO_PUSH  # both ways, and a key without a meaning


def test_a_tap_counts_once_however_often_the_page_tells_it(controls):
    for n in range(3):
        controls.sent(1, page(taps={"gripper": 1}, n=n), 0.0)
    assert controls.take(0.0).taps == ("gripper",)
    controls.sent(1, page(taps={"gripper": 3, "undo": 1}, n=9), 0.0)  # two messages were lost
    assert sorted(controls.take(0.0).taps) == ["gripper", "gripper", "undo"]
    assert controls.take(0.0).taps == ()


def test_what_was_tapped_while_looking_on_is_not_done_afterward(controls):
    controls.connected(2)
    assert not controls.sent(2, page(taps={"save": 1}), 0.0)
    controls.take_over(2)
    controls.sent(2, page(taps={"save": 1}), 0.0)
    assert controls.take(0.0).taps == ()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}x",
        page(held="KeyW"),
        page(push=[math.nan] * 6),
        page(push=[2.0, 0, 0, 0, 0, 0]),
        page(push=[0.0]),
        page(taps={"save": -1}),
        page(run="rm"),
        page(held=["KeyW"] * 1000),
        MARK + "[" * 5000,
        MARK + "\ud800",
    ],
    ids=lambda t: repr(t[:40]),
)
def test_what_cannot_be_read_is_said_in_one_line_and_does_nothing(controls, text):
    assert controls.sent(1, text, 0.0)
    assert controls.take(0.0) == ControlInput(driver=1)
    problems = controls.take_problems()
    assert len(problems) == 1
    assert len(problems[0]) <= 200
    assert "\n" not in problems[0]
    assert controls.take_problems() == []


@given(st.text(max_size=50))
@settings(max_examples=25)
def test_no_text_of_a_page_raises(text):
    controls = Controls()
    controls.connected(1)
    controls.sent(1, MARK + text, 0.0)
    asked = controls.take(0.0)
    assert all(math.isfinite(v) and abs(v) <= 1.0 for v in asked.push)


def test_numbers_of_devices_that_are_not_finite_let_go(controls):
    controls.pushed("pad", [1.0, 0, 0, 0, 0, 0], 0.0)
    controls.pushed("pad", [math.nan, 0, 0, 0, 0, 0], 0.0)
    controls.dragged(1, Pose((math.inf, 0.0, 0.0)), is_over=False)
    controls.led(Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)), closed=True)
    assert controls.take(0.0) == ControlInput(driver=1)
    assert len(controls.take_problems()) == 3


def test_all_devices_together_push_no_harder_than_one(controls):
    controls.sent(1, page(held=["KeyR"]), 0.0)
    controls.pushed("pad", [0, 0, 1.0, 0, 0, 0.5], 0.0)
    push = controls.take(0.0).push
    assert push[2] == 1.0
    assert push[5] == calmed(0.5)


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_deflections_keep_their_order_and_sign(a, b):
    assert calmed(-a) == -calmed(a)
    assert a > b or calmed(a) <= calmed(b)
    assert (calmed(1.0), calmed(0.0)) == (1.0, 0.0)
