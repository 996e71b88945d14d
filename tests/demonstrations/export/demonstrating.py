"""Short demonstrations whose observations are kept, and pictures that cost nothing."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tests.robots import moves_in, task_of

from betterbench.demonstrations.export import pictures as pictures_module
from betterbench.errors import PolicyError
from betterbench.interface import EpisodeStart, Observation, PolicyInfo
from betterbench.interface.actions import action_space
from betterbench.json_form import file_digest
from betterbench.policies.kinds.noop import still_action
from betterbench.records import JournalEntry, Outcome, Record, RunFolder
from betterbench.records.twins import PAIRS_FILE, TwinPair, pairs_bytes
from betterbench.sim.robots import robot_of_space
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import TrialId

STEPS = 9
TRIALS = (TrialId("morning_coffee", "train1", 0), TrialId("morning_coffee", "train2", 1))


class Keeper:
    """Moves about, opens and closes, and keeps what it was shown."""

    def __init__(self, space: str = "ee_delta") -> None:
        self.info = PolicyInfo("keeper", space)
        self.seen: list[Observation] = []

    def reset(self, start: EpisodeStart) -> None:
        self._draw = np.random.default_rng(start.episode)

    def act(self, observation: Observation) -> np.ndarray:
        if observation.step == STEPS:
            raise PolicyError("enough")
        self.seen.append(observation)
        space = action_space(self.info.action_space)
        if not space.is_delta:  # motors: within 2.5 % of their range
            return moves_in(space, still_action(space, observation), int(self._draw.integers(1 << 31)), 1)[0]
        gripper = (-1.0, 0.0, 1.0)[observation.step % 3]
        return np.array([*self._draw.uniform(-0.4, 0.4, 3), *self._draw.uniform(-0.1, 0.1, 3), gripper])


@dataclass
class Demonstrations:
    """A run, its records, what the policy was shown in each, and the scene of the last one, as it was left."""

    run: RunFolder
    records: dict[TrialId, Record]
    seen: dict[TrialId, list[Observation]]
    scene: Scene


def success(record: Record) -> Record:
    return dataclasses.replace(record, outcome=Outcome("success", True))


def trials_in(space: str) -> tuple[TrialId, ...]:
    """Two trials of the robot whose usual or own action space this is."""
    return tuple(dataclasses.replace(trial, task=task_of(robot_of_space(space).name)) for trial in TRIALS)


def start_run(path: Path, trials, *, policy: str = "keeper", action_space: str = "ee_delta") -> RunFolder:
    planned = [{"task": t.task, "condition": t.condition, "variation": None, "seed": t.seed} for t in trials]
    plan = {"trials": planned, "policy": policy, "action_space": action_space, "quality": quality_preset("fast").name}
    return RunFolder.start(path, plan)


def add_record(run: RunFolder, record: Record) -> None:
    path, m = run.write_record(record), record.metadata
    with run.journal() as journal:
        journal.append(JournalEntry(m.task, m.condition, m.variation, m.seed, record=file_digest(path)))


def twins_run(path: Path, demonstrations: Demonstrations) -> tuple[RunFolder, TwinPair]:
    """Returns a run in which the two demonstrations are twins, with their pair."""
    twins = (TRIALS[0], dataclasses.replace(TRIALS[1], seed=TRIALS[0].seed))
    run = start_run(path, twins)
    for trial, record in zip(twins, demonstrations.records.values(), strict=True):
        add_record(run, dataclasses.replace(record, metadata=dataclasses.replace(record.metadata, seed=trial.seed)))
        run.store_scene(record.metadata.scene_hash, demonstrations.run.load_scene(record.metadata.scene_hash))
    pair = TwinPair("it", twins[0].task, twins[0].seed, ("train1", "train2"), ("a", "b"), 3, (10, 10))
    (run.path / PAIRS_FILE).write_bytes(pairs_bytes([pair]))
    return run, pair


@functools.cache
def painted(shift: int, width: int, height: int) -> np.ndarray:
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    picture = np.stack([x // 2 + shift % 90, y // 2 + shift % 70, (x + y) // 4], axis=2).astype(np.uint8)
    picture.setflags(write=False)
    return picture


class PaintedPictures(pictures_module.Pictures):
    """Pictures of noise over a ramp, which follow from the state and cost nothing."""

    def __init__(self, cameras, _quality: str) -> None:
        self._views = tuple((camera.name, camera.width, camera.height) for camera in cameras)

    def of(self, _run: RunFolder, record: Record, rows=None) -> Iterator[dict[str, np.ndarray]]:
        for row in range(record.n_steps) if rows is None else rows:
            yield {name: self._paint(record.qpos[row], i, w, h) for i, (name, w, h) in enumerate(self._views)}

    @staticmethod
    def _paint(qpos: np.ndarray, camera: int, width: int, height: int) -> np.ndarray:
        return painted(int(abs(qpos[:9]).sum() * 40) + 50 * camera, width, height)

    def stop(self) -> None:
        """Nothing is open."""

    def close(self) -> None:
        """Nothing is open."""
