"""The processes that train together, as torch's launcher ``torchrun`` starts them."""

from __future__ import annotations

import os
from dataclasses import dataclass

from betterbench.errors import InvalidInputError

_CURE = "Start it under torchrun, or unset them"


@dataclass(frozen=True, slots=True)
class TrainingProcesses:
    """Position of this process among those that train together.

    Attributes:
        rank: Number of this process among all.
        size: Number of processes.
        local_rank: Number of this process among those of its machine.
    """

    rank: int = 0
    size: int = 1
    local_rank: int = 0

    @classmethod
    def here(cls) -> TrainingProcesses:
        """Return the processes that torchrun's environment variables describe; a single one without these.

        Raises InvalidInputError if their values are inconsistent.
        """
        names = ("RANK", "WORLD_SIZE", "LOCAL_RANK")
        said = [os.environ.get(name, usual) for name, usual in zip(names, "010", strict=True)]
        rank, size, local = (
            int(text) if text.isascii() and text.isdecimal() and len(text) < 7 else -1 for text in said
        )
        if not (0 <= rank < size and 0 <= local < size):
            told = ", ".join(f"{name}={text}" for name, text in zip(names, said, strict=True))
            raise InvalidInputError("the environment", f"{told} are no process among others", _CURE)
        return cls(rank, size, local)

    def device(self, named: str) -> str:
        """Return torch's device of this process, where ``--device`` names ``cpu``, ``cuda`` or ``cuda:N``.

        On a machine with several cards each process takes the one of its own number. Raises InvalidInputError if one
        card is named for several processes.
        """
        if self.size == 1 or not named.startswith("cuda"):
            return named
        if named != "cuda":
            problem = f"names one card for {self.size} processes"
            raise InvalidInputError(f"--device {named}", problem, "Give cuda, of which each process takes its own")
        return f"cuda:{self.local_rank}"
