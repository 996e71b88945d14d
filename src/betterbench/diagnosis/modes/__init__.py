"""The failure modes, one file each: every file of this folder registers itself.

Users' files and installed packages register theirs as they do tasks and assets (``tasks.user_files``).
"""

import importlib
import pkgutil

from betterbench.diagnosis.failure_mode import MODES
from betterbench.tasks.user_files import load_declared

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")
load_declared()

__all__ = ["MODES"]
