"""Evaluation: a plan of trials, run by workers into a folder from which the same command resumes.

The packages, from the bottom up: ``planning`` (plan and manifest of a run), ``trials`` (one trial in one process),
``workers`` (worker processes of this machine), ``serving`` (policies behind the openpi protocol), ``ray_engine``
(workers on a Ray cluster), ``running`` (a whole run, your own loop, replay), ``preflight`` (a policy is asked before a
run) and ``integrations`` (the tasks in other harnesses). ``figures`` renders images of scenes and films of records.

Each public name is imported from its module when it is first used.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from betterbench.evaluation.figures.films import Shot, probe_encoder, render_shots, write_video
    from betterbench.evaluation.figures.show import show_comparison, show_condition, show_training
    from betterbench.evaluation.planning.plan import Plan, Trial, make_plan, named_trial
    from betterbench.evaluation.preflight.check import Convention, PreflightCheck, run_preflight
    from betterbench.evaluation.running.external_run import ExternalRun
    from betterbench.evaluation.running.replay import ReplayCheck, check_record
    from betterbench.evaluation.running.runner import Progress, evaluate
    from betterbench.evaluation.serving.server import open_server
    from betterbench.evaluation.trials.known_policies import PolicyEntry, known_policies
    from betterbench.evaluation.trials.policy_factory import check_policy

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
    "check_policy",
    "check_record",
    "evaluate",
    "known_policies",
    "make_plan",
    "named_trial",
    "open_server",
    "probe_encoder",
    "render_shots",
    "run_preflight",
    "show_comparison",
    "show_condition",
    "show_training",
    "write_video",
]

_HOMES = {
    "Shot": "figures.films",
    "probe_encoder": "figures.films",
    "render_shots": "figures.films",
    "write_video": "figures.films",
    "show_comparison": "figures.show",
    "show_condition": "figures.show",
    "show_training": "figures.show",
    "Plan": "planning.plan",
    "Trial": "planning.plan",
    "make_plan": "planning.plan",
    "named_trial": "planning.plan",
    "Convention": "preflight.check",
    "PreflightCheck": "preflight.check",
    "run_preflight": "preflight.check",
    "ExternalRun": "running.external_run",
    "ReplayCheck": "running.replay",
    "check_record": "running.replay",
    "Progress": "running.runner",
    "evaluate": "running.runner",
    "open_server": "serving.server",
    "PolicyEntry": "trials.known_policies",
    "known_policies": "trials.known_policies",
    "check_policy": "trials.policy_factory",
}


def __getattr__(name: str) -> object:
    """Import the module of a name when it is first used; most of them need a simulator."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
