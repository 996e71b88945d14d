"""Processes of a distributed training, as started by torch's launcher ``torchrun``."""

from __future__ import annotations

import os
from dataclasses import dataclass

from betterbench.errors import InvalidInputError

_CURE = "Start the command with torchrun, or unset these variables"


@dataclass(frozen=True, slots=True)
class TrainingProcesses:
    """This process's position in a distributed training.

    Attributes:
        rank: Index of this process among all.
        size: Number of processes.
        local_rank: Index of this process among the processes on its machine.
    """

    rank: int = 0
    size: int = 1
    local_rank: int = 0

    @classmethod
    def here(cls) -> TrainingProcesses:
        """Return the position given by torchrun's environment variables; a single process without them.

        Raises:
            InvalidInputError: If their values are inconsistent.
        """
        names = ("RANK", "WORLD_SIZE", "LOCAL_RANK")
        said = [os.environ.get(name, usual) for name, usual in zip(names, "010", strict=True)]
        rank, size, local = (
            int(text) if text.isascii() and text.isdecimal() and len(text) < 7 else -1 for text in said
        )
        if not (0 <= rank < size and 0 <= local < size):
            told = ", ".join(f"{name}={text}" for name, text in zip(names, said, strict=True))
            raise InvalidInputError("the environment", f"{told} are inconsistent", _CURE)
        return cls(rank, size, local)

    def device(self, named: str) -> str:
        """Return torch's device for this process; ``--device`` is ``cpu``, ``cuda`` or ``cuda:N``.

        On a machine with several GPUs, each process uses the GPU with its own index.

        Raises:
            InvalidInputError: If a single GPU is selected for several processes.
        """
        if self.size == 1 or not named.startswith("cuda"):
            return named
        if named != "cuda":
            problem = f"selects one GPU for all {self.size} processes"
            raise InvalidInputError(f"--device {named}", problem, "Give cuda, so that each process takes its own GPU")
        return f"cuda:{self.local_rank}"
