"""Table 4 of the betterbench paper, computed from runs: success rates in LIBERO and chain lengths in CALVIN."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from betterbench.comparison.across.suite_runs import OURS, SuiteRun
from betterbench.errors import RunConflictError
from betterbench.statistics import (
    Difference,
    PairedTable,
    Rate,
    holm,
    mcnemar_p,
    mean_of_rates,
    wider_paired_difference,
)
from betterbench.tasks import stream
from betterbench.tasks.worlds.calvin import ChainContrast, ChainSummary, contrast, summarize

LIBERO_COLUMNS = {
    "libero_spatial": "Spatial",
    "libero_object": "Object",
    "libero_goal": "Goal",
    "libero_10": "Long",
}
"""Suites in Table 4, each with its name in the paper."""

AVERAGE = "average"
CALVIN = "calvin"


@dataclass(frozen=True, slots=True)
class WorldRow:
    """Results of one policy in LIBERO and CALVIN, shown as one row of the table.

    Attributes:
        policy: Name of the policy.
        suites: Success rate in each LIBERO suite that was run, by the suite's name.
        average: Mean of the success rates in LIBERO's four suites, with equal weights, with its confidence interval.
            None if a suite was not run.
        chains: Results of the CALVIN chains, or None if they were not run.
    """

    policy: str
    suites: Mapping[str, Rate]
    average: Difference | None
    chains: ChainSummary | None

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "policy": self.policy,
            "suites": {name: rate.to_json() for name, rate in self.suites.items()},
            AVERAGE: None if self.average is None else self.average.to_json(),
            CALVIN: None if self.chains is None else self.chains.to_json(),
        }


@dataclass(frozen=True, slots=True)
class WorldContrast:
    """Comparison of two policies in one LIBERO suite, on the same initial states.

    Attributes:
        first: Name of the first policy.
        second: Name of the second policy.
        suite: Name of the suite, or "average" for all four suites together.
        pairs: Number of initial states from which both policies were run.
        difference: Success rate of the first policy minus success rate of the second, with its confidence interval.
        p_value: p-value of the exact McNemar test, after Holm's correction over the suites of this pair of policies.
    """

    first: str
    second: str
    suite: str
    pairs: int
    difference: Difference
    p_value: float

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {**asdict(self), "difference": self.difference.to_json()}


@dataclass(frozen=True, slots=True)
class WorldTable:
    """Table of the results of policies in LIBERO and CALVIN, with comparisons between the policies.

    Attributes:
        rows: One row for each policy.
        contrasts: Comparisons of each pair of policies in LIBERO.
        chain_contrasts: Comparisons of each pair of policies in CALVIN, with the names of both policies.
        notes: Notes about the limits of the results.
    """

    rows: tuple[WorldRow, ...]
    contrasts: tuple[WorldContrast, ...]
    chain_contrasts: tuple[tuple[str, str, ChainContrast], ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "rows": [row.to_json() for row in self.rows],
            "contrasts": [c.to_json() for c in self.contrasts],
            "chain_contrasts": [
                {"first": a, "second": b, **asdict(c), "difference": c.difference.to_json()}
                for a, b, c in self.chain_contrasts
            ],
            "notes": list(self.notes),
        }


def world_table(runs: Sequence[SuiteRun], *, alpha: float = 0.05, allow_mixed: bool = False) -> WorldTable:
    """Return the table of the results of all policies, in the order of the runs.

    Raises:
        RunConflictError: If two runs of the same suite used different protocols or versions of the simulated world, and
            ``allow_mixed`` is False.
    """
    notes = [*_clashes(runs, allow_mixed=allow_mixed), *_limits(runs)]
    policies = list(dict.fromkeys(run.policy for run in runs))
    by = {(run.policy, run.suite): run for run in runs if run.change is None and run.suite != OURS}
    rows = [_row(policy, by) for policy in policies]
    contrasts: list[WorldContrast] = []
    chains: list[tuple[str, str, ChainContrast]] = []
    for a, b in itertools.combinations(policies, 2):
        contrasts += _contrasts(a, b, by, alpha)
        if (a, CALVIN) in by and (b, CALVIN) in by:
            first, second = by[a, CALVIN].chains, by[b, CALVIN].chains
            if {c.number for c in first} & {c.number for c in second}:
                chains.append((a, b, contrast(first, second)))
            else:
                notes.append(f"{a} and {b} have no CALVIN chain in common, so they are not compared there.")
    return WorldTable(tuple(rows), tuple(contrasts), tuple(chains), tuple(notes))


def _row(policy: str, by: Mapping[tuple[str, str], SuiteRun]) -> WorldRow:
    suites = {
        name: Rate(sum(by[policy, name].successes.values()), len(by[policy, name].successes))
        for name in LIBERO_COLUMNS
        if (policy, name) in by
    }
    whole = len(suites) == len(LIBERO_COLUMNS)
    chains = by.get((policy, CALVIN))
    return WorldRow(
        policy,
        suites,
        mean_of_rates(list(suites.values())) if whole else None,
        None if chains is None else summarize(chains.chains),
    )


def _contrasts(a: str, b: str, by: Mapping[tuple[str, str], SuiteRun], alpha: float) -> list[WorldContrast]:
    """Compare two policies in each suite in which both were run, and over all four suites together.

    The p-values of the suites are corrected together for multiple testing.
    """
    pairs: dict[str, list[tuple[tuple[str, int], bool, bool]]] = {}
    for suite in LIBERO_COLUMNS:
        if (a, suite) in by and (b, suite) in by:
            first, second = by[a, suite].successes, by[b, suite].successes
            pairs[suite] = [(key, first[key], second[key]) for key in sorted(first.keys() & second.keys())]
    pairs = {suite: found for suite, found in pairs.items() if found}
    adjusted = list(holm([mcnemar_p(_table(found)) for found in pairs.values()]))
    if len(pairs) == len(LIBERO_COLUMNS):
        every = [pair for found in pairs.values() for pair in found]
        pairs[AVERAGE] = every
        adjusted.append(mcnemar_p(_table(every)))
    contrasts = []
    for (suite, found), p in zip(pairs.items(), adjusted, strict=True):
        difference = wider_paired_difference(
            [(x, y) for _, x, y in found],
            generator=stream("across", 0, f"bootstrap:{suite}"),
            strata=[task for (task, _), _, _ in found],
            clusters=[str(key) for key, _, _ in found],
            confidence=1.0 - alpha,
        )
        contrasts.append(WorldContrast(a, b, suite, len(found), difference, p))
    return contrasts


def _table(pairs: Sequence[tuple[tuple[str, int], bool, bool]]) -> PairedTable:
    return PairedTable.from_outcomes((x, y) for _, x, y in pairs)


def _clashes(runs: Sequence[SuiteRun], *, allow_mixed: bool) -> list[str]:
    """Return a note for each difference in protocol or versions between runs with the same base suite.

    Raises:
        RunConflictError: If there is a difference and ``allow_mixed`` is False.
    """
    notes = []
    for base in dict.fromkeys(run.base for run in runs):
        same = [run for run in runs if run.base == base]
        for what in ("protocol", "versions"):
            values = {run.path.name: _said(getattr(run, what)) for run in same}
            if len(set(values.values())) > 1:
                listed = "; ".join(f"{value} in {name}" for name, value in values.items())
                problem = f"{base}: the {what} differ: {listed}."
                if not allow_mixed:
                    raise RunConflictError(
                        f"{problem} Repeat one of the two runs with the same protocol and installation, or use "
                        f"--allow-mixed and interpret the results with care."
                    )
                notes.append(problem)
    return notes


def _said(value: object) -> str:
    return ", ".join(f"{k} {v}" for k, v in sorted(value.items())) if isinstance(value, Mapping) else str(value)


def _limits(runs: Sequence[SuiteRun]) -> list[str]:
    notes = []
    for run in runs:
        where = f"{run.policy} in {run.suite}"
        if run.unfinished:
            notes.append(f"{run.unfinished}/{run.planned} trials of {where} are not finished and count as failures.")
        if run.broken:
            notes.append(
                f"{run.broken}/{run.planned} trials of {where} have no record because of an error and count "
                f"as failures."
            )
        if run.suite == CALVIN and len(run.chains) != 1000:
            notes.append(f"{where}: {len(run.chains)} of 1,000 chains; CALVIN's published numbers use all of them.")
        if run.suite in LIBERO_COLUMNS and run.protocol == "openpi" and run.planned != 500:
            notes.append(f"{where}: {run.planned} of 500 trials of the protocol.")
    return notes
