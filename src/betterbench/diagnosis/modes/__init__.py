"""Failure modes, one per file. Each file in this folder registers its failure mode when it is imported.

Installed packages and task files can add more failure modes (see :mod:`betterbench.tasks.user_files`).
"""

from betterbench.diagnosis.failure_mode import MODES, places_of_modes
from betterbench.errors import import_registering
from betterbench.tasks.user_files import load_declared

import_registering(
    __name__,
    __path__[0],
    places_of_modes,
    "Decorate the function that finds the evidence with @FailureMode(...)",
)
load_declared()

__all__ = ["MODES"]
