"""Across worlds: success in LIBERO, chains of CALVIN, and what changing the scene costs, policy by policy."""

from betterbench.across.gaps import Gap, gaps_of
from betterbench.across.suite_runs import SuiteRun, is_across, read_suite_runs
from betterbench.across.world_table import (
    LIBERO_COLUMNS,
    WorldContrast,
    WorldRow,
    WorldTable,
    world_table,
)

__all__ = [
    "LIBERO_COLUMNS",
    "Gap",
    "SuiteRun",
    "WorldContrast",
    "WorldRow",
    "WorldTable",
    "gaps_of",
    "is_across",
    "read_suite_runs",
    "world_table",
]
