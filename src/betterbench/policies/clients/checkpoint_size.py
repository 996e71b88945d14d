"""Limits on the size of the network that is built from the configuration of a LeRobot checkpoint.

LeRobot builds the network from ``config.json`` before it reads the weights. Without these limits, an invalid
configuration, for example one with a layer width of a million, would fill all memory before LeRobot could detect that
the weights do not match.
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Iterator

from betterbench.errors import InvalidInputError, one_line

_STEPS = ("chunk_size", "action_chunk_size", "horizon", "n_action_steps", "n_obs_steps", "n_action_pred_token")
_MOST_STEPS = 4096
"""Maximum length of an action chunk or of an observation history [steps].

LeRobot's own configurations use at most 100.
"""

_ALWAYS_ALLOWED = 16_000_000
"""Number of parameters that is allowed even if the weights file is smaller.

LeRobot first builds a backbone that it later replaces, so more parameters may be created than the file contains.
"""


_MOST_TENSORS = 100_000
"""Maximum number of weight and bias tensors of a network. LeRobot's largest network has a few thousand."""


def require_short_horizons(config: object, where: str) -> None:
    """Check the lengths of chunks and histories in a configuration, because LeRobot allocates tables of these lengths.

    Raises:
        InvalidInputError: If a length is above 4,096 steps.
    """
    for name in _STEPS:
        value = getattr(config, name, None)
        if isinstance(value, int | float) and value > _MOST_STEPS:
            raise InvalidInputError(
                where,
                f"{name} in config.json is {one_line(value, most=40)}, but at most {_MOST_STEPS} is supported",
                "Correct config.json, or save the checkpoint again",
            )


@contextlib.contextmanager
def bounded_parameters(file_bytes: int, where: str) -> Iterator[None]:
    """Context manager that limits the number of network parameters to the number of bytes in the weights file.

    A parameter takes at least one byte in the file (four bytes in LeRobot's own files), so a network with more
    parameters than bytes in the file cannot be the saved network. PyTorch allocates the memory of a parameter,
    registers the parameter and then initializes it. The limit is checked at the registration, so the operating system
    has not yet assigned physical memory.

    Args:
        file_bytes: Size of the weights file [bytes].
        where: Name of the checkpoint for error messages.

    Raises:
        InvalidInputError: If the number of parameters or weight tensors exceeds its limit.
    """
    most, seen, tensors = max(file_bytes, _ALWAYS_ALLOWED), 0, 0

    def count(_module: object, _name: str, parameter: object) -> None:
        nonlocal seen, tensors
        tensors += 1
        seen += 0 if parameter is None else int(parameter.numel())  # type: ignore[attr-defined]
        if seen > most or tensors > _MOST_TENSORS:
            size = f"{most:,} parameters" if seen > most else f"{_MOST_TENSORS:,} weight tensors"
            raise InvalidInputError(
                where,
                f"config.json describes a network with more than {size}, but the weights file has only "
                f"{file_bytes:,} bytes",
                "Use a config.json and weights that belong to the same checkpoint",
            )

    modules = importlib.import_module("torch.nn.modules.module")
    handle = modules.register_module_parameter_registration_hook(count)
    try:
        yield
    finally:
        handle.remove()
