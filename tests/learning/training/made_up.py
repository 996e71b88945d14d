"""Training sets that were never recorded: the tool goes to the object whose color the instruction names."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from betterbench.learning.training.data import TrainingSet
from betterbench.learning.training.frames import FrameStore, frames_bytes
from betterbench.policies.learned.vocabulary import Vocabulary
from betterbench.tasks import TrialId

STEPS = 20


def made_up(episodes: int = 12, *, seed: int = 0) -> TrainingSet:
    draw = np.random.default_rng(seed)
    known = Vocabulary(("blue", "red", "side"), ("mug",), ("blue", "red"))
    places = draw.uniform(-0.2, 0.2, (episodes, 2, 3))
    wanted = np.arange(episodes) % 2
    goal = places[np.arange(episodes), wanted]
    share = np.linspace(0.0, 1.0, STEPS)[:, None]
    ways = goal[:, None] * share
    tools = np.zeros((episodes, STEPS, 10))
    tools[..., :3], tools[..., 3], tools[..., 7], tools[..., 9] = ways, 1.0, 1.0, 0.08
    poses = np.zeros((episodes, STEPS, 2, 9))
    poses[..., :3], poses[..., 3], poses[..., 7] = places[:, None], 1.0, 1.0
    actions = np.zeros((episodes, STEPS, 7))
    actions[..., :3] = goal[:, None] / 0.2
    actions[..., 6] = np.where(np.arange(STEPS) < STEPS - 3, -1.0, 1.0)
    ends = np.arange(1, episodes + 1) * STEPS
    return TrainingSet(
        vocabulary=known,
        trials=tuple(TrialId("morning_coffee", "train1", i) for i in range(episodes)),
        sha256=f"made up {seed}",
        words=known.word_ids("blue red")[wanted][:, None],
        sizes=np.full((episodes, 2, 3), 0.1, dtype=np.float32),
        categories=np.full((episodes, 2), 2),
        colors=np.tile(np.array([2, 3]), (episodes, 1)),
        held_out=np.arange(episodes) >= episodes - 2,
        tools=tools.reshape(-1, 10).astype(np.float32),
        poses=poses.reshape(-1, 2, 9).astype(np.float32),
        actions=actions.reshape(-1, 7).astype(np.float32),
        episodes=np.repeat(np.arange(episodes), STEPS),
        first=ends - STEPS,
        last=ends - 1,
        phases=np.tile((np.arange(STEPS) >= STEPS - 5).astype(np.int64), episodes),
        at_gripper=np.tile(np.arange(STEPS) >= STEPS - 6, episodes),
    )


def pictured(folder: Path, episodes: int = 12, *, seed: int = 0, size: int = 16) -> TrainingSet:
    """The same in pictures: the things as squares of their color, and the place of the tool in white."""
    data, files = made_up(episodes, seed=seed), []
    folder.mkdir(exist_ok=True)
    for episode in range(episodes):
        rows = slice(data.first[episode], data.last[episode] + 1)
        frames = np.zeros((STEPS, 1, size, size, 3), np.uint8)
        for frame, tool, poses in zip(frames[:, 0], data.tools[rows], data.poses[rows], strict=True):
            for place, color in ((poses[0], (0, 0, 255)), (poses[1], (255, 0, 0)), (tool, (255, 255, 255))):
                x, y = ((place[:2] + 0.25) / 0.5 * size).astype(int)
                frame[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2] = color
        files.append(folder / f"{episode}.bin")
        files[-1].write_bytes(frames_bytes(frames))
    return dataclasses.replace(data, frames_of=FrameStore.open(files), sha256=f"pictured {seed}")
