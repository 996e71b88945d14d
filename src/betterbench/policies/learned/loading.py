"""Loading of learned policies from the checkpoint in a policy address (``learned:CHECKPOINT?execute=4``)."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.installation import missing_extra
from betterbench.interface import PolicyInfo, episode_number
from betterbench.interface.state import PrivilegedPolicy
from betterbench.json_form import parse_json
from betterbench.ordinary_file import open_ordinary
from betterbench.policies.address import PolicyAddress
from betterbench.policies.learned.families import learner_family

if TYPE_CHECKING:
    from betterbench.policies.learned.policy import Learner, SeeingPolicy

FILE_NAME = "checkpoint.safetensors"
_MOST_HEADER = 1 << 24


def is_seeing(address: PolicyAddress) -> bool:
    """Return whether the learner at an address uses observations, as learners of the family ``pixels`` do.

    The result is also False if the checkpoint is missing, damaged or of an unknown family. Loading such a checkpoint
    raises an error later.
    """
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


def learned_info(address: PolicyAddress) -> PolicyInfo:
    """Return the description of a learned policy.

    Raises:
        MissingDependencyError: If torch or safetensors is not installed.
        InvalidInputError: If the checkpoint is missing or damaged, or an option is out of range.
    """
    learner = load_learner(address)
    return learner.info(address.text, execute=_executed(address, learner))


def make_learned(address: PolicyAddress, instruction: str, seed: int) -> PrivilegedPolicy:
    """Create a learned policy for one episode. Raises the errors of :func:`learned_info`."""
    learner = load_learner(address)
    from betterbench.policies.learned.policy import LearnedPolicy  # noqa: PLC0415 - needs torch

    execute = _executed(address, learner)
    return LearnedPolicy(address.text, learner, instruction, episode_number(seed), execute=execute)


def make_seeing(address: PolicyAddress) -> SeeingPolicy:
    """Create a learned policy that uses observations. Raises the errors of :func:`learned_info`."""
    learner = load_learner(address)
    from betterbench.policies.learned.policy import SeeingPolicy  # noqa: PLC0415 - needs torch

    return SeeingPolicy(address.text, learner, execute=_executed(address, learner))


def _executed(address: PolicyAddress, learner: Learner) -> int:
    """Return the execution horizon from the option ``execute`` of the address or, by default, from the recipe.

    Raises InvalidInputError if a chunk has fewer actions than the execution horizon.
    """
    recipe, given = learner.trained.recipe, address.options.get("execute")
    if given is None:
        return recipe.execute
    if not given.isdecimal() or not 1 <= int(given[:9]) <= recipe.chunk:
        raise address.error(
            f"execute={given} is out of range",
            f"Use a number from 1 to {recipe.chunk}, which is the number of actions per chunk",
        )
    return int(given)


def checkpoint_of(address: PolicyAddress) -> Path:
    """Return the path of the checkpoint file. The address may name the file or its folder."""
    try:
        path = Path(address.target).expanduser()
    except RuntimeError as error:
        raise address.error("the home folder does not exist", "Write the full path") from error
    return path / FILE_NAME if path.is_dir() else path


@functools.lru_cache(maxsize=64)
def _family(path: Path, changed_ns: int, size: int) -> str | None:
    """Return the family named in the header of a checkpoint, or None if there is none. This does not need torch."""
    del changed_ns  # only part of the cache key
    try:
        with open_ordinary(path) as file:
            length = int.from_bytes(file.read(8), "little")
            if length > min(size, _MOST_HEADER):
                return None
            about = parse_json(parse_json(file.read(length))["__metadata__"]["betterbench"])
        return str(about["recipe"]["family"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def load_learner(address: PolicyAddress) -> Learner:
    """Return the learner of a checkpoint. The learner is kept in memory until the file changes.

    Raises the errors of :func:`learned_info`.
    """
    require_torch("learned:")
    path = checkpoint_of(address)
    try:
        found = path.stat()
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise InvalidInputError(str(path), problem, "Use a folder written by better train") from error
    return _loaded(path.absolute(), found.st_mtime_ns, found.st_size)


@functools.lru_cache(maxsize=4)
def _loaded(path: Path, changed_ns: int, size: int) -> Learner:
    del changed_ns, size  # only parts of the cache key
    from betterbench.policies.learned.policy import Learner  # noqa: PLC0415 - needs torch

    return Learner.load(path)


def require_torch(what: str) -> None:
    """Raise MissingDependencyError if torch or safetensors is not installed.

    ``what`` is the name of the feature that needs them, which the error message contains.
    """
    try:
        import safetensors.torch  # noqa: F401, PLC0415
        import torch  # noqa: F401, PLC0415
    except ImportError as error:
        raise missing_extra(
            f"{what} needs torch and safetensors, which are not installed ({error})", "train"
        ) from error
