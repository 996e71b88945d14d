"""Worlds: the simulated environments of trials, both betterbench's own scenes and those of other benchmarks.

- ``world``: interfaces of worlds and scenes.
- ``registry``: all worlds by name.
- ``betterbench``, ``libero``, ``libero_plus``, ``calvin``: one folder for each world.
- ``installation``, ``process``, ``environment``, ``frames``, ``rows``, ``simulator_loop``: simulators that are
  installed in environments of their own and answer requests over a local socket.
- ``scene``: the scene of a trial in one of these simulators.
- ``authoring``: everything that a file adding a new world has to import.

Each public name is imported from its module when it is first used, so a run in betterbench's own scenes does not import
CALVIN.
"""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

if TYPE_CHECKING:
    from betterbench.sim.worlds.betterbench.world import OWN_WORLD
    from betterbench.sim.worlds.process import WorldError, WorldProcess, WorldProcesses
    from betterbench.sim.worlds.registry import all_worlds, register_world, world_named, world_names, world_of_suite
    from betterbench.sim.worlds.scene import ProcessScene, ProcessWorld, WorldTask
    from betterbench.sim.worlds.world import Photo, PlanRequest, SceneOptions, Tracker, TrialScene, World

__all__ = [
    "OWN_WORLD",
    "Photo",
    "PlanRequest",
    "ProcessScene",
    "ProcessWorld",
    "SceneOptions",
    "Tracker",
    "TrialScene",
    "World",
    "WorldError",
    "WorldProcess",
    "WorldProcesses",
    "WorldTask",
    "all_worlds",
    "register_world",
    "world_named",
    "world_names",
    "world_of_suite",
]

if not TYPE_CHECKING:
    __getattr__ = lazy_names(
        __name__,
        {
            "betterbench.world": ("OWN_WORLD",),
            "process": ("WorldError", "WorldProcess", "WorldProcesses"),
            "registry": ("all_worlds", "register_world", "world_named", "world_names", "world_of_suite"),
            "scene": ("ProcessScene", "ProcessWorld", "WorldTask"),
            "world": ("Photo", "PlanRequest", "SceneOptions", "Tracker", "TrialScene", "World"),
        },
    )
