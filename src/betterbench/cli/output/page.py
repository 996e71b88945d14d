"""Output of subcommands that build a report: progress bars, followed by the verdicts."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.api.report import ReportListener
from betterbench.cli.console import ERR, passing_bar, say

LISTENER = ReportListener(say=say, warn=say, bar=passing_bar)
"""Listener that shows the progress of building a report on standard error."""


def print_verdicts(verdicts: Sequence[str]) -> None:
    """Print verdicts as the last lines of output, on standard error."""
    for verdict in verdicts:
        ERR.print(verdict, markup=False, style="bold", soft_wrap=not ERR.is_terminal)
