"""A run with two short demonstrations."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from betterbench.episodes import Observer, TrialContext, run_episode
from betterbench.interface import observation_spec
from betterbench.interface.actions import action_space
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task

sys.path.insert(0, str(Path(__file__).parent))
from demonstrating import Demonstrations, Keeper, PaintedPictures, add_record, start_run, success, trials_in


@pytest.fixture(scope="session")
def demonstrations_in(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Demonstrations]:
    """Returns the demonstrations in an action space, of the robot whose space it is."""

    @functools.cache
    def make(space: str) -> Demonstrations:
        trials = trials_in(space)
        folder = tmp_path_factory.mktemp("demonstrations") / "run"
        made = Demonstrations(start_run(folder, trials, action_space=space), {}, {}, None)
        for trial in trials:
            task = get_task(trial.task)
            condition = next(c for c in task.training if c.name == trial.condition)
            declared, quality = action_space(space), quality_preset("fast")
            made.scene = Scene(task, condition, seed=trial.seed, action_space=declared, quality=quality)
            keeper, observer = Keeper(space), Observer(observation_spec("default"))
            context = TrialContext("keeper", camera_preset="default")
            record = success(run_episode(made.scene, keeper, context=context, observer=observer).record)
            observer.close()
            add_record(made.run, record)
            made.run.store_scene(made.scene.compiled.content_hash, made.scene.files())
            made.records[trial], made.seen[trial] = record, keeper.seen
        return made

    return make


@pytest.fixture(scope="session")
def demonstrations(demonstrations_in: Callable[[str], Demonstrations]) -> Demonstrations:
    return demonstrations_in("ee_delta")


@pytest.fixture
def painted(monkeypatch) -> None:
    """Replaces the renderer, where the pictures themselves do not matter."""
    from betterbench.demonstrations.export import check, job

    monkeypatch.setattr(job, "Pictures", PaintedPictures)
    monkeypatch.setattr(check, "Pictures", PaintedPictures)
