"""Policies that act with the checkpoint of a learner. Depending on the learner's family, they use states or images."""

from __future__ import annotations

import contextlib
import hashlib
from collections import OrderedDict
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import torch

from betterbench.errors import InvalidInputError
from betterbench.interface import EpisodeStart, Execution, Observation, ObservationSpec, PolicyInfo
from betterbench.interface.state import WorldState
from betterbench.json_form import file_digest
from betterbench.policies.learned.checkpoint import Trained, read_checkpoint
from betterbench.policies.learned.eyes import looked_at
from betterbench.policies.learned.network import ACTION_NUMBERS, LearnerNetwork, ObjectsBatch, ShownBatch
from betterbench.policies.learned.pixels import PicturesBatch
from betterbench.policies.learned.recipe import TrainingRecipe, require_asked
from betterbench.policies.learned.tokens import Things, moment_of, things_of, tool_numbers
from betterbench.tasks.user_files import explaining

SeenT = TypeVar("SeenT")

KEPT_INSTRUCTIONS = 64
"""Number of instructions whose encodings a learner keeps in memory."""


class Learner:
    """Trained network in memory, which several episodes share.

    Attributes:
        trained: Metadata of the checkpoint.
        fingerprint: SHA-256 of the checkpoint file. Empty during training.
    """

    def __init__(self, network: LearnerNetwork, trained: Trained, fingerprint: str = "") -> None:
        self.network, self.trained, self.fingerprint = network, trained, fingerprint
        self._device = network.action_mean.device
        self._heard = OrderedDict[bytes, Any]()

    @classmethod
    def load(cls, path: Path) -> Learner:
        """Load a checkpoint. Raises the errors of :func:`read_checkpoint`."""
        network, trained = read_checkpoint(path)
        # A single thread is used, because sums over several threads differ in the last bits, and results must not
        # depend on how busy the machine is.
        torch.set_num_threads(1)
        return cls(network, trained, file_digest(path))

    def info(self, address: str, *, execute: int) -> PolicyInfo:
        """Return the description of the learner as a policy with the given address.

        ``execute`` is the number of actions of each chunk that are executed.
        """
        recipe = self.trained.recipe
        about = {
            "checkpoint": f"sha256 {self.fingerprint}",
            "family": recipe.family,
            **({} if self.trained.code is None else {"code of the family": self.trained.code}),
            "loss": recipe.loss,
            "training data": f"sha256 {self.trained.data}",
            "training steps": str(self.trained.step),
        }
        if recipe.sees == "objects":
            return PolicyInfo(address, action_space=self.trained.action_space, needs_images=False, metadata=about)
        return PolicyInfo(
            address,
            action_space=self.trained.action_space,
            metadata={**about, "cameras": ", ".join(recipe.eyes.cameras)},
            execution=Execution(horizon=execute),
            cameras=recipe.eyes.cameras,
        )

    def chunk(self, shown: ShownBatch, seed: int) -> np.ndarray:
        """Return the next actions, (chunk, 7) float64, clipped to the bounds of the action space.

        Args:
            shown: Inputs, as a batch of one sample.
            seed: Seed of the noise from which a flow-matching learner generates actions.
        """
        noise = None
        if self.trained.recipe.loss == "flow":
            drawn = np.random.default_rng(seed).standard_normal((self.network.chunk, ACTION_NUMBERS), dtype=np.float32)
            noise = self.batch(drawn)
        with torch.inference_mode(), contextlib.ExitStack() as stack:
            if not self.trained.recipe.built_in:  # a user's network may draw random numbers
                stack.enter_context(torch.random.fork_rng(devices=[]))
                torch.manual_seed(seed >> 1)
            answer = self.network.act(shown, noise, self._hear(shown.words))[0].cpu().numpy().astype(np.float64)
        limited: np.ndarray = np.clip(answer, -1.0, 1.0)
        return limited

    def _hear(self, words: torch.Tensor) -> Any:  # noqa: ANN401 - depends on the family
        """Return the encoding of an instruction. It is computed once and then cached."""
        key = words.cpu().numpy().tobytes()
        heard = self._heard.pop(key, None)
        if heard is None:
            with explaining("family", self.trained.recipe.family):
                heard = self.network.hear(words)
        self._heard[key] = heard
        while len(self._heard) > KEPT_INSTRUCTIONS:
            self._heard.popitem(last=False)
        return heard

    def batch(self, values: np.ndarray) -> torch.Tensor:
        """Convert an array to a batch of one sample, on the device of the network."""
        return torch.from_numpy(values).unsqueeze(0).to(self._device)


