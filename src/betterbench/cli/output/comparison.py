"""Functions that print a comparison of policies."""

from __future__ import annotations

from betterbench.cli.console import OUT, print_table
from betterbench.cli.output.standing import print_standings
from betterbench.comparison import Comparison, Contrast, Group
from betterbench.comparison.verdict import p_text, points, scope_text
from betterbench.statistics import percent


def print_comparison(result: Comparison) -> None:
    """Print the verdict, the success and failure tables, and the smallest detectable differences."""
    for sentence in result.verdict:
        OUT.print(sentence, markup=False)
    success = [g for g in result.groups if g.measure == "success"]
    failures = [g for g in result.groups if g.measure != "success"]
    for title, groups in (("success", success), ("failures on the variations", failures)):
        if groups:
            OUT.print()
            _print_groups(title, groups, result.alpha)
    if result.standings:
        print_standings([s.name for s in result.sides], result.standings)
    OUT.print()
    for line in (*_legend(result), *result.notes):
        OUT.print(line, markup=False, style="dim")


def _print_groups(title: str, groups: list[Group], alpha: float) -> None:
    """Print one row per group of trials, with the success rate or other measure of each policy.

    If two policies are compared, the row also shows the difference between them. Policies that share a letter after
    their rates cannot be distinguished statistically.
    """
    names = groups[0].names
    columns = ["over" if groups[0].measure == "success" else "what", *names]
    if len(names) == 2:
        columns += [f"difference, {100 * (1 - alpha):g} %", "p"]
    rows = []
    for group in groups:
        row = [_what(group)]
        for rate, letters in zip(group.rates, group.letters, strict=True):
            row.append(f"{rate.k}/{rate.n} {percent(rate.k, rate.n)} % {letters}")
        if len(names) == 2:
            row += _difference(group.contrasts[0])
        rows.append(row)
    rates = range(1, 1 + len(names)) if len(names) == 2 else ()  # a rate on two lines is hard to read
    print_table(columns, rows, title=title, whole=rates)


def _what(group: Group) -> str:
    """Return the title of a table row.

    The name of an axis is shortened to two words, so that the table fits the terminal.
    """
    if group.scope.startswith("axis:"):
        return " ".join(scope_text(group.scope).split()[:2])
    return scope_text(group.scope) if group.measure == "success" else group.measure.replace("_", " ")


def _difference(contrast: Contrast) -> list[str]:
    d = contrast.difference
    return [
        f"{points(d.value or 0.0)} ({points(d.low)} to {points(d.high)})",
        p_text(contrast.p_adjusted).removeprefix("p = ").removeprefix("p "),
    ]


def _legend(result: Comparison) -> list[str]:
    names = [s.name for s in result.sides]
    n = len(result.matching.trials[0])
    tests = sorted({c.test for g in result.groups for c in g.contrasts})
    family = "overall, training, axes, tasks, kinds of failure, labels"
    lines = [
        "Policies that share a letter cannot be distinguished.",
        f"Tests: {' and '.join(tests)}, Holm's correction within each family ({family}), alpha {result.alpha:g}.",
    ]
    if len(names) == 2:
        lines.append(f"Differences are {names[0]} minus {names[1]}, in percentage points.")
    if result.matching.paired:
        lines.append(f"Compared: {n} trials that all runs plan (same task, variation or condition, and seed).")
    return lines
