"""A trial on the mock arm: recorded as it was, ended as asked, and nothing moves after it."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest

from betterbench.errors import InvalidInputError, PolicyError
from betterbench.interface import EpisodeStart
from betterbench.real.arm import NotArmedError, SafeArm
from betterbench.real.asking import RealPolicies, check_real_policy
from betterbench.real.limits import Limiter, SafetyLimits
from betterbench.real.loop import Controls, TrialAbortedError, TrialRun
from betterbench.real.plan import RealPolicy, make_plan
from betterbench.real.record import Samples, read_header
from betterbench.real.robots.mock import MockFaults, MockRobot

HERE = Path(__file__).parent
SCRIPTED = f"python:{HERE / 'scripted.py'}:Reach"
pytestmark = [pytest.mark.render, pytest.mark.physics]


class Bench:
    """A mock arm with a plan of one condition, and what one trial on it left."""

    def __init__(self, folder, options="", *, faults=None, cameras=("front",), unit="degrees", **limits):
        self.folder = folder / "attempt"
        self.folder.mkdir(parents=True)
        space = f"so101_{unit}"
        address = f"{SCRIPTED}?space={space}&{options}".rstrip("&")
        self.plan = make_plan((RealPolicy("a", address),), conditions=["O1"], time_limit_s=1.0, rate_hz=20.0, unit=unit)
        self.robot = MockRobot(self.plan, faults=faults, cameras=cameras, size=(96, 72))
        self.arm = SafeArm(self.robot, Limiter(SafetyLimits(**limits), self.plan.action_space, rate_hz=20.0))
        self.policies = RealPolicies(self.plan, cameras, apart=False)
        self.controls = Controls()
        self.robot.set_up(self.plan.trials[0])

    def run(self, **options):
        policy = self.policies.get("a")
        trial = self.plan.trials[0]
        made = TrialRun(self.arm, policy, self.plan, trial, attempt=1, controls=self.controls, **options)
        return made.run(self.folder)

    def aborted(self):
        with pytest.raises(TrialAbortedError) as told:
            self.run()
        self.require_still()
        header = read_header(self.folder)
        assert header.ending is None
        return str(told.value)

    def require_still(self):
        """Check that the switch is off and the arm holds where it is."""
        assert not self.arm.is_armed
        sent = len(self.robot.commands)
        until = time.monotonic() + 5.0  # a moving arm comes to rest first, and a busy machine simulates it late
        while True:
            before = self.robot.read().state
            time.sleep(0.3)
            after = self.robot.read().state
            if np.abs(after - before)[:5].max() < 1.5 or time.monotonic() > until:
                break
        assert len(self.robot.commands) == sent
        assert np.abs(after - before)[:5].max() < 1.5
        with pytest.raises(NotArmedError):
            self.arm.move(before, self.robot.read())

    @property
    def samples(self):
        return Samples.read(self.folder / "samples.parquet")


@pytest.mark.parametrize("unit", ["degrees", "normalized"])
def test_a_trial_is_recorded_row_by_row(tmp_path, unit):
    bench = Bench(tmp_path, cameras=("front", "wrist"), unit=unit)
    bench.arm.arm()
    header = bench.run(agreement=0.9)
    bench.require_still()
    samples = bench.samples
    assert header == read_header(bench.folder)
    assert (header.ending, header.steps, header.agreement) == ("time_limit", 20, 0.9)
    assert len(samples) == 20
    assert header.films["front"].frames == header.films["wrist"].frames == 20
    assert np.diff(samples.time_s).mean() > 0.045  # a busy machine makes steps late, and never faster on average
    asked = samples.asked[~samples.held]
    assert len(asked) >= 5
    sent = np.array(bench.robot.commands)
    for row in samples.command:
        assert (np.abs(sent - row).max(axis=1) == 0.0).any()
    if unit == "degrees":
        assert np.allclose(asked[0, 0], samples.state[~samples.held][0, 0] + 8.0, atol=1.5)


def test_the_policy_sees_the_instruction_the_pictures_and_the_arm(tmp_path):
    bench = Bench(tmp_path, cameras=("front", "wrist"))
    bench.arm.arm()
    bench.run()
    start, *seen = bench.policies.get("a").seen
    assert start.instruction == "Put the lemon into the fruit basket."
    assert start.action_space == "so101_degrees"
    first = seen[0]
    assert {name: image.shape for name, image in first.images.items()} == {
        "front": (72, 96, 3),
        "wrist": (72, 96, 3),
    }
    assert first.images["front"].std() > 20.0
    np.testing.assert_allclose(np.degrees(first.joint_positions), bench.samples.state[0, :5], atol=1.5)
    np.testing.assert_allclose(first.ee_position, bench.robot.scene.info.home_position, atol=0.04)
    assert first.gripper_width == pytest.approx(0.085, abs=0.01)


def test_without_the_switch_nothing_moves(tmp_path):
    bench = Bench(tmp_path)
    assert "never turned on" in bench.aborted()
    assert bench.robot.commands == []


def test_the_stop_key_stops_at_once_and_the_attempt_does_not_count(tmp_path):
    bench = Bench(tmp_path)
    bench.arm.arm()

    def stop():
        time.sleep(0.5)
        bench.controls.stop.set()
        bench.arm.stop("the operator stopped it")

    threading.Thread(target=stop).start()
    assert "the operator stopped it" in bench.aborted()
    assert 0 < len(bench.samples) < 20


def test_the_operator_ends_a_trial_that_is_over_and_it_counts(tmp_path):
    bench = Bench(tmp_path)
    bench.arm.arm()
    threading.Timer(0.5, bench.controls.end.set).start()
    header = bench.run()
    assert header.ending == "operator"
    assert 0 < header.steps < 20
    bench.require_still()


@pytest.mark.parametrize(
    ("options", "faults", "says"),
    [
        ("", {"unplugged": "front", "after_s": 0.3}, "Camera front has sent no frame for 1"),
        ("amount=80.0", {"stalled": "shoulder_pan", "after_s": 0.1}, "shoulder_pan does not follow"),
        ("", {"broken": True, "after_s": 0.3}, "bus of the arm does not answer"),
        ("fail_at=8", {}, "out of memory"),
        ("nan_at=8", {}, "finite"),
    ],
)
def test_a_fault_aborts_the_trial_and_keeps_what_was_recorded(tmp_path, options, faults, says):
    bench = Bench(tmp_path, options, faults=MockFaults(**faults))
    object.__setattr__(bench.plan, "time_limit_s", 3.0)
    bench.arm.arm()
    with pytest.raises(TrialAbortedError) as told:
        bench.run()
    assert says in str(told.value)
    bench.robot.faults = MockFaults()  # a bus that answers again must not find a moving arm
    bench.require_still()
    assert read_header(bench.folder).ending is None
    assert len(bench.samples) > 2


def test_a_slow_policy_makes_the_arm_hold_and_the_steps_are_counted(tmp_path):
    bench = Bench(tmp_path, "slow_s=0.35", watchdog_s=0.15)
    bench.arm.arm()
    header = bench.run()
    samples = bench.samples
    assert header.held_steps == samples.held.sum() >= 8
    held = np.flatnonzero(samples.held)
    last = held[-1]
    assert np.abs(samples.command[last] - samples.state[last])[:5].max() < 1.5


def test_late_and_dropped_frames_are_counted(tmp_path):
    bench = Bench(tmp_path, faults=MockFaults(latency_s=0.2))
    bench.arm.arm()
    header = bench.run()
    assert header.films["front"].late > 10
    assert bench.samples.late.sum() == header.films["front"].late
    dropping = Bench(tmp_path / "dropping", faults=MockFaults(drop_every=2))
    dropping.arm.arm()
    assert dropping.run().films["front"].dropped >= 8


def test_a_drifting_calibration_is_seen_in_the_positions(tmp_path):
    bench = Bench(tmp_path, "amount=0.0", faults=MockFaults(drift=0.02))
    bench.arm.arm()
    bench.run()
    assert np.degrees(0.01) < np.ptp(bench.samples.state[:, 2])


def test_an_interrupt_ends_the_trial_as_aborted(tmp_path, monkeypatch):
    bench = Bench(tmp_path)
    bench.arm.arm()
    calls = iter(range(1000))

    def interrupted(_):
        if next(calls) == 12:
            raise KeyboardInterrupt

    bench.controls.show = interrupted
    assert "interrupted" in bench.aborted()


def test_policies_that_cannot_run_on_an_arm_are_refused(tmp_path):
    plan = make_plan((RealPolicy("x", "expert"),), conditions=["O1"])
    with pytest.raises(InvalidInputError, match="reads the state of the simulator"):
        RealPolicies(plan, ("front",))
    bench = Bench(tmp_path)
    info = bench.policies.get("a").info
    with pytest.raises(
        InvalidInputError, match="returns actions in 'so101_degrees', but the run uses 'so101_normalized'"
    ):
        check_real_policy("a", info, make_plan(plan.policies, conditions=["O1"], unit="normalized").action_space, ())
    from dataclasses import replace

    from betterbench.interface import Execution

    with pytest.raises(InvalidInputError, match="needs the camera 'top'"):
        check_real_policy("a", replace(info, cameras=("top",)), bench.plan.action_space, ("front",))
    with pytest.raises(InvalidInputError, match="temporal ensembling"):
        check_real_policy("a", replace(info, execution=Execution(ensemble=0.01)), bench.plan.action_space, ("front",))


def test_a_policy_that_is_not_ready_is_named(tmp_path, monkeypatch):
    from betterbench.real import asking

    monkeypatch.setattr(asking, "START_S", 0.1)
    bench = Bench(tmp_path)
    policy = bench.policies.get("a")
    monkeypatch.setattr(policy, "reset", lambda _: time.sleep(0.5))
    with asking.Asker(policy, bench.plan.action_space) as asker, pytest.raises(PolicyError, match="was not ready"):
        asker.start(EpisodeStart("Wait.", 1, "so101_degrees"))
