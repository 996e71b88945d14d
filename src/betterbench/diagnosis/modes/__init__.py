"""Failure modes, one per file. Each file in this folder registers its failure mode when it is imported.

Installed packages and task files can add more failure modes (see :mod:`betterbench.tasks.user_files`).
"""

import importlib
import pkgutil
from pathlib import Path

from betterbench.diagnosis.failure_mode import MODES
from betterbench.errors import errors_explained
from betterbench.tasks.user_files import load_declared

for _module in pkgutil.iter_modules(__path__):
    with errors_explained(str(Path(__path__[0]) / f"{_module.name}.py")):
        importlib.import_module(f"{__name__}.{_module.name}")
load_declared()

__all__ = ["MODES"]
