"""A run of two short episodes in which the arm moves, with what the policy was shown and what was drawn meanwhile."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from tests.kept_views import KeptView

from betterbench.episodes import Observer, TrialContext, run_episode
from betterbench.interface import CameraSpec, EpisodeStart, Observation, ObservationSpec, PolicyInfo
from betterbench.interface.actions import EE_DELTA
from betterbench.json_form import file_digest
from betterbench.records import JournalEntry, Record, RunFolder
from betterbench.records.modalities.spec import ViewSpec
from betterbench.sim.modalities import run as materialization_run
from betterbench.sim.modalities import viewing
from betterbench.sim.modalities.folder import Wanted
from betterbench.sim.modalities.live import LiveMaterializer
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.limited import LimitedView
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import get_task

VIEWS = (ViewSpec("front", 96, 96), ViewSpec("wrist", 64, 48))
SHOWN = ObservationSpec("small", tuple(CameraSpec(v.camera, v.width, v.height) for v in VIEWS))
STEPS = 4


class Reaching:
    """A policy that moves toward the table, and remembers what it is shown."""

    info = PolicyInfo("reaching", needs_images=True)

    def __init__(self, live: LiveMaterializer) -> None:
        self._live = live
        self.seen: list[Observation] = []

    def reset(self, start: EpisodeStart) -> None:
        del start
        self._live.add()  # the first row of the record is the state that an episode begins with

    def act(self, observation: Observation) -> np.ndarray:
        self.seen.append(observation)
        return np.array([0.3, 0.2, -0.9, 0.0, 0.0, 0.5, 1.0])


@dataclass(frozen=True)
class Recorded:
    """A run, and per seed its record and the observations of the policy; ``live`` was drawn while recording."""

    run: RunFolder
    live: Path
    records: dict[int, Record]
    seen: dict[int, list[Observation]]


@pytest.fixture(scope="session")
def recorded(tmp_path_factory) -> Recorded:
    folder = tmp_path_factory.mktemp("materialize")
    task = get_task("fast_food")
    template = dataclasses.replace(task.template, base_steps=STEPS, steps_per_subgoal=0, still_steps=STEPS)
    task = dataclasses.replace(task, template=template)
    run = RunFolder.start(folder / "run", {"policy": "reaching", "quality": {"name": "standard"}})
    found = Recorded(run, folder / "live", {}, {})
    observer = Observer(SHOWN)
    context = TrialContext(policy="reaching", camera_preset="small")
    with run.journal() as journal:
        for seed in (0, 1):
            scene = Scene(task, task.training[0], seed=seed, action_space=EE_DELTA, quality=quality_preset("standard"))
            with LiveMaterializer(scene, found.live, Wanted(VIEWS)) as live:
                policy = Reaching(live)
                result = run_episode(
                    scene, policy, context=context, observer=observer, on_step=lambda _, live=live: live.add()
                )
                record = result.record
                run.store_scene(record.metadata.scene_hash, scene.files())
                digest = file_digest(run.write_record(record))
                live.finish(record, digest)
            wall = {"duration_s": 1.0}
            entry = JournalEntry("fast_food", record.metadata.condition, None, seed, wall=wall, record=digest)
            journal.append(entry)
            found.records[seed], found.seen[seed] = record, policy.seen
    observer.close()
    return found


def draw_in_one_process(monkeypatch, processes):
    """Let commands draw in one process, which ``processes`` holds."""

    def kept(*, quality: str) -> KeptView:
        alive = [process for process in processes if not process.is_closed]
        if not alive:
            processes.append(KeptView(quality=quality))
        return processes[-1] if not alive else alive[0]

    for module in (materialization_run, viewing):
        monkeypatch.setattr(module, "LimitedView", kept)


@pytest.fixture
def one_process(monkeypatch, processes):
    """Let commands of several tests draw in one process."""
    draw_in_one_process(monkeypatch, processes)


@pytest.fixture(scope="session")
def processes():
    made: list[KeptView] = []
    yield made
    for process in made:
        LimitedView.close(process)
