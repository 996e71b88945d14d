"""Tasks of the suite, with one short file each. New files in this folder are found automatically."""

import importlib
import pkgutil
from pathlib import Path

from betterbench.errors import errors_explained

for _module in pkgutil.iter_modules(__path__):
    with errors_explained(str(Path(__path__[0]) / f"{_module.name}.py")):
        importlib.import_module(f"{__name__}.{_module.name}")
