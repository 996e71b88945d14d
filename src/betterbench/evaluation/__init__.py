"""Evaluation: workers run the trials of a plan and write the results to a run folder.

- ``planning``: plan and manifest of a run.
- ``trials``: execution of one trial in one process.
- ``workers``: worker processes on this machine.
- ``serving``: policies that are served with openpi's protocol.
- ``ray_engine``: workers on a Ray cluster.
- ``running``: complete runs, runs controlled by the user's own loop, and replay.
- ``preflight``: check of a policy before a run.
- ``integrations``: the tasks in other evaluation harnesses.
- ``figures``: images and videos.

Each package except ``figures`` may import only the packages listed before it. Each public name is imported from its
module when it is first used.
"""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from betterbench.evaluation.figures.films import Shot, probe_encoder, render_shots, write_video
    from betterbench.evaluation.figures.show import show_comparison, show_condition, show_training
    from betterbench.evaluation.figures.twin_film import (
        FilmLook,
        Panel,
        TwinFilm,
        render_paths,
        render_strips,
        render_twin_films,
        write_twin_film,
    )
    from betterbench.evaluation.planning.plan import Plan, make_plan, named_trial
    from betterbench.evaluation.preflight.check import Convention, PreflightCheck, run_preflight
    from betterbench.evaluation.running.external_run import ExternalRun
    from betterbench.evaluation.running.replay import ReplayCheck, check_record
    from betterbench.evaluation.running.runner import Progress, evaluate
    from betterbench.evaluation.serving.server import open_server
    from betterbench.tasks.trial import Trial

__all__ = [
    "Convention",
    "ExternalRun",
    "FilmLook",
    "Panel",
    "Plan",
    "PreflightCheck",
    "Progress",
    "ReplayCheck",
    "Shot",
    "Trial",
    "TwinFilm",
    "check_record",
    "evaluate",
    "make_plan",
    "named_trial",
    "open_server",
    "probe_encoder",
    "render_paths",
    "render_shots",
    "render_strips",
    "render_twin_films",
    "run_preflight",
    "show_comparison",
    "show_condition",
    "show_training",
    "write_twin_film",
    "write_video",
]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(
        __name__,
        {
            "figures.films": ("Shot", "probe_encoder", "render_shots", "write_video"),
            "figures.twin_film": (
                "FilmLook",
                "Panel",
                "TwinFilm",
                "render_paths",
                "render_strips",
                "render_twin_films",
                "write_twin_film",
            ),
            "figures.show": ("show_comparison", "show_condition", "show_training"),
            "planning.plan": ("Plan", "Trial", "make_plan", "named_trial"),
            "preflight.check": ("Convention", "PreflightCheck", "run_preflight"),
            "running.external_run": ("ExternalRun",),
            "running.replay": ("ReplayCheck", "check_record"),
            "running.runner": ("Progress", "evaluate"),
            "serving.server": ("open_server",),
        },
    )
