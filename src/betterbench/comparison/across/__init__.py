"""Comparison across worlds: success rates in LIBERO, chains in CALVIN, and the illusion gaps of each policy."""

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
