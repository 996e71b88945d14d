"""Kinds of asset sources, one file each, and their registry.

New files in this folder are registered automatically. ``source`` contains the registry. ``mesh_facts`` reads facts
about mesh files without loading the meshes.
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
