"""No command leaves its limits, whatever a policy asks for and whatever the arm reports."""

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.errors import InvalidInputError
from betterbench.real.limits import Limiter, LimitError, SafetyLimits
from betterbench.real.plan import ACTION_SPACES
from betterbench.sim.robots import robot

RATE_HZ = 20.0
UNLOADED = np.zeros(6)


def limiter_of(unit="degrees", **limits):
    made = Limiter(SafetyLimits(**limits), ACTION_SPACES[unit], rate_hz=RATE_HZ)
    spec = robot("so101")
    home = np.array(spec.positions_in(ACTION_SPACES[unit], spec.home_joints, 0.05))
    made.start(home)
    return made, home


def repeat(limiter, asked, state, load):
    for _ in range(40):
        limiter.limit(asked, state, load)


def wild(rng):
    """An answer of a broken policy: huge jumps, infinities, NaN, extremes, and sensible ones among them."""
    kind = rng.integers(7)
    asked = rng.normal(0.0, 60.0, 6)
    if kind == 0:
        asked = rng.normal(0.0, 1e6, 6)
    elif kind == 1:
        asked[rng.integers(6)] = rng.choice([np.nan, np.inf, -np.inf])
    elif kind == 2:
        asked = np.full(6, rng.choice([1e308, -1e308]))
    elif kind == 3:
        asked = rng.choice([-180.0, 180.0], 6)
    elif kind == 4:
        asked = np.array([rng.uniform(-90, 90), 90.0, rng.uniform(-90, 0), 60.0, 0.0, 50.0])  # down into the table
    return asked


@pytest.mark.parametrize("steps", [2_500, pytest.param(10_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("unit", others_slow(["degrees", "normalized"], 2))
def test_limits_are_never_exceeded_in_random_steps(unit, steps):
    rng = np.random.default_rng(48)
    limiter, state = limiter_of(unit)
    limits, last = limiter.limits, limiter.last
    low, high = np.array(limits.box_low), np.array(limits.box_high)
    changed = 0
    for _ in range(steps):
        load = np.where(rng.random(6) < 0.05, 1.0, 0.1)
        given = limiter.limit(wild(rng), state, load)
        command, step = given.command, given.command - last
        assert np.isfinite(command).all()
        assert (command >= limiter.low).all()
        assert (command <= limiter.high).all()
        assert (np.abs(step) <= limiter.most_step * (1 + 1e-9)).all()
        tool = limiter.tool(command)
        assert (tool >= low).all(), tool
        assert (tool <= high).all(), tool
        assert (step[:5][load[:5] > limits.load] == 0.0).all()
        assert load[5] <= limits.load or step[5] >= 0.0
        last = command
        state = state + 0.6 * (command - state) + rng.normal(0.0, 0.2, 6)  # servos that lag and tremble
        changed += bool(given.by)
    assert changed > steps // 2


def test_a_sensible_command_passes_unchanged():
    limiter, state = limiter_of()
    asked = state + np.array([1.0, -0.5, 0.5, 0.0, 1.0, -3.0])
    given = limiter.limit(asked, state, UNLOADED)
    np.testing.assert_allclose(given.command, asked, atol=1e-12)
    assert given.by == ()


def test_the_arm_joints_are_slowed_by_one_factor_so_that_the_direction_stays():
    limiter, state = limiter_of(lead_s=10.0)
    given = limiter.limit(state + np.array([20.0, 10.0, 0.0, 0.0, 0.0, 0.0]), state, UNLOADED)
    step = given.command - state
    assert step[0] == pytest.approx(limiter.most_step[0])
    assert step[1] == pytest.approx(step[0] / 2)
    assert given.by == ("speed",)


def test_a_command_leads_a_blocked_arm_by_a_bounded_distance():
    limiter, state = limiter_of(stall_rad=3.0)
    for _ in range(40):
        given = limiter.limit(state + np.array([90.0, 0, 0, 0, 0, 0]), state, UNLOADED)
    assert given.command[0] - state[0] == pytest.approx(np.degrees(1.5) * 0.25, abs=1e-6)


def test_the_tool_is_kept_above_the_table():
    limiter, _ = limiter_of()
    down = np.array([0.0, 60.0, 10.0, 30.0, 0.0, 0.0])
    by = set()
    for _ in range(60):
        given = limiter.limit(limiter.last + down, limiter.last, UNLOADED)
        by |= set(given.by)
    assert "workspace" in by
    assert limiter.limits.box_low[2] <= limiter.tool(limiter.last)[2] < limiter.limits.box_low[2] + 0.03


def test_an_arm_that_starts_outside_the_workspace_may_only_come_back():
    limiter, home = limiter_of(box_low=(0.04, -0.36, 0.12))
    outside = limiter._outside(home)
    assert 0.02 < outside < 0.06
    assert limiter.limit(home + np.array([0, 3.0, 0, 0, 0, 0]), home, UNLOADED).by == ("workspace",)  # farther down
    np.testing.assert_allclose(limiter.last, home, atol=1e-9)
    up = home + np.array([0, -30.0, 0, 0, 0, 0])
    for _ in range(40):
        limiter.limit(up, limiter.last, UNLOADED)
        now = limiter._outside(limiter.last)
        assert now <= outside
        outside = now
    assert outside == 0.0
    np.testing.assert_allclose(limiter.last, up, atol=1e-6)


def test_a_stalled_servo_and_an_overload_stop_the_arm_by_name():
    limiter, state = limiter_of()
    with pytest.raises(LimitError, match="elbow_flex does not follow its command: it has been 21 behind for"):
        repeat(limiter, state + np.array([0, 0, 40.0, 0, 0, 0]), state, UNLOADED)
    limiter, state = limiter_of()
    load = np.array([0.0, -0.95, 0.0, 0.0, 0.0, 1.0])
    with pytest.raises(LimitError, match="shoulder_lift carried 95% of its maximum load for"):
        repeat(limiter, state, state, load)


def test_a_gripper_that_holds_an_object_is_no_stall_and_can_be_opened():
    limiter, state = limiter_of()
    load = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -1.0])
    for _ in range(60):
        given = limiter.limit(np.array([*state[:5], 0.0]), state, load)
    assert given.command[5] == state[5]
    assert limiter.limit(np.array([*state[:5], 90.0]), state, load).command[5] > state[5]


def test_an_arm_without_a_finite_position_is_not_moved():
    limiter, state = limiter_of()
    broken = state.copy()
    broken[2] = np.nan
    with pytest.raises(LimitError, match="reports no finite position for elbow_flex"):
        limiter.limit(state, broken, UNLOADED)
    with pytest.raises(LimitError, match="elbow_flex"):
        limiter.start(broken)
    unknown = np.full(6, np.nan)
    limiter.start(state)
    limiter.limit(state, state, unknown)  # a robot that does not report loads


def test_a_limit_that_is_none_is_refused():
    with pytest.raises(InvalidInputError, match=r"speed_rad_s: expected a positive number, got 0\.0"):
        SafetyLimits(speed_rad_s=0.0)
    with pytest.raises(InvalidInputError, match="limits: box"):
        SafetyLimits(box_low=(0.5, 0.0, 0.0))
    fresh = Limiter(SafetyLimits(), ACTION_SPACES["degrees"], rate_hz=20.0)
    with pytest.raises(InvalidInputError, match="start was not called"):
        fresh.limit(UNLOADED, UNLOADED, UNLOADED)
