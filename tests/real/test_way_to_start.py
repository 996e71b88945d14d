"""The way to the start of a trial: within all limits from wherever the arm rests, and never without the switch."""

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.interface import PolicyInfo
from betterbench.real import loop
from betterbench.real.arm import SafeArm
from betterbench.real.limits import Limiter, SafetyLimits
from betterbench.real.loop import Controls, TrialRun
from betterbench.real.plan import RealPolicy, make_plan
from betterbench.real.robots.robot import Frame, Reading, RobotError

RATE_HZ = 20.0
RESTS = {
    "folded": (0.0, -100.0, 95.0, 70.0, 0.0, 2.0),
    "folded_to_the_side": (60.0, -98.0, 90.0, 60.0, 90.0, 0.0),
    "below_the_table": (0.0, 60.0, 10.0, 20.0, 0.0, 30.0),
    "upright": (0.0, 0.0, -80.0, 0.0, -90.0, 100.0),
}


class Instant:
    """A robot that is at once where it is told to be."""

    name, cameras = "instant", ("front",)

    def __init__(self, state):
        self.state, self.commands, self.time_s = np.array(state, float), [], 0.0

    def now(self):
        return self.time_s

    def read(self):
        self.time_s += 1.0 / RATE_HZ
        image = np.zeros((24, 32, 3), np.uint8)
        return Reading(self.time_s, self.state.copy(), np.zeros(6), {"front": Frame(image, self.time_s)})

    def command(self, positions):
        self.commands.append(np.array(positions))
        self.state = np.array(positions, float)

    def release(self):
        pass


class Quiet:
    info = PolicyInfo("quiet", action_space="so101_degrees")


def way_from(state, unit="degrees"):
    """Go to the start from a state, and return the run, the limiter, the commands and why it ended early."""
    plan = make_plan((RealPolicy("a", "noop"),), conditions=["O1"], rate_hz=RATE_HZ, unit=unit)
    robot = Instant(state)
    arm = SafeArm(robot, Limiter(SafetyLimits(), plan.action_space, rate_hz=RATE_HZ))
    arm.arm()
    run = TrialRun(arm, Quiet(), plan, plan.trials[0], attempt=1, controls=Controls())
    problem = ""
    try:
        run._go_to_start()
    except RobotError as found:
        problem = str(found)
    for film in run._films.values():
        film._frames.put(None)
    return run, arm.limiter, np.array(robot.commands), problem


def outside(limiter, positions):
    tool = limiter.tool(positions)
    low, high = np.array(limiter.limits.box_low), np.array(limiter.limits.box_high)
    return float(np.linalg.norm(np.maximum(np.maximum(low - tool, tool - high), 0.0)))


def require_limits(limiter, state, commands):
    before = np.clip(state, limiter.low, limiter.high)
    for command in commands:
        assert (np.abs(command - before) <= loop.HOME_SHARE * limiter.most_step + 1e-9).all()
        assert ((command >= limiter.low) & (command <= limiter.high)).all()
        assert outside(limiter, command) <= outside(limiter, before) + 1e-12
        before = command


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch):
    monkeypatch.setattr(loop.Pace, "wait", lambda _: None)


@pytest.mark.parametrize("rest", RESTS)
def test_the_arm_reaches_its_start_from_where_it_usually_rests(rest):
    run, limiter, commands, problem = way_from(RESTS[rest])
    assert problem == ""
    require_limits(limiter, np.array(RESTS[rest]), commands)
    assert np.abs(commands[-1] - run.start_position())[:5].max() < np.degrees(loop.AT_HOME_RAD)


@pytest.mark.parametrize("unit", others_slow(["degrees", "normalized"], 2))
def test_no_limit_is_exceeded_from_any_state(unit):
    rng = np.random.default_rng(5)
    reached = 0
    for _ in range(40):
        state = rng.uniform(-110.0, 110.0, 6)
        state[5] = rng.uniform(0.0, 100.0)
        _, limiter, commands, problem = way_from(state, unit)
        require_limits(limiter, state, commands)
        assert problem == "" or "did not reach its initial pose within 15 s" in problem
        reached += not problem
    assert reached > 10
