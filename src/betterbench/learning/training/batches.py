"""Batches of training data. A batch depends only on the seed and the step, so that training can be resumed."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from betterbench.learning.training.data import TrainingSet
from betterbench.learning.training.frames import FrameStore
from betterbench.policies.learned.network import AskedBatch, ObjectsBatch, ShownBatch
from betterbench.policies.learned.pixels import PicturesBatch
from betterbench.policies.learned.recipe import TrainingRecipe


class Batches:
    """Sampler of batches from a training set. The frames are stored as tensors on a device."""

    def __init__(self, data: TrainingSet, recipe: TrainingRecipe, device: str) -> None:
        self._recipe = recipe
        frames = data.frames(held_out=False)
        self._pool = np.concatenate([frames, *_repeats(frames, data, recipe)])
        names = ("words", "sizes", "categories", "colors", "tools", "poses", "actions", "episodes", "first", "last")
        self._store = data.frames_of
        if data.frames_of is not None:
            shown = np.ones(len(data.actions), bool) if data.shown is None else data.shown
            self._picture_of = np.cumsum(shown) - 1
        self._held = {name: torch.from_numpy(getattr(data, name)).to(device) for name in names}
        self._questions, self._to_ask = data.questions, data.asked(held_out=False)
        if data.questions is not None:
            asked = ("words", "episodes", "tools", "poses", "answers")
            self._asked = {name: torch.from_numpy(getattr(data.questions, name)).to(device) for name in asked}
        self._device = device

    def drawn(self, step: int, rank: int = 0, world: int = 1) -> np.ndarray:
        """Draw the frames for a training step.

        If several processes train together, return only the frames for one of them.

        Args:
            step: Index of the step.
            rank: Index of the process.
            world: Number of processes.
        """
        found = self._pool[_stream(self._recipe.seed, step, 0).integers(len(self._pool), size=self._recipe.batch)]
        return found[rank::world]

    def drawn_questions(self, step: int, rank: int = 0, world: int = 1) -> np.ndarray:
        """Draw the questions for a training step.

        If several processes train together, return only the questions for one of them.

        Args:
            step: Index of the step.
            rank: Index of the process.
            world: Number of processes.
        """
        chosen = _stream(self._recipe.seed, step, 1).integers(len(self._to_ask), size=self._recipe.questions)
        found: np.ndarray = self._to_ask[chosen]
        return found[rank::world]

    def questions(self, chosen: np.ndarray, *, training: bool) -> AskedBatch:
        """Return a batch of questions with the observations that belong to them and the correct answers.

        Args:
            chosen: Indices of the questions.
            training: Whether to augment the observations.
        """
        asked = self._questions
        if asked is None:
            raise AssertionError("the recipe has no co_training, so there are no questions")
        at = torch.from_numpy(chosen).to(self._device)
        held = self._asked
        common = {"words": held["words"][at], "tools": held["tools"][at]}
        shown: ShownBatch
        if asked.frames_of is None or asked.frames is None:
            things = {name: self._held[name][held["episodes"][at]] for name in ("sizes", "categories", "colors")}
            shown = ObjectsBatch(**common, **things, poses=held["poses"][at])
        else:
            shown = PicturesBatch(
                **common, pictures=self._pictures(asked.frames_of, asked.frames[chosen], training=training)
            )
        if training:
            self._augment(shown)
        return AskedBatch(shown, held["answers"][at])

    def sample(self, frames: np.ndarray, *, training: bool) -> tuple[ShownBatch, Tensor, Tensor]:
        """Return a batch of training data for the given frames.

        Args:
            frames: (B,) indices of the frames.
            training: Whether to augment the observations.

        Returns:
            Observations, action chunks (B, chunk, 7), and a mask of the valid actions (B, chunk).
        """
        held, recipe = self._held, self._recipe
        at = torch.from_numpy(frames).to(self._device)
        episode = held["episodes"][at]
        first, last = held["first"][episode], held["last"][episode]
        ahead = at[:, None] + torch.arange(recipe.chunk, device=self._device)
        back = at[:, None] - recipe.history_stride * torch.arange(recipe.history, device=self._device)
        common = {"words": held["words"][episode], "tools": held["tools"][torch.maximum(back, first[:, None])]}
        shown: ShownBatch
        if self._store is None:
            things = {name: held[name][episode] for name in ("sizes", "categories", "colors")}
            shown = ObjectsBatch(**common, **things, poses=held["poses"][at])
        else:
            pictures = self._pictures(self._store, self._picture_of[frames], training=training)
            shown = PicturesBatch(**common, pictures=pictures)
        if training:
            self._augment(shown)
        return shown, held["actions"][torch.minimum(ahead, last[:, None])], ahead <= last[:, None]

    def _pictures(self, store: FrameStore, numbers: np.ndarray, *, training: bool) -> Tensor:
        """Return the images of frames, (B, views, size, size, 3) uint8. During training, they are shifted at random."""
        shifts, most = None, self._recipe.augmentation.shift_px
        if training and most:
            views = len(self._recipe.eyes.windows)
            shifts = torch.randint(-most, most + 1, (len(numbers), views, 2)).numpy()
        return torch.from_numpy(store.read(numbers, shifts)).to(self._device)

    def _augment(self, shown: ShownBatch) -> None:
        """Augment observations in place as the recipe requests, using torch's random generator."""
        recipe, batch = self._recipe, len(shown.words)
        own, other = recipe.proprioception, recipe.augmentation
        if own.noise_m:
            noise = own.noise_m * torch.randn(batch, 1, 3, device=self._device)
            shown.tools = torch.cat([shown.tools[..., :3] + noise, shown.tools[..., 3:]], dim=-1)
        if isinstance(shown, PicturesBatch) and other.light:
            shown.light = other.light * torch.randn(batch, 2, device=self._device)
        if isinstance(shown, ObjectsBatch) and other.object_noise_m:
            noise = other.object_noise_m * torch.randn_like(shown.poses[..., :3])
            shown.poses = torch.cat([shown.poses[..., :3] + noise, shown.poses[..., 3:]], dim=-1)
        if isinstance(shown, ObjectsBatch) and other.shift_m:
            shift = other.shift_m * (2.0 * torch.rand(batch, 1, 3, device=self._device) - 1.0)
            shift[..., 2] = 0.0
            shown.tools = torch.cat([shown.tools[..., :3] + shift, shown.tools[..., 3:]], dim=-1)
            shown.poses = torch.cat([shown.poses[..., :3] + shift, shown.poses[..., 3:]], dim=-1)
        if own.dropout:
            shown.blind = torch.rand(batch, device=self._device) < own.dropout


def _stream(seed: int, step: int, what: int) -> np.random.Generator:
    """Return a random generator for one purpose and one training step. It is independent of all other generators."""
    # With the step in the counter of a Philox generator, the streams of earlier steps do not have to be computed.
    return np.random.Generator(np.random.Philox(key=seed, counter=[0, 0, what, step]))


def _repeats(frames: np.ndarray, data: TrainingSet, recipe: TrainingRecipe) -> list[np.ndarray]:
    """Return indices of the frames around gripper changes, repeated as often as their weight in the recipe requires.

    If the weight is not an integer, some of these frames are repeated once more than the others. They are evenly
    spread.
    """
    at_gripper = frames[data.at_gripper[frames]]
    extra = recipe.gripper_weight - 1.0
    whole = int(extra)
    spread = np.linspace(0, len(at_gripper), round((extra - whole) * len(at_gripper)), endpoint=False).astype(np.int64)
    return [at_gripper] * whole + [at_gripper[spread]]
