"""The failure modes, one file each: every file of this folder registers itself.

An installed package adds its own by an entry point in the group ``betterbench.failure_modes`` that names a module.
"""

import importlib
import pkgutil
from importlib.metadata import entry_points

from betterbench.diagnosis.failure_mode import MODES

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")
for _entry in entry_points(group="betterbench.failure_modes"):
    _entry.load()

__all__ = ["MODES"]
