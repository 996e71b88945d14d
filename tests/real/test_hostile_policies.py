"""Policies that answer nonsense, hang or die: the arm stops, the record stays, and the limits hold."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest
from tests.daily import others_slow
from tests.real.test_loop import Bench

from betterbench.real import asking
from betterbench.real.asking import RealPolicies
from betterbench.real.loop import TrialAbortedError
from betterbench.real.plan import RealPolicy, make_plan

HOSTILE = f"python:{Path(__file__).parent / 'hostile.py'}:Hostile"
pytestmark = [pytest.mark.render, pytest.mark.physics]


def hostile_bench(folder, options, **limits):
    bench = Bench(folder, **limits)
    address = f"{HOSTILE}?{options}"
    bench.plan = make_plan((RealPolicy("a", address),), conditions=["O1"], time_limit_s=1.0, rate_hz=20.0)
    bench.policies = RealPolicies(bench.plan, ("front",), apart=False)
    bench.arm.arm()
    return bench


@pytest.mark.parametrize(
    ("how", "says"),
    others_slow(
        [
            ("strings", "number"),
            ("numbers_as_text", "number"),
            ("infinite", "finite"),
            ("short", "(5,)"),
            ("empty", "(0, 6)"),
            ("ragged", "ValueError"),
            ("none", "expected an array of numbers"),
            ("deep", "(2, 2, 6)"),
            ("complex", "number"),
            ("vanishes", "Vanish: gone"),
            ("exits", "SystemExit"),
            ("interrupts", "KeyboardInterrupt"),
        ],
        3,
    ),
)
def test_an_answer_that_is_no_action_ends_the_trial_at_once(tmp_path, how, says):
    bench = hostile_bench(tmp_path, f"how={how}")
    began = time.monotonic()
    assert says in bench.aborted()
    assert time.monotonic() - began < 20.0
    assert len(bench.samples) >= 4
    assert np.isfinite(bench.samples.command).all()


@pytest.mark.parametrize("how", others_slow(["jumps", "tiny_and_huge"], 2))
def test_huge_jumps_reach_the_arm_within_all_limits(tmp_path, how):
    bench = hostile_bench(tmp_path, f"how={how}")
    try:
        bench.run()
    except TrialAbortedError as problem:
        assert "does not follow" in str(problem) or "load" in str(problem)  # noqa: PT017 - both ends are right
    bench.require_still()
    limiter, samples = bench.arm.limiter, bench.samples
    assert samples.limited.sum() > 3
    steps = np.abs(np.diff(samples.command, axis=0))
    assert (steps <= limiter.most_step + 1e-9).all()
    assert ((samples.command >= limiter.low) & (samples.command <= limiter.high)).all()
    low, high = np.array(limiter.limits.box_low), np.array(limiter.limits.box_high)
    for row in samples.command:
        tool = limiter.tool(row)
        assert ((tool >= low - 1e-9) & (tool <= high + 1e-9)).all()


def test_a_policy_that_hangs_is_given_up_and_the_arm_holds_before_the_wait(tmp_path, monkeypatch):
    """The arm was told to hold its place only after the policy's answer, which may never come."""
    monkeypatch.setattr(asking, "ANSWER_S", 3.0)
    bench = hostile_bench(tmp_path, "how=hangs&hang_s=8")
    held = []

    def watch():
        while bench.arm.why_off != "the trial is over" and len(held) < 2000:
            time.sleep(0.01)
            held.append(0)
        held.append(time.monotonic())

    watcher = threading.Thread(target=watch)
    policy = bench.policies.get("a")
    from betterbench.real.loop import TrialRun

    run = TrialRun(bench.arm, policy, bench.plan, bench.plan.trials[0], attempt=1, controls=bench.controls)
    watcher.start()
    header = run.run(bench.folder)
    watcher.join()
    assert header.ending == "time_limit"
    assert header.held_steps >= 14
    assert time.monotonic() - held[-1] > 2.0  # it was off long before the wait for the answer was over
    assert run.left_busy
    bench.require_still()
    bench.policies.discard("a")
    assert bench.policies.get("a") is not policy


def test_the_stop_key_does_not_wait_for_a_policy_that_loads(tmp_path, monkeypatch):
    monkeypatch.setattr(asking, "ANSWER_S", 0.2)
    bench = hostile_bench(tmp_path, "how=hangs_at_reset&hang_s=20")

    def stop():
        time.sleep(1.0)
        bench.controls.stop.set()
        bench.arm.stop("the operator stopped it")

    threading.Thread(target=stop).start()
    began = time.monotonic()
    assert "the operator stopped it" in bench.aborted()
    assert time.monotonic() - began < 12.0
