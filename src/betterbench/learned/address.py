"""Addresses of learned policies: ``learned:CHECKPOINT`` or ``learned:CHECKPOINT?execute=4``."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl

from betterbench.errors import InvalidInputError, MissingDependencyError, UnknownNameError
from betterbench.interface import PolicyInfo, episode_number
from betterbench.state import PrivilegedPolicy

if TYPE_CHECKING:
    from betterbench.learned.policy import Learner

PREFIX = "learned:"
_OPTIONS = ("execute",)
_FILE_NAME = "checkpoint.safetensors"


def is_learned(address: str) -> bool:
    """Return whether an address names a checkpoint of ``better train``."""
    return address.startswith(PREFIX)


def learned_info(address: str) -> PolicyInfo:
    """Return what a learned policy says about itself.

    Raises:
        MissingDependencyError: If torch or safetensors is not installed.
        InvalidInputError: If the checkpoint is missing or damaged, or an option is out of range.
        UnknownNameError: If there is no such option.
    """
    parsed = _Address.parse(address)
    learner = _learner(parsed.path)
    parsed.executed(learner)
    return learner.info(address)


def make_learned(address: str, instruction: str, seed: int) -> PrivilegedPolicy:
    """Return a learned policy for one episode, of a trial's instruction and seed; raises as :func:`learned_info`."""
    parsed = _Address.parse(address)
    learner = _learner(parsed.path)
    from betterbench.learned.policy import LearnedPolicy  # noqa: PLC0415 - needs torch

    return LearnedPolicy(address, learner, instruction, episode_number(seed), execute=parsed.executed(learner))


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
        path = Path(target).expanduser()
        return cls(address, path / _FILE_NAME if path.is_dir() else path, options.get("execute"))

    def executed(self, learner: Learner) -> int:
        """Return how many actions of a chunk are executed; InvalidInputError if the chunk has no such number."""
        recipe = learner.trained.recipe
        if self.execute is None:
            return recipe.execute
        if not self.execute.isdecimal() or not 1 <= int(self.execute[:9]) <= recipe.chunk:
            problem = f"execute={self.execute} is no number of actions of its chunk"
            raise InvalidInputError(f"policy {self.text}", problem, f"Give 1 to {recipe.chunk}")
        return int(self.execute)


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
    from betterbench.learned.policy import Learner  # noqa: PLC0415 - needs torch

    return Learner.load(path)


def require_torch(what: str) -> None:
    """Raise MissingDependencyError if torch or safetensors is not installed."""
    try:
        import safetensors.torch  # noqa: F401, PLC0415
        import torch  # noqa: F401, PLC0415
    except ImportError as error:
        raise MissingDependencyError(
            f"{what} needs torch and safetensors, which are not installed ({error}). "
            "Run pip install 'betterbench[train]'."
        ) from error
