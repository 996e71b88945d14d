"""A run with two short demonstrations."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from betterbench.episodes import Observer, TrialContext, run_episode
from betterbench.interface import observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task

sys.path.insert(0, str(Path(__file__).parent))
from demonstrating import TRIALS, Demonstrations, Keeper, PaintedPictures, add_record, start_run, success


@pytest.fixture(scope="session")
def demonstrations(tmp_path_factory: pytest.TempPathFactory) -> Demonstrations:
    run = start_run(tmp_path_factory.mktemp("demonstrations") / "run", TRIALS)
    made = Demonstrations(run, {}, {}, None)
    for trial in TRIALS:
        task = get_task(trial.task)
        condition = next(c for c in task.training if c.name == trial.condition)
        made.scene = Scene(task, condition, seed=trial.seed, action_space=EE_DELTA, quality=quality_preset("fast"))
        keeper, observer = Keeper(), Observer(observation_spec("default"))
        context = TrialContext("keeper", camera_preset="default")
        record = success(run_episode(made.scene, keeper, context=context, observer=observer).record)
        observer.close()
        add_record(run, record)
        run.store_scene(made.scene.compiled.content_hash, made.scene.files())
        made.records[trial], made.seen[trial] = record, keeper.seen
    return made


@pytest.fixture
def painted(monkeypatch) -> None:
    """Replaces the renderer, where the pictures themselves do not matter."""
    from betterbench.demonstrations.export import check, job

    monkeypatch.setattr(job, "Pictures", PaintedPictures)
    monkeypatch.setattr(check, "Pictures", PaintedPictures)
