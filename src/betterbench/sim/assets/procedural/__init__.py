"""The embedded library: importing this package registers the generators of all its files.

A new family of objects is one new file in this folder.
"""

import importlib
import pkgutil

for _file in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_file.name}")
