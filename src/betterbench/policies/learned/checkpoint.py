"""Checkpoints of learners: safetensors files whose header contains the recipe, the vocabulary and a digest."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import safetensors.torch
import torch
from pydantic import TypeAdapter
from safetensors import SafetensorError
from torch import Tensor

from betterbench.errors import InvalidInputError
from betterbench.jobs.durable import on_disk, write_durably
from betterbench.json_form import parse_json, read_bounded, read_form, say_unsealed, seal_of
from betterbench.policies.learned.network import LearnerNetwork
from betterbench.policies.learned.networks import new_network
from betterbench.policies.learned.recipe import TrainingRecipe, read_training_recipe
from betterbench.policies.learned.vocabulary import Vocabulary
from betterbench.tasks.user_files import COPIES, code_of

FILE_NAME = "checkpoint.safetensors"
ACTION_SPACE = "ee_delta"
"""Action space in which a learner returns its actions."""
_KEY = "betterbench"
_MAX_BYTES = 1 << 30
_CURE = "Use a checkpoint.safetensors written by better train, or train again"
_VOCABULARY = TypeAdapter(Vocabulary)


@dataclass(frozen=True, slots=True)
class Trained:
    """Metadata of a learner's checkpoint.

    Attributes:
        recipe: Training recipe.
        vocabulary: Words, categories and colors that the learner knows.
        step: Number of training steps so far.
        data: SHA-256 of all records that were used as training data.
        action_space: Action space in which the learner returns actions.
        code: Hash or name that identifies the code of the learner's family, from
            :func:`~betterbench.tasks.user_files.code_of`. None for a built-in family.
    """

    recipe: TrainingRecipe
    vocabulary: Vocabulary
    step: int
    data: str
    action_space: str = ACTION_SPACE
    code: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the metadata as a JSON-serializable dict. ``code`` is left out for a built-in family."""
        form = {**asdict(self), "recipe": self.recipe.to_json(), "vocabulary": self.vocabulary.to_json()}
        if self.code is None:
            del form["code"]
        return form


def write_tensors(path: Path, tensors: Mapping[str, Tensor], about: Mapping[str, Any]) -> None:
    """Write tensors and metadata to a file and flush it to the disk. Equal arguments give equal bytes.

    Raises StorageError if the disk is full. In this case, an existing file is kept.
    """
    held = {name: tensor.detach().cpu().contiguous() for name, tensor in sorted(tensors.items())}
    # There is a single metadata entry, because the order of several entries would differ between processes.
    text = json.dumps({**about, "sha256": _seal(about, _digest(held))}, sort_keys=True)
    with on_disk(path):
        write_durably(path, safetensors.torch.save(held, metadata={_KEY: text}))


