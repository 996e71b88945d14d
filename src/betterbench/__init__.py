"""betterbench: a diagnostic benchmark that finds out why Vision-Language-Action policies fail.

The public names are imported when they are first used, so importing the package takes no time. The modules for
extending the package (tasks, assets, relations, failure modes, learners) are listed in ``docs/reference/index.md``.

Every task is a Gymnasium environment. ``gymnasium.make("betterbench:BeTTER/FastFood-v0", variation="T1")`` imports this
package, which then registers the environments.
"""

import sys
from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names
from betterbench.version import __version__ as __version__

if TYPE_CHECKING:
    from betterbench.api.environments import load_asset_folders, load_task_files, make_env
    from betterbench.api.registration import register_environments
    from betterbench.api.report import write_report
    from betterbench.api.runs import compare, diagnose, evaluate, load_run
    from betterbench.errors import BetterError
    from betterbench.evaluation import ExternalRun, make_plan
    from betterbench.interface import EpisodeStart, Observation, Policy, PolicyInfo

__all__ = [
    "BetterError",
    "EpisodeStart",
    "ExternalRun",
    "Observation",
    "Policy",
    "PolicyInfo",
    "compare",
    "diagnose",
    "evaluate",
    "load_asset_folders",
    "load_run",
    "load_task_files",
    "make_env",
    "make_plan",
    "register_environments",
    "write_report",
]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(
        __name__,
        {
            "api.environments": ("load_asset_folders", "load_task_files", "make_env"),
            "api.registration": ("register_environments",),
            "api.report": ("write_report",),
            "api.runs": ("compare", "diagnose", "evaluate", "load_run"),
            "errors": ("BetterError",),
            "evaluation": ("ExternalRun", "make_plan"),
            "interface": ("EpisodeStart", "Observation", "Policy", "PolicyInfo"),
        },
    )


def __dir__() -> list[str]:
    """List the public names, including those that have not been imported yet."""
    return sorted({*globals(), *__all__})


if "gymnasium" in sys.modules:
    from betterbench.api.registration import register_environments

    register_environments()
