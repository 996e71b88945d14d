"""A run tells its control steps while no trial has ended yet, whatever runs it."""

from __future__ import annotations

import pytest
from tests.evaluation.conftest import check_steps

from betterbench.evaluation import evaluate
from betterbench.evaluation.workers.step_count import StepCount, StepReport

SLOW = """
import time
import numpy as np
from betterbench.interface import PolicyInfo
class Slow:
    info = PolicyInfo("slow", needs_images=False)
    def reset(self, start):
        pass
    def act(self, observation):
        if observation.step >= 120:
            raise RuntimeError("enough")  # long before the step limit
        time.sleep(0.006)
        return np.zeros(7)
"""


@pytest.mark.physics
def test_steps_are_told_before_the_first_trial_ends(tmp_path, tiny_plan):
    """With several workers, too, as a test of the warm-up checks."""
    (tmp_path / "slow.py").write_text(SLOW, encoding="utf-8")
    told = []
    evaluate(
        tiny_plan(f"python:{tmp_path / 'slow.py'}:Slow", trials=2),
        tmp_path / "run",
        workers=1,
        on_progress=lambda state: told.append(("trial", state.done)),
        on_steps=lambda steps: told.append(("steps", steps)),
    )
    check_steps(told)


def test_steps_are_handed_over_now_and_then(monkeypatch):
    told = []
    count = StepCount(told.append)
    report = StepReport(count.add)
    for step in range(5):
        report(step)
    assert not told
    monkeypatch.setattr("betterbench.evaluation.workers.step_count.REPORT_EVERY_S", 0.0)
    due = StepReport(count.add)
    due(1)
    due(2)
    assert told == [1, 2]
    count.add(0)
    assert told == [1, 2]
