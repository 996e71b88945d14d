"""Records of two short demonstrations, which are simulated once."""

from __future__ import annotations

import functools

from demonstrating import Keeper, success

from betterbench.episodes import Observer, TrialContext, run_episode
from betterbench.interface import observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.records import Record
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId, get_task

TRIALS = [TrialId("morning_coffee", "train1", 0), TrialId("morning_coffee", "train1", 1)]


@functools.cache
def short_records() -> tuple[Record, ...]:
    found, task = [], get_task("morning_coffee")
    for trial in TRIALS:
        scene = Scene(task, task.training[0], seed=trial.seed, action_space=EE_DELTA, quality=quality_preset("fast"))
        observer = Observer(observation_spec("state_only"))
        found.append(success(run_episode(scene, Keeper(), context=TrialContext("keeper"), observer=observer).record))
        observer.close()
    return tuple(found)
