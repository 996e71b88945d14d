"""Networks of learners: the base class, the transformer of the built-in families, and the network of ``objects``."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from betterbench.errors import InvalidInputError
from betterbench.policies.learned.recipe import TrainingRecipe
from betterbench.policies.learned.tokens import POSE_NUMBERS, TOOL_NUMBERS
from betterbench.policies.learned.vocabulary import ABSENT, MOST_WORDS, Vocabulary
from betterbench.tasks.user_files import explaining

ACTION_NUMBERS = 7
NEAR_M, TOUCHING_M = 0.1, 0.02
"""Lengths by which positions relative to the tool are divided before they are passed to the network [m]."""
WAVES_M = (0.4, 0.1)
"""Wavelengths of sine and cosine features of the positions of objects relative to the tool [m].

They are short enough to resolve millimeters.
"""
_AWAY_NUMBERS = 6 + 6 * len(WAVES_M)
_TIME_NUMBERS = 32
_LONGEST_PERIOD = 100.0


_Memory = tuple[Tensor, Tensor]
"""Keys and values that one layer computes for its tokens."""


@dataclass(slots=True, kw_only=True)
class ShownBatch:
    """Inputs for a batch of B samples that all families of learners have in common.

    Attributes:
        words: (B, w) int64 indices of the words of each instruction, with w at most MOST_WORDS.
        tools: (B, history, 10) float32 states of the tool, starting with the present state.
        blind: (B,) bool, True for samples from which the tool states are removed. None if they are never removed.
    """

    words: Tensor
    tools: Tensor
    blind: Tensor | None = None


@dataclass(slots=True, kw_only=True)
class ObjectsBatch(ShownBatch):
    """Inputs for a batch of learners in the ``objects`` family, with at most n objects per sample.

    Attributes:
        poses: (B, n, 9) float32 poses of the objects.
        sizes: (B, n, 3) float32 extents of the objects.
        categories: (B, n) int64 indices of the categories, or :data:`ABSENT` where there is no object.
        colors: (B, n) int64 indices of the colors.
    """

    poses: Tensor
    sizes: Tensor
    categories: Tensor
    colors: Tensor


@dataclass(frozen=True, slots=True)
class AskedBatch:
    """Batch of questions with the correct answers.

    Attributes:
        shown: Inputs of the batch. The words of the question take the place of the instruction.
        answers: (B,) int64 indices of the correct answers.
    """

    shown: ShownBatch
    answers: Tensor


@dataclass(frozen=True, slots=True)
class Heard:
    """Encodings of the U distinct instructions in a batch. They stay the same during an episode.

    Attributes:
        words: (U, w, width) tokens of the words.
        told: (U, w) bool, True for words and False for padding.
        which: (B,) index of the distinct instruction that each sample has.
        memories: Keys and values of the words in each layer, each (U, heads, w, head width).
    """

    words: Tensor
    told: Tensor
    which: Tensor
    memories: tuple[_Memory, ...]


class _Block(nn.Module):
    """Pre-norm transformer layer: layer normalization is applied before the attention and before the MLP."""

    def __init__(self, width: int, heads: int, dropout: float) -> None:
        super().__init__()
        self.heads, self.dropout = heads, dropout
        self.before_attention, self.before_maps = nn.LayerNorm(width), nn.LayerNorm(width)
        self.queries_keys_values = nn.Linear(width, 3 * width)
        self.joined = nn.Linear(width, width)
        self.maps = nn.Sequential(nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width))

    def forward(self, tokens: Tensor, seen: Tensor, before: _Memory | None = None) -> tuple[Tensor, _Memory]:
        """Return the tokens after this layer, and the keys and values to which other tokens may attend.

        Args:
            tokens: (B, n, width) tokens before this layer.
            seen: (B, 1, 1, m + n) bool attention mask, True for tokens that may be attended to.
            before: Keys and values of m preceding tokens, each (B, heads, m, head width), or None.
        """
        batch, length, width = tokens.shape
        parts = self.queries_keys_values(self.before_attention(tokens))
        parts = parts.view(batch, length, 3, self.heads, width // self.heads).permute(2, 0, 3, 1, 4)
        own = (parts[1], parts[2])
        keys, values = own if before is None else (torch.cat(pair, dim=2) for pair in zip(before, own, strict=True))
        mixed = functional.scaled_dot_product_attention(parts[0], keys, values, attn_mask=seen)
        tokens = tokens + self._dropped(self.joined(mixed.transpose(1, 2).reshape(batch, length, width)))
        return tokens + self._dropped(self.maps(self.before_maps(tokens))), own

    def _dropped(self, values: Tensor) -> Tensor:
        return functional.dropout(values, self.dropout, training=self.training) if self.dropout else values


_SCALES = {"tool": TOOL_NUMBERS, "position": 3, "action": ACTION_NUMBERS}
_TAKEN = frozenset({"head", "answers", "recipe", "options", "chunk", "training"})


class LearnerNetwork(nn.Module):
    """Base class of learners' networks, which map a batch of inputs to chunks of normalized actions, (B, chunk, 7).

    A family creates its modules in :meth:`build` and computes one vector per sample from the inputs in :meth:`summary`.
    The head that maps this vector to actions, the losses, and the answers to questions are the same for all families.

    Attributes:
        recipe: Training recipe. ``recipe.size`` is the size of the transformer.
        options: Options of the family.
        tool_mean, tool_scale: (10,) mean and scale of the tool state in the training data. There are similar buffers
            for actions, (7,), and for the inputs that are passed to :meth:`keep_scale`.
    """

    tool_mean: Tensor
    tool_scale: Tensor
    action_mean: Tensor
    action_scale: Tensor

    def __init__(self, recipe: TrainingRecipe, vocabulary: Vocabulary) -> None:
        super().__init__()
        self.recipe, self.chunk, self.options = recipe, recipe.chunk, recipe.all_options
        self.build(vocabulary)
        taken = sorted(_TAKEN & self._modules.keys())
        if taken:
            problem = f"the module name {taken[0]!r} is reserved, because every learner has it"
            raise InvalidInputError(f"learner {recipe.family!r}", problem, "Choose another name")
        width = recipe.size.width
        numbers = recipe.chunk * ACTION_NUMBERS
        extra = numbers + _TIME_NUMBERS if recipe.loss == "flow" else 0
        self.head = nn.Sequential(
            nn.Linear(width + extra, 2 * width), nn.GELU(), nn.Linear(2 * width, 2 * width), nn.GELU(),
            nn.Linear(2 * width, numbers),
        )  # fmt: skip
        if vocabulary.answers:
            self.answers = nn.Linear(width, len(vocabulary.answers))
        self.keep_scale("tool", TOOL_NUMBERS)
        self.keep_scale("action", ACTION_NUMBERS)

    def build(self, vocabulary: Vocabulary) -> None:
        """Create the modules of the family. The initial weights are drawn from torch's global random generator."""
        raise NotImplementedError(f"{type(self).__name__} must implement build")

    def summary(self, shown: ShownBatch, heard: Any = None) -> Tensor:  # noqa: ANN401 - result of hear
        """Return one vector per sample as a (B, width) tensor.

        Args:
            shown: Inputs of the batch.
            heard: Result of :meth:`hear` for the words of the batch, or None if it has not been computed.
        """
        raise NotImplementedError(f"{type(self).__name__} must implement summary")

    def hear(self, words: Tensor) -> Any:  # noqa: ANN401 - depends on the family
        """Return an encoding of the instructions ``words``, (B, w) int64, which can be cached during an episode.

        The encoding is passed to every call of :meth:`answer` in the episode. If the result is None, nothing is cached.
        """
        del words

    def parts(self) -> dict[str, list[nn.Parameter]]:
        """Return the parameters of each part of the network that recipes can freeze.

        By default, each module is a part.
        """
        found: dict[str, list[nn.Parameter]] = {}
        for name, parameter in self.named_parameters():
            first = name.partition(".")[0]
            found.setdefault("head" if first == "answers" else first, []).append(parameter)
        return found

    def keep_scale(self, name: str, count: int) -> None:
        """Store the mean and scale that an input has in the training data as buffers of the network.

        ``name`` is ``tool`` (10 numbers), ``position`` for the positions of objects (3 numbers), or ``action`` (7
        numbers). The buffers for ``tool`` and ``action`` always exist. Raises InvalidInputError for any other name or
        count.
        """
        if _SCALES.get(name) != count:
            known = ", ".join(f'("{key}", {value})' for key, value in _SCALES.items())
            problem = f"the training data have no scale {name!r} of {count} numbers"
            raise InvalidInputError(f"learner {self.recipe.family!r}", problem, f"Choose one of {known}")
        self.register_buffer(f"{name}_mean", torch.zeros(count))
        self.register_buffer(f"{name}_scale", torch.ones(count))

    def _gathered(self, shown: ShownBatch, heard: Any = None) -> Tensor:  # noqa: ANN401
        """Call :meth:`summary` and check its result.

        Raises InvalidInputError if a learner defined by a user fails or returns a wrong shape or type.
        """
        with explaining("family", self.recipe.family):
            found = self.summary(shown, heard)
        wanted = (len(shown.words), self.recipe.size.width)
        if not isinstance(found, Tensor) or found.shape != wanted:
            given = tuple(found.shape) if isinstance(found, Tensor) else type(found).__name__
            problem = f"its summary returns {given}, expected (batch, width) = {wanted}"
            raise InvalidInputError(f"learner {self.recipe.family!r}", problem, "Correct the method summary")
        if found.dtype != self.action_mean.dtype:
            problem = f"its summary returns {found.dtype}, expected {self.action_mean.dtype}"
            raise InvalidInputError(f"learner {self.recipe.family!r}", problem, "Convert the result")
        return found

    def act(self, shown: ShownBatch, noise: Tensor | None = None, heard: Any = None) -> Tensor:  # noqa: ANN401
        """Call :meth:`answer` and check its result.

        Raises InvalidInputError if a learner defined by a user fails or returns a wrong shape.
        """
        with explaining("family", self.recipe.family):
            found = self.answer(shown, noise, heard)
        wanted = (len(shown.words), self.chunk, ACTION_NUMBERS)
        if not isinstance(found, Tensor) or found.shape != wanted:
            given = tuple(found.shape) if isinstance(found, Tensor) else type(found).__name__
            problem = f"its answer returns {given}, expected (batch, chunk, 7) = {wanted}"
            raise InvalidInputError(f"learner {self.recipe.family!r}", problem, "Correct the method answer")
        return found

    def loss(self, shown: ShownBatch, actions: Tensor, counted: Tensor) -> Tensor:
        """Return the mean loss of a batch.

        Args:
            shown: Inputs of the batch.
            actions: (B, chunk, 7) actions of the demonstrations.
            counted: (B, chunk) bool, True for actions of the demonstration and False after its end.
        """
        wanted = (actions - self.action_mean) / self.action_scale
        summary = self._gathered(shown)
        if self.recipe.loss == "flow":
            # The times are drawn from Beta(1.5, 1) as in GR00T N1, so most samples are close to pure noise.
            times = 0.999 * (1.0 - torch.rand(len(actions), device=actions.device) ** (1.0 / 1.5))
            noise = torch.randn_like(wanted)
            between = (1.0 - times[:, None, None]) * noise + times[:, None, None] * wanted
            error = (self._velocity(summary, between, times) - (wanted - noise)).square()
        else:
            error = (self.head(summary).view_as(wanted) - wanted).abs()
        weights = counted[:, :, None].to(error.dtype)
        return (error * weights).sum() / (weights.sum() * ACTION_NUMBERS)

    def reply(self, shown: ShownBatch) -> Tensor:
        """Return the logits of the answers to the questions in a batch as a (B, answers) tensor."""
        found: Tensor = self.answers(self._gathered(shown))
        return found

    def forward(self, shown: ShownBatch, actions: Tensor, counted: Tensor, asked: AskedBatch | None = None) -> Tensor:
        """Return the loss of a training step.

        The loss is computed in ``forward``, because DistributedDataParallel synchronizes gradients only for calls of
        this method. The loss of a question is the cross-entropy. Each question has the same weight as a frame with
        actions.
        """
        loss = self.loss(shown, actions, counted)
        if asked is None:
            return loss
        share = len(asked.answers) / len(actions)
        return loss + share * functional.cross_entropy(self.reply(asked.shown), asked.answers)

    def answer(self, shown: ShownBatch, noise: Tensor | None = None, heard: Any = None) -> Tensor:  # noqa: ANN401
        """Return chunks of actions, (B, chunk, 7).

        Args:
            shown: Inputs of the batch.
            noise: (B, chunk, 7) noise from which a flow-matching learner generates actions.
            heard: Result of :meth:`hear` for the words of the batch, or None if it has not been computed.
        """
        summary = self._gathered(shown, heard)
        if self.recipe.loss == "flow":
            if noise is None:
                raise ValueError("a flow-matching learner needs noise")
            found, count = noise, self.recipe.flow_steps
            for step in range(count):
                times = torch.full((len(noise),), step / count, device=noise.device)
                found = found + self._velocity(summary, found, times) / count
        else:
            found = self.head(summary).view(len(summary), self.chunk, ACTION_NUMBERS)
        return found * self.action_scale + self.action_mean

    def _velocity(self, summary: Tensor, between: Tensor, times: Tensor) -> Tensor:
        rates = torch.arange(_TIME_NUMBERS // 2, device=times.device) * (2.0 * math.log(_LONGEST_PERIOD))
        angles = times[:, None] * torch.exp(rates / _TIME_NUMBERS)
        numbers = torch.cat([summary, between.flatten(1), angles.sin(), angles.cos()], dim=1)
        velocity: Tensor = self.head(numbers).view_as(between)
        return velocity


class TokenNetwork(LearnerNetwork):
    """Transformer whose tokens represent the words, the tool states, and the further inputs of a family.

    The built-in families differ only in the encoder that converts their inputs to tokens. A recipe can freeze the
    modules that :meth:`open_eyes` creates by name.
    """

    state: nn.ModuleDict

    def build(self, vocabulary: Vocabulary) -> None:
        """Create the embeddings, the input encoders and the layers."""
        recipe, size, words = self.recipe, self.recipe.size, vocabulary.sizes()[0]
        width = size.width
        self.given = recipe.proprioception.given
        self.words = nn.ModuleDict({"which": nn.Embedding(words, width), "where": nn.Embedding(MOST_WORDS, width)})
        self.open_eyes(width, vocabulary)
        # Modules that would not be used are not created, because they would not get a gradient.
        if self.given:
            self.state = nn.ModuleDict(
                {"tool": nn.Linear(TOOL_NUMBERS, width), "when": nn.Embedding(recipe.history, width)}
            )
        if self.given and recipe.proprioception.dropout:
            self.missing = nn.Parameter(torch.zeros(width))
        self.readout = nn.Parameter(torch.zeros(width))
        for module in self.modules():
            if isinstance(module, nn.Embedding):
                nn.init.normal_(module.weight, std=0.1)
        self.trunk = nn.ModuleList(_Block(width, size.heads, recipe.dropout) for _ in range(size.layers))
        self.last = nn.LayerNorm(width)

    @abstractmethod
    def open_eyes(self, width: int, vocabulary: Vocabulary) -> None:
        """Create the input encoder of this family, and the buffers for the scales that it needs."""

    @abstractmethod
    def see(self, shown: ShownBatch, words: Tensor, told: Tensor, which: Tensor) -> tuple[Tensor, Tensor]:
        """Return tokens for the inputs of the family, (B, n, width), and a mask (B, n) that is True for real tokens.

        Args:
            shown: Inputs of the batch.
            words: (U, w, width) tokens of the distinct instructions.
            told: (U, w) bool, True for words and False for padding.
            which: (B,) index of the distinct instruction that each sample has.
        """

    def parts(self) -> dict[str, list[nn.Parameter]]:
        """Return the parameters of each part of the network that recipes can freeze."""
        found: dict[str, list[nn.Parameter]] = {"words": [], "state": [], "trunk": [], "head": []}
        home = {"missing": "state", "readout": "trunk", "last": "trunk", "answers": "head"}
        for name, parameter in self.named_parameters():
            first = name.partition(".")[0]
            found.setdefault(home.get(first, first), []).append(parameter)
        return found

    def hear(self, words: Tensor) -> Heard:
        """Return an encoding of the instructions ``words``, (B, w) int64, for all calls of :meth:`answer`."""
        tokens, told, which = self._instructions(words)
        memories, seen = [], told[:, None, None, :]
        heard = tokens
        for block in self.trunk:
            heard, memory = block(heard, seen)
            memories.append(memory)
        return Heard(tokens, told, which, tuple(memories))

    def summary(self, shown: ShownBatch, heard: Heard | None = None) -> Tensor:
        """Return the output of the readout token as a (B, width) tensor."""
        batch = shown.words.shape[0]
        words, told, which = (
            self._instructions(shown.words) if heard is None else (heard.words, heard.told, heard.which)
        )
        things, there = self.see(shown, words, told, which)
        parts = [self.readout.expand(batch, 1, -1), things]
        seen = [told[which], told.new_ones(batch, 1), there]
        if self.given:
            state = self.state["tool"]((shown.tools - self.tool_mean) / self.tool_scale)
            if shown.blind is not None:
                state = torch.where(shown.blind[:, None, None], self.missing, state)
            parts.append(state + self.state["when"].weight)
            seen.append(told.new_ones(batch, shown.tools.shape[1]))
        tokens, mask = torch.cat(parts, dim=1), torch.cat(seen, dim=1)[:, None, None, :]
        for layer, block in enumerate(self.trunk):
            if heard is None:
                words, (keys, values) = block(words, told[:, None, None, :])
            else:
                keys, values = heard.memories[layer]
            tokens, _ = block(tokens, mask, (keys[which], values[which]))
        gathered: Tensor = self.last(tokens[:, 0])
        return gathered

    def _instructions(self, words: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the tokens of the distinct instructions in a batch, a mask of their words, and an index per sample.

        The index of a sample is the position of its instruction among the distinct instructions. Words attend only to
        words, so each distinct instruction is encoded only once for all samples.
        """
        different, which = torch.unique(words, dim=0, return_inverse=True)
        places = torch.arange(words.shape[1], device=words.device)
        tokens = self.words["which"](different) + self.words["where"](places)
        return tokens, different != ABSENT, which


class ObjectsNetwork(TokenNetwork):
    """Network of the ``objects`` family, with one token per object.

    Objects have no position encoding, so their order does not matter.
    """

    position_mean: Tensor
    position_scale: Tensor

    def open_eyes(self, width: int, vocabulary: Vocabulary) -> None:
        """Create the encoder of objects."""
        _, categories, colors = vocabulary.sizes()
        self.objects = nn.ModuleDict(
            {
                "category": nn.Embedding(categories, width),
                "color": nn.Embedding(colors, width),
                "pose": nn.Linear(POSE_NUMBERS + 3 + (_AWAY_NUMBERS if self.given else 0), width),
            }
        )
        self.keep_scale("position", 3)

    def see(self, shown: ShownBatch, words: Tensor, told: Tensor, which: Tensor) -> tuple[Tensor, Tensor]:
        """Return one token per object, and a mask that is True for objects that exist."""
        del words, told, which
        if not isinstance(shown, ObjectsBatch):
            raise TypeError("ObjectsNetwork needs an ObjectsBatch")
        objects = self.objects["category"](shown.categories) + self.objects["color"](shown.colors)
        return objects + self.objects["pose"](self._object_numbers(shown)), shown.categories != ABSENT

    def _object_numbers(self, shown: ObjectsBatch) -> Tensor:
        """Return the pose and size of each object. If tool states are given, add the position relative to the tool."""
        positions = (shown.poses[..., :3] - self.position_mean) / self.position_scale
        numbers = [positions, shown.poses[..., 3:], shown.sizes / NEAR_M]
        if self.given:
            away = shown.poses[..., :3] - shown.tools[:, :1, :3]
            if shown.blind is not None:
                away = torch.where(shown.blind[:, None, None], torch.zeros_like(away), away)
            numbers += [away / NEAR_M, torch.tanh(away / TOUCHING_M)]
            for length in WAVES_M:
                angles = away * (2.0 * math.pi / length)
                numbers += [angles.sin(), angles.cos()]
        return torch.cat(numbers, dim=-1)
