"""Functions that print the comparison of a policy with the pretenders (simulated faulty policies)."""

from __future__ import annotations

from collections.abc import Sequence

from betterbench.cli.console import OUT, print_item, print_table
from betterbench.diagnosis.measures.standing import Standing
from betterbench.report.pages.pretenders import scope_columns, score_rows
from betterbench.tasks import Axis

SHOWN_LINES = 8
"""Maximum number of reference lines on the terminal. The report and the output of ``--json`` contain all lines."""


def print_standing(policy: str, standing: Standing) -> None:
    """Print the success rates of a policy and of the pretenders (simulated faulty policies).

    The pretender that is most similar to the policy is named.
    """
    print_standings([policy], [standing])


def print_standings(policies: Sequence[str], standings: Sequence[Standing]) -> None:
    """Print the success rates of policies and of the pretenders (simulated faulty policies) most similar to them.

    The pretenders are sorted by their similarity to the first policy. All policies must have run the same trials.
    """
    first = standings[0]
    columns = scope_columns(standings)
    OUT.print()
    if first.lines:
        mine = [score_rows(p, s, columns)[0] for p, s in zip(policies, standings, strict=True)]
        lines = score_rows(policies[0], first, columns)[1:]
        alone = len(policies) == 1
        near = [row for row in lines if row.name in {s.nearest.pretender for s in standings if s.nearest is not None}]
        shown = [row for row in lines if row in lines[:SHOWN_LINES] or row in near]
        head = ["policy or pretender", *map(_short, columns), *(["alike"] if alone else [])]
        rows = [[row.name, *row.cells, *([row.likeness] if alone else [])] for row in (*mine, *shown)]
        print_table(head, rows, title="pretenders: success, %")
        if len(lines) > len(shown):
            OUT.print(f"  and {len(lines) - len(shown)} more pretenders; --json lists all", markup=False, style="dim")
    for policy, standing in zip(policies, standings, strict=True):
        prefix = "" if len(policies) == 1 else f"{policy}: "
        for sentence in standing.sentences():
            if sentence != standing.notice:
                print_item(f"• {prefix}{sentence}")
    for notice in dict.fromkeys(s.notice for s in standings if s.notice):
        OUT.print(f"  {notice}", markup=False, style="dim")


def _short(scope: str) -> str:
    """Return the heading of a column. An axis is abbreviated to its letter, so that the table fits the terminal."""
    return "overall" if scope == "overall" else Axis(scope.removeprefix("axis:")).letter
