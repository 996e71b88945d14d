"""Failure modes, one per file. Each file in this folder registers its failure mode when it is imported.

Installed packages and task files can add more failure modes (see :mod:`betterbench.tasks.user_files`).
"""

import importlib
import pkgutil

from betterbench.diagnosis.failure_mode import MODES
from betterbench.tasks.user_files import load_declared

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")
load_declared()

__all__ = ["MODES"]
