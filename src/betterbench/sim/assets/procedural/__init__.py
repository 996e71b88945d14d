"""Procedural library of objects. Importing this package registers the generators in all its files.

Each file in this folder defines one family of objects.
"""

import importlib
import pkgutil

for _file in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_file.name}")
