"""Evaluation: a plan of trials, run by worker processes into a folder that survives anything."""

from betterbench.evaluation.figures.films import Shot, probe_encoder, render_shots, write_video
from betterbench.evaluation.figures.show import show_comparison, show_condition, show_training
from betterbench.evaluation.planning.plan import Plan, Trial, make_plan
from betterbench.evaluation.preflight.check import Convention, PreflightCheck, run_preflight
from betterbench.evaluation.running.external_run import ExternalRun
from betterbench.evaluation.running.replay import ReplayCheck, check_record
from betterbench.evaluation.running.runner import Progress, evaluate
from betterbench.evaluation.serving.server import open_server
from betterbench.evaluation.serving.shadow import TrialName
from betterbench.evaluation.trials.policy_factory import PolicyEntry, check_policy, known_policies

__all__ = [
    "Convention",
    "ExternalRun",
    "Plan",
    "PolicyEntry",
    "PreflightCheck",
    "Progress",
    "ReplayCheck",
    "Shot",
    "Trial",
    "TrialName",
    "check_policy",
    "check_record",
    "evaluate",
    "known_policies",
    "make_plan",
    "open_server",
    "probe_encoder",
    "render_shots",
    "run_preflight",
    "show_comparison",
    "show_condition",
    "show_training",
    "write_video",
]
