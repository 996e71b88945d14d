"""Sources of assets, one file each, and the registry that knows how an address begins.

A new file in this folder is found by itself. ``source`` is the registry, and ``mesh_facts`` reads from mesh files what
can be known without loading a mesh.
"""

import importlib
import pkgutil

from betterbench.sim.assets.catalogue.sources.source import (
    SOURCES,
    AssetSource,
    SourceItem,
    SourceKind,
    SourceOptions,
    open_source,
    register,
)

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

__all__ = [
    "SOURCES",
    "AssetSource",
    "SourceItem",
    "SourceKind",
    "SourceOptions",
    "open_source",
    "register",
]
