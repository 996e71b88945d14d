"""Comparison of policies across simulated worlds, including the illusion gaps of the policies.

An illusion gap is the drop in success when the scene changes. Results are success rates in LIBERO, and numbers of
subtasks completed in sequence (chain lengths) in CALVIN.
"""

from betterbench.comparison.across.gaps import WorldGap, gaps_of
from betterbench.comparison.across.suite_runs import SuiteRun, is_across, read_suite_runs
from betterbench.comparison.across.world_table import LIBERO_COLUMNS, WorldContrast, WorldRow, WorldTable, world_table

__all__ = [
    "LIBERO_COLUMNS",
    "SuiteRun",
    "WorldContrast",
    "WorldGap",
    "WorldRow",
    "WorldTable",
    "gaps_of",
    "is_across",
    "read_suite_runs",
    "world_table",
]
