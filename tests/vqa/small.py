"""What the tests share: a small run, and the options of a small set."""

from __future__ import annotations

import dataclasses

from betterbench.evaluation import evaluate, make_plan
from betterbench.vqa.dataset import SetOptions

SIZE = 160
OPTIONS = SetOptions(questions=120, frames=2, cameras=("front", "left_shoulder"), size=SIZE, quality="fast")
WANTED = {"fruit_lunch": ("L1", "O2"), "dinner_plates": ("T1",), "morning_coffee": ("L1",)}


def small_run(policy, folder, wanted=WANTED):
    """Evaluates a policy on one trial of each of some variations."""
    plan = make_plan(policy, tasks=list(wanted), trials=1, observation="state_only", quality="fast")
    trials = tuple(t for t in plan.trials if t.variation in wanted[t.task])
    return evaluate(dataclasses.replace(plan, trials=trials), folder)
