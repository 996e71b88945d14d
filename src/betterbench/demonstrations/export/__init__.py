"""Export: demonstrations of runs as the data sets that people train policies on, in the layout of a policy's preset.

- ``job``, ``selection``, ``part``, ``frames``, ``actions``, ``layout``: which episodes, and their columns.
- ``lerobot``, ``lerobot_v21``, ``robomimic``, ``video``, ``language``, ``card``: the formats.
- ``check``, ``expected``, ``comparing``, ``lerobot_check``, ``robomimic_check``: an export compared with its records.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from betterbench.demonstrations.export.check import check_export
    from betterbench.demonstrations.export.job import Exported, ExportPlan, export_dataset
    from betterbench.demonstrations.export.layout import DatasetLayout, layout_of
    from betterbench.demonstrations.export.selection import Selection, select_demonstrations

__all__ = [
    "DatasetLayout",
    "ExportPlan",
    "Exported",
    "Selection",
    "check_export",
    "export_dataset",
    "layout_of",
    "select_demonstrations",
]

_MODULES = {
    "check_export": "check",
    "ExportPlan": "job",
    "Exported": "job",
    "export_dataset": "job",
    "DatasetLayout": "layout",
    "layout_of": "layout",
    "Selection": "selection",
    "select_demonstrations": "selection",
}


def __getattr__(name: str) -> object:
    """Import the module of a public name when it is first used."""
    if name not in _MODULES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
