"""Limits on the network that the configuration of a checkpoint of LeRobot describes.

LeRobot builds the network from ``config.json`` and reads the weights afterwards. A width of a million in a file of one
kilobyte would therefore take all memory before anything is compared with the weights.
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Iterator

from betterbench.errors import InvalidInputError, one_line

_STEPS = ("chunk_size", "action_chunk_size", "horizon", "n_action_steps", "n_obs_steps", "n_action_pred_token")
_MOST_STEPS = 4096
"""Longest chunk or history [steps]; the longest of LeRobot's own configurations has 100."""

_ALWAYS_ALLOWED = 16_000_000
"""Parameters that a network may have whatever its file holds: a backbone that LeRobot builds and then replaces."""


_MOST_TENSORS = 100_000
"""Most weight and bias tensors of a network; the largest network that LeRobot knows has some thousand."""


def require_short_horizons(config: object, where: str) -> None:
    """Check the numbers of steps in a configuration, for which LeRobot makes tables while it builds the network.

    Raises:
        InvalidInputError: If one is above 4,096.
    """
    for name in _STEPS:
        value = getattr(config, name, None)
        if isinstance(value, int | float) and value > _MOST_STEPS:
            raise InvalidInputError(
                where,
                f"{name} of its config.json is {one_line(value, most=40)}, expected at most {_MOST_STEPS}",
                "Correct config.json, or save the checkpoint again",
            )


@contextlib.contextmanager
def bounded_parameters(file_bytes: int, where: str) -> Iterator[None]:
    """Limit the parameters of the networks that are built in this context by the size of the file of their weights.

    A parameter takes at least one byte of the file, and four in LeRobot's own files, so that a network with more
    parameters than the file has bytes cannot be the one that was saved. PyTorch reserves the memory of a parameter,
    registers it and then fills it; the count is taken at the second of these steps, before memory is used.

    Args:
        file_bytes: Size of the file of the weights [bytes].
        where: Name of the checkpoint in messages.

    Raises:
        InvalidInputError: If a network grows larger.
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
                f"its config.json describes a network of more than {size}, and the file of its weights has "
                f"{file_bytes:,} bytes",
                "Take config.json and the weights from the same checkpoint",
            )

    modules = importlib.import_module("torch.nn.modules.module")
    handle = modules.register_module_parameter_registration_hook(count)
    try:
        yield
    finally:
        handle.remove()
