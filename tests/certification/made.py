"""Certificates of trials made by hand. Worker processes import this module, so it imports no pytest."""

from __future__ import annotations

import os

from betterbench.certification.certificate import CLAUSES, Clause, TrialCertificate
from betterbench.tasks import TrialId


def make_trial(task="fast_food", condition="L1", seed=0, *, fails="", **changes) -> TrialCertificate:
    """Returns the findings on a trial, with the clauses of the letters in ``fails`` not holding."""
    fields = {
        "task": task,
        "condition": condition,
        "training": condition.startswith("train"),
        "seed": seed,
        "clauses": {c: Clause(c not in fails, f"{c} is <wrong>" if c in fails else "") for c in CLAUSES},
        "steps": 300 + seed,
        "step_limit": 550,
        "penetration_mm": 0.01,
        "drift_mm": 0.002,
        "joint_margin_rad": 0.4,
        "support_slack_mm": 1.5,
        "primitives": ("picks the burger in first",),
        "expert_s": 1.5,
        "total_s": 2.0,
    }
    return TrialCertificate(**{**fields, **changes})


def dies_at_seed_2(trial_id: TrialId) -> TrialCertificate:
    """Stands in for the examination of a trial, and ends its process at seed 2."""
    if trial_id.seed == 2:
        os._exit(7)
    return make_trial(trial_id.task, trial_id.condition, trial_id.seed)