def read_tensors(path: Path, *, cure: str = _CURE) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Return the tensors and metadata of a file. Raises InvalidInputError if any byte of the file has changed.

    In files of earlier versions, the digest covers only the tensors. A warning reports this once.
    """
    data = read_bounded(path, max_bytes=_MAX_BYTES, cure=cure)
    try:
        tensors = safetensors.torch.load(data)
        length = int.from_bytes(data[:8], "little")
        about = parse_json(parse_json(data[8 : 8 + length], unique=True)["__metadata__"][_KEY], unique=True)
        told = about.pop("sha256")
        weights = _digest(tensors)
        expected = _seal(about, weights)
    except (SafetensorError, InvalidInputError, ValueError, KeyError, TypeError, AttributeError) as error:
        problem = f"this is not a checkpoint of betterbench, or the file is damaged ({type(error).__name__})"
        raise InvalidInputError(str(path), problem, cure) from error
    if told == weights:
        say_unsealed(str(path))
    elif told != expected:
        problem = "the file is damaged: its weights or metadata have changed since they were written"
        raise InvalidInputError(str(path), problem, cure)
    return tensors, about


def write_checkpoint(path: Path, weights: Mapping[str, Tensor], trained: Trained) -> None:
    """Write the weights and the metadata of a learner to a file. See :func:`write_tensors`."""
    write_tensors(path, weights, trained.to_json())


def read_checkpoint(path: Path) -> tuple[LearnerNetwork, Trained]:
    """Load a checkpoint. Return its network, in evaluation mode, and its metadata.

    Raises InvalidInputError if the file is missing or damaged, or if the weights do not match the recipe.
    """
    weights, about = read_tensors(path)
    require_code(about, str(path))
    trained = _trained(about, str(path))
    if trained.action_space != ACTION_SPACE:
        problem = f"its action space is {trained.action_space!r}"
        raise InvalidInputError(str(path), problem, f"Train the learner with the action space {ACTION_SPACE}")
    if trained.recipe.built_in:
        _require_possible(trained, weights, str(path))
    with torch.random.fork_rng(devices=[]):
        network = new_network(trained.recipe, trained.vocabulary)
    load_weights(network, weights, str(path))
    # Only parameters are checked here, because buffers of a user's network, such as an attention mask, may be infinite.
    finite = weights if trained.recipe.built_in else dict(network.named_parameters())
    broken = next((name for name, tensor in finite.items() if not bool(tensor.isfinite().all())), None)
    if broken is not None:
        raise InvalidInputError(str(path), f"the weights of the checkpoint are not finite ({broken})", _CURE)
    return network.eval(), trained


def checkpoint_file(place: str) -> Path:
    """Return the path of the initial checkpoint in a training recipe, which may name a file or a folder.

    Raises InvalidInputError if there is no checkpoint at that place.
    """
    path = Path(place) / FILE_NAME if Path(place).is_dir() else Path(place)
    if not path.is_file():
        raise InvalidInputError(
            f"start: {place}", "this place contains no checkpoint", "Use a folder written by better train"
        )
    return path


def read_vocabulary(path: Path) -> Vocabulary:
    """Return the vocabulary of a checkpoint. Raises InvalidInputError if the file is damaged."""
    _, about = read_tensors(path)
    return _trained(about, str(path)).vocabulary


def load_weights(network: LearnerNetwork, weights: Mapping[str, Tensor], where: str) -> None:
    """Load weights into a network. Raises InvalidInputError if they do not match the network."""
    _require_fit(network, weights, where)
    network.load_state_dict(dict(weights))


def _require_possible(trained: Trained, weights: Mapping[str, Tensor], where: str) -> None:
    """Check, before the network is created, that the file contains as many weights as its metadata require.

    A transformer layer has 12 matrices of size width x width (queries, keys, values, their output map, and two maps of
    size 4 width x width). Each word of the vocabulary has one row of length width. Raises InvalidInputError if there
    are too few weights.
    """
    size, there = trained.recipe.size, sum(tensor.numel() for tensor in weights.values())
    claimed = 12 * size.layers * size.width**2 + len(trained.vocabulary.words) * size.width
    if claimed > there:
        problem = f"its weights do not match its recipe ({there:,} numbers, but the recipe needs {claimed:,})"
        raise InvalidInputError(where, problem, _CURE)


def _require_fit(network: LearnerNetwork, weights: Mapping[str, Tensor], where: str) -> None:
    there, wanted = ({n: tuple(t.shape) for n, t in w.items()} for w in (weights, network.state_dict()))
    if there != wanted:
        names = sorted(n for n in there.keys() | wanted.keys() if there.get(n) != wanted.get(n))
        problem = f"its weights do not match its recipe ({names[0]} differs)"
        raise InvalidInputError(where, problem, "Use the recipe and the data with which the learner was trained")


def _trained(about: Mapping[str, Any], where: str) -> Trained:
    try:
        recipe = read_training_recipe(about["recipe"], where=f"{where}: recipe")
        vocabulary = read_form(_VOCABULARY, about["vocabulary"], where=f"{where}: vocabulary", cure=_CURE)
        step, data, space = about["step"], about["data"], about["action_space"]
    except KeyError as error:
        raise InvalidInputError(where, f"the header of the checkpoint lacks {error}", _CURE) from error
    if type(step) is not int or step < 0:
        raise InvalidInputError(
            where, f"the header of the checkpoint has {step!r} as the number of training steps", _CURE
        )
    code = about.get("code")
    return Trained(recipe, vocabulary, step, str(data), str(space), None if code is None else str(code))


def require_code(about: Mapping[str, Any], where: str) -> None:
    """Raise an error if the code of a learner's family has changed since the learner was trained.

    A family whose name is unknown is rejected later, when the recipe is read.
    """
    recipe, code = about.get("recipe"), about.get("code")
    family = str(recipe.get("family")) if isinstance(recipe, dict) else ""
    here = code_of("family", family)
    if here is not None and here != code:
        problem = f"its family {family!r} was defined by {code or 'an unknown file'}, but is now defined by {here}"
        cure = f"Pass the file used in training. better train keeps a copy in {COPIES} next to the checkpoint"
        raise InvalidInputError(where, problem, cure)


def _seal(about: Mapping[str, Any], weights: str) -> str:
    """Return the digest of a file, computed from the metadata and the digest of the tensors."""
    return seal_of({"about": seal_of(about), "tensors": weights})


def _digest(tensors: Mapping[str, Tensor]) -> str:
    """Return the SHA-256 of the names, types, shapes and bytes of tensors."""
    whole = hashlib.sha256()
    for name, tensor in sorted(tensors.items()):
        whole.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}\n".encode())
        whole.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes() if tensor.numel() else b"")
    return whole.hexdigest()
