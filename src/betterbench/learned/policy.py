"""A checkpoint that acts: it sees the state as its family does, and answers one action after the other."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from betterbench.interface import PolicyInfo
from betterbench.learned.checkpoint import Trained, read_checkpoint
from betterbench.learned.network import ACTION_NUMBERS, ObjectsNetwork, ShownBatch
from betterbench.learned.tokens import Things, moment_of, things_of
from betterbench.recording.parquet import file_digest
from betterbench.state import WorldState


class Learner:
    """A network that is ready to answer; several episodes share one.

    Attributes:
        trained: What its checkpoint says.
        fingerprint: SHA-256 of the checkpoint's file; empty while it is being trained.
    """

    def __init__(self, network: ObjectsNetwork, trained: Trained, fingerprint: str = "") -> None:
        self.network, self.trained, self.fingerprint = network, trained, fingerprint
        self._device = network.readout.device

    @classmethod
    def load(cls, path: Path) -> Learner:
        """Read a checkpoint; raises what :func:`read_checkpoint` raises."""
        network, trained = read_checkpoint(path)
        # Sums over several threads differ in their last bits, and results must not depend on the machine's load.
        torch.set_num_threads(1)
        return cls(network, trained, file_digest(path))

    def info(self, address: str) -> PolicyInfo:
        """Return what the learner says about itself under an address."""
        recipe = self.trained.recipe
        about = {
            "checkpoint": f"sha256 {self.fingerprint}",
            "family": recipe.family,
            "loss": recipe.loss,
            "training data": f"sha256 {self.trained.data}",
            "training steps": str(self.trained.step),
        }
        return PolicyInfo(address, action_space=self.trained.action_space, needs_images=False, metadata=about)

    def chunk(self, things: Things, moments: Sequence[tuple[np.ndarray, np.ndarray]], seed: int) -> np.ndarray:
        """Return the next actions.

        Args:
            things: What stays the same in the episode.
            moments: Numbers of tool and poses, the present first, as many as the recipe's history.
            seed: What the noise of a flow is drawn with.

        Returns:
            (chunk, 7) float64, within the bounds of the action space.
        """
        shown = ShownBatch(
            words=self._batch(things.words),
            tools=self._batch(np.stack([tool for tool, _ in moments])),
            poses=self._batch(moments[0][1]),
            sizes=self._batch(things.sizes),
            categories=self._batch(things.categories),
            colors=self._batch(things.colors),
        )
        noise = None
        if self.trained.recipe.loss == "flow":
            drawn = np.random.default_rng(seed).standard_normal((self.network.chunk, ACTION_NUMBERS), dtype=np.float32)
            noise = self._batch(drawn)
        with torch.inference_mode():
            answer = self.network.answer(shown, noise)[0].cpu().numpy().astype(np.float64)
        limited: np.ndarray = np.clip(answer, -1.0, 1.0)
        return limited

    def _batch(self, values: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(values).unsqueeze(0).to(self._device)


class LearnedPolicy:
    """A learner in one episode; it looks again when ``execute`` actions of its last answer have been played."""

    def __init__(self, name: str, learner: Learner, instruction: str, episode: int, *, execute: int) -> None:
        """Prepare for one episode; ``episode`` is the number that the noise of a flow is drawn with."""
        self.name = name
        self._learner, self._instruction, self._episode, self._execute = learner, instruction, episode, execute
        self._things: Things | None = None
        self._chunk = np.empty((0, ACTION_NUMBERS))
        self._began = 0
        self._seen: OrderedDict[int, tuple[np.ndarray, np.ndarray]] = OrderedDict()

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return the next action in the ``ee_delta`` action space, shape (7,)."""
        learner = self._learner
        recipe = learner.trained.recipe
        if self._things is None:
            self._things = things_of(self._instruction, state.info.objects, learner.trained.vocabulary)
        self._seen[state.step] = moment_of(state)
        while len(self._seen) > recipe.history_stride * (recipe.history - 1) + 1:
            self._seen.popitem(last=False)
        age = state.step - self._began
        if not 0 <= age < min(self._execute, len(self._chunk)):
            seed = _noise_seed(self._episode, state.step)
            self._chunk = learner.chunk(self._things, self._moments(state.step), seed)
            self._began, age = state.step, 0
        return np.array(self._chunk[age])

    def _moments(self, step: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the present and those before it; the first one that is known stands for all before it."""
        recipe, first = self._learner.trained.recipe, next(iter(self._seen))
        steps = (max(step - k * recipe.history_stride, first) for k in range(recipe.history))
        return [self._seen[s] for s in steps]


def _noise_seed(episode: int, step: int) -> int:
    return int.from_bytes(hashlib.sha256(f"betterbench flow {episode} {step}".encode()).digest()[:8], "big")
