"""Export demonstrations as data sets for policy training. A policy preset defines the columns.

- ``job``, ``selection``, ``part``, ``frames``, ``actions``, ``layout``: the episodes and their columns.
- ``lerobot``, ``lerobot_v21``, ``robomimic``, ``video``, ``language``, ``card``: the file formats.
- ``check``, ``expected``, ``comparing``, ``lerobot_check``, ``robomimic_check``: comparison of an exported data set
  with its source records.
"""

from typing import TYPE_CHECKING

from betterbench.lazy_names import lazy_names

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

if not TYPE_CHECKING:
    __getattr__ = lazy_names(
        __name__,
        {
            "check": ("check_export",),
            "job": ("ExportPlan", "Exported", "export_dataset"),
            "layout": ("DatasetLayout", "layout_of"),
            "selection": ("Selection", "select_demonstrations"),
        },
    )
