"""Evaluation: a plan of trials, run by worker processes into a folder that survives anything."""

from betterbench.evaluation.agents import PolicyEntry, check_policy, known_policies
from betterbench.evaluation.consultation import Consultation, Convention, consult
from betterbench.evaluation.driven import DrivenRun
from betterbench.evaluation.films import Shot, probe_encoder, render_shots, write_video
from betterbench.evaluation.mirror import TrialName
from betterbench.evaluation.plan import Plan, Trial, make_plan
from betterbench.evaluation.replay import ReplayCheck, check_record
from betterbench.evaluation.runner import Progress, evaluate
from betterbench.evaluation.serving import open_server
from betterbench.evaluation.show import show_comparison, show_condition, show_training

__all__ = [
    "Consultation",
    "Convention",
    "DrivenRun",
    "Plan",
    "PolicyEntry",
    "Progress",
    "ReplayCheck",
    "Shot",
    "Trial",
    "TrialName",
    "check_policy",
    "check_record",
    "consult",
    "evaluate",
    "known_policies",
    "make_plan",
    "open_server",
    "probe_encoder",
    "render_shots",
    "show_comparison",
    "show_condition",
    "show_training",
    "write_video",
]
