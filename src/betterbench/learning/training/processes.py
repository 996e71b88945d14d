"""Processes of a distributed training run that was started with torch's launcher ``torchrun``."""

from __future__ import annotations

import os
from dataclasses import dataclass

from betterbench.errors import InvalidInputError

_CURE = "Start the command with torchrun, or unset these variables"


@dataclass(frozen=True, slots=True)
class TrainingProcesses:
    """Position of this process in a distributed training run.

    Attributes:
        rank: Index of this process among all processes.
        size: Number of processes.
        local_rank: Index of this process among the processes on its machine.
    """

    rank: int = 0
    size: int = 1
    local_rank: int = 0

    @classmethod
    def here(cls) -> TrainingProcesses:
        """Read the position of this process from torchrun's environment variables.

        If the variables are not set, this process is the only one.

        Raises:
            InvalidInputError: If the values of the variables are inconsistent.
        """
        names = ("RANK", "WORLD_SIZE", "LOCAL_RANK")
        said = [os.environ.get(name, usual) for name, usual in zip(names, "010", strict=True)]
        rank, size, local = (
            int(text) if text.isascii() and text.isdecimal() and len(text) < 7 else -1 for text in said
        )
        if not (0 <= rank < size and 0 <= local < size):
            told = ", ".join(f"{name}={text}" for name, text in zip(names, said, strict=True))
            raise InvalidInputError("the environment", f"the variables {told} are inconsistent", _CURE)
        return cls(rank, size, local)

    def device(self, named: str) -> str:
        """Return the torch device for this process.

        On a machine with several GPUs, each process uses the GPU with its index.

        Args:
            named: Device that the user selected: ``cpu``, ``cuda`` or ``cuda:N``.

        Raises:
            InvalidInputError: If a single GPU is selected for several processes.
        """
        if self.size == 1 or not named.startswith("cuda"):
            return named
        if named != "cuda":
            problem = f"this would make all {self.size} processes use the same GPU"
            raise InvalidInputError(f"--device {named}", problem, "Use --device cuda to give each process its own GPU")
        return f"cuda:{self.local_rank}"
