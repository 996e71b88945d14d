"""Addresses of learned policies: ``learned:CHECKPOINT`` or ``learned:CHECKPOINT?execute=4``."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.installation import missing_extra
from betterbench.interface import PolicyInfo, episode_number
from betterbench.interface.state import PrivilegedPolicy
from betterbench.json_form import open_ordinary, parse_json
from betterbench.policies.learned.families import learner_family

if TYPE_CHECKING:
    from betterbench.policies.learned.policy import Learner, SeeingPolicy

PREFIX = "learned:"
_OPTIONS = ("execute",)
FILE_NAME = "checkpoint.safetensors"
_MOST_HEADER = 1 << 24


def is_learned(address: str) -> bool:
    """Return whether an address names a checkpoint of ``better train``."""
    return address.startswith(PREFIX)


def is_seeing(address: str) -> bool:
    """Return whether an address names a learner that sees observations, as those of the family ``pixels`` do.

    False also for a checkpoint that is missing, damaged or of an unknown family, which is refused where it is asked for
    what it is.
    """
    if not is_learned(address):
        return False
    path = checkpoint_of(address)
    try:
        found = path.stat()
    except OSError:
        return False
    family = _family(path.absolute(), found.st_mtime_ns, found.st_size)
    try:
        return family is not None and learner_family(family).sees == "pixels"
    except UnknownNameError:
        return False


def learned_info(address: str) -> PolicyInfo:
    """Return what a learned policy says about itself.

    Raises:
        MissingDependencyError: If torch or safetensors is not installed.
        InvalidInputError: If the checkpoint is missing or damaged, or an option is out of range.
        UnknownNameError: If there is no such option.
    """
    parsed = _Address.parse(address)
    learner = _learner(parsed.path)
    return learner.info(address, execute=parsed.executed(learner))


def make_learned(address: str, instruction: str, seed: int) -> PrivilegedPolicy:
    """Return a learned policy for one episode, of a trial's instruction and seed; raises as :func:`learned_info`."""
    parsed = _Address.parse(address)
    learner = _learner(parsed.path)
    from betterbench.policies.learned.policy import LearnedPolicy  # noqa: PLC0415 - needs torch

    return LearnedPolicy(address, learner, instruction, episode_number(seed), execute=parsed.executed(learner))


def make_seeing(address: str) -> SeeingPolicy:
    """Return a learned policy that sees observations; raises as :func:`learned_info`."""
    parsed = _Address.parse(address)
    learner = _learner(parsed.path)
    from betterbench.policies.learned.policy import SeeingPolicy  # noqa: PLC0415 - needs torch

    return SeeingPolicy(address, learner, execute=parsed.executed(learner))


@dataclass(frozen=True, slots=True)
class _Address:
    """A checkpoint's file, and how many actions of a chunk are executed; None for as many as its recipe says."""

    text: str
    path: Path
    execute: str | None

    @classmethod
    def parse(cls, address: str) -> _Address:
        target, _, query = address.removeprefix(PREFIX).partition("?")
        if not target:
            raise InvalidInputError(f"policy {address}", "nothing follows the colon", f"Write {PREFIX}CHECKPOINT")
        options = dict(parse_qsl(query, keep_blank_values=True))
        for name in options:
            if name not in _OPTIONS:
                raise UnknownNameError("option of learned", name, _OPTIONS)
        return cls(address, checkpoint_of(address), options.get("execute"))

    def executed(self, learner: Learner) -> int:
        """Return how many actions of a chunk are executed; InvalidInputError if the chunk has no such number."""
        recipe = learner.trained.recipe
        if self.execute is None:
            return recipe.execute
        if not self.execute.isdecimal() or not 1 <= int(self.execute[:9]) <= recipe.chunk:
            problem = f"execute={self.execute} is no number of actions of its chunk"
            raise InvalidInputError(f"policy {self.text}", problem, f"Give 1 to {recipe.chunk}")
        return int(self.execute)


def checkpoint_of(address: str) -> Path:
    """Return the file that an address names, or the one in the folder that it names."""
    path = Path(address.removeprefix(PREFIX).partition("?")[0])
    try:
        path = path.expanduser()
    except RuntimeError as error:
        raise InvalidInputError(f"policy {address}", "there is no such home folder", "Write its path") from error
    return path / FILE_NAME if path.is_dir() else path


@functools.lru_cache(maxsize=64)
def _family(path: Path, changed_ns: int, size: int) -> str | None:
    """Return the family that the header of a checkpoint names, without torch; None if it says nothing."""
    del changed_ns  # part of the key
    try:
        with open_ordinary(path) as file:
            length = int.from_bytes(file.read(8), "little")
            if length > min(size, _MOST_HEADER):
                return None
            about = parse_json(parse_json(file.read(length))["__metadata__"]["betterbench"])
        return str(about["recipe"]["family"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def load_learner(address: str) -> Learner:
    """Return the learner that an address names, to be asked; raises as :func:`learned_info`."""
    return _learner(_Address.parse(address).path)


def _learner(path: Path) -> Learner:
    """Return the learner of a checkpoint, which is read once in this process unless its file changes."""
    require_torch("learned:")
    try:
        found = path.stat()
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise InvalidInputError(str(path), problem, "Name the folder that better train wrote") from error
    return _loaded(path.absolute(), found.st_mtime_ns, found.st_size)


@functools.lru_cache(maxsize=4)
def _loaded(path: Path, changed_ns: int, size: int) -> Learner:
    del changed_ns, size  # parts of the key
    from betterbench.policies.learned.policy import Learner  # noqa: PLC0415 - needs torch

    return Learner.load(path)


def require_torch(what: str) -> None:
    """Raise MissingDependencyError if torch or safetensors is not installed."""
    try:
        import safetensors.torch  # noqa: F401, PLC0415
        import torch  # noqa: F401, PLC0415
    except ImportError as error:
        raise missing_extra(
            f"{what} needs torch and safetensors, which are not installed ({error})", "train"
        ) from error