class LearnedPolicy:
    """Policy that acts with a learner of the family ``objects`` in one episode.

    It predicts a new chunk every ``execute`` actions.
    """

    def __init__(self, name: str, learner: Learner, instruction: str, episode: int, *, execute: int) -> None:
        """Store the instruction.

        ``episode`` is the seed of the noise from which a flow-matching learner generates actions.
        """
        self.name = name
        self._learner, self._instruction, self._episode, self._execute = learner, instruction, episode, execute
        self._things: Things | None = None
        self._chunk = np.empty((0, ACTION_NUMBERS))
        self._began = 0
        self._past = _Past[tuple[np.ndarray, np.ndarray]](learner.trained.recipe)

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return the next action (7,) in the action space ``ee_delta``."""
        learner = self._learner
        if self._things is None:
            self._things = things_of(self._instruction, state.info.objects, learner.trained.vocabulary)
        self._past.keep(state.step, moment_of(state))
        age = state.step - self._began
        if not 0 <= age < min(self._execute, len(self._chunk)):
            shown = self._shown(self._things, self._past.before(state.step))
            self._chunk = learner.chunk(shown, _noise_seed(self._episode, state.step))
            self._began, age = state.step, 0
        return np.array(self._chunk[age])

    def _shown(self, things: Things, moments: list[tuple[np.ndarray, np.ndarray]]) -> ObjectsBatch:
        batch = self._learner.batch
        return ObjectsBatch(
            words=batch(things.words),
            tools=batch(np.stack([tool for tool, _ in moments])),
            poses=batch(moments[0][1]),
            sizes=batch(things.sizes),
            categories=batch(things.categories),
            colors=batch(things.colors),
        )


class SeeingPolicy:
    """Policy that acts with a learner of the family ``pixels``. Like policies on servers, it gets observations."""

    def __init__(self, address: str, learner: Learner, *, execute: int) -> None:
        """Prepare the policy.

        Raises InvalidInputError if the recipe's history stride is not a multiple of ``execute``.
        """
        recipe = learner.trained.recipe
        if recipe.history > 1:
            require_asked(recipe.history_stride, execute, f"policy {address}: history_stride")
        self.info = learner.info(address, execute=execute)
        self._learner = learner
        self._words = np.empty(0, np.int64)
        self._episode = 0
        self._past = _Past[np.ndarray](recipe)

    def reset(self, start: EpisodeStart) -> None:
        """Begin an episode: clear the history and read the instruction."""
        self._words = self._learner.trained.vocabulary.word_ids(start.instruction)
        self._episode = start.episode
        self._past = _Past(self._learner.trained.recipe)

    def act(self, observation: Observation) -> np.ndarray:
        """Return the next actions (chunk, 7) in the action space ``ee_delta``."""
        learner, recipe = self._learner, self._learner.trained.recipe
        position, quaternion = np.array([observation.ee_position]), np.array([observation.ee_quaternion])
        tools = tool_numbers(position, quaternion, np.array([observation.gripper_width]))
        self._past.keep(observation.step, tools[0])
        shown = PicturesBatch(
            words=learner.batch(self._words),
            tools=learner.batch(np.stack(self._past.before(observation.step))),
            pictures=learner.batch(looked_at(recipe.eyes, observation.images)),
        )
        return learner.chunk(shown, _noise_seed(self._episode, observation.step))

    def check(self, *, space: str, observation: ObservationSpec, rate_hz: float) -> None:
        """Raise InvalidInputError if a run renders other images than those on which the learner was trained."""
        del space, rate_hz
        wanted = self._learner.trained.recipe.eyes.observation
        if observation.name != wanted:
            problem = f"it was trained on the images of {wanted!r}, but the run uses {observation.name!r}"
            raise InvalidInputError(f"policy {self.info.name}", problem, f"Use --observation {wanted}")


class _Past(Generic[SeenT]):
    """Inputs from earlier steps, for a learner whose recipe contains a history."""

    def __init__(self, recipe: TrainingRecipe) -> None:
        self._stride, self._history = recipe.history_stride, recipe.history
        self._seen: OrderedDict[int, SeenT] = OrderedDict()

    def keep(self, step: int, seen: SeenT) -> None:
        """Store the input of a step, and drop inputs that are no longer needed."""
        self._seen[step] = seen
        while next(iter(self._seen)) < step - self._stride * (self._history - 1):
            self._seen.popitem(last=False)

    def before(self, step: int) -> list[SeenT]:
        """Return the inputs of a step and of the earlier steps that belong to the history.

        Before the first step, the input of the first step is repeated.
        """
        wanted = (max(step - k * self._stride, next(iter(self._seen))) for k in range(self._history))
        return [self._seen[max(s for s in self._seen if s <= asked)] for asked in wanted]


def _noise_seed(episode: int, step: int) -> int:
    return int.from_bytes(hashlib.sha256(f"betterbench flow {episode} {step}".encode()).digest()[:8], "big")
