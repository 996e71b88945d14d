"""Asset sources, one file each, and the registry of their address schemes.

New files in this folder are registered automatically. ``source`` is the registry, and ``mesh_facts`` reads facts of
mesh files without loading the mesh.
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
