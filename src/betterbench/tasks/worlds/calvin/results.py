"""Results of CALVIN chains: five success rates, the average length, rates per subtask, and comparisons of two runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.statistics import Difference, PairedTable, Rate, holm, mcnemar_p, paired_bootstrap, wilson_interval
from betterbench.tasks.worlds.calvin.sequences import CHAIN_LENGTH, calvin_chains

_SEED = 0


@dataclass(frozen=True, slots=True)
class SubtaskResult:
    """Result of a subtask that was started.

    Attributes:
        name: Name of the subtask in CALVIN.
        success: Whether the subtask was done.
        steps: Number of control steps that it took.
    """

    name: str
    success: bool
    steps: int


@dataclass(frozen=True, slots=True)
class ChainResult:
    """Result of a chain, up to the first subtask that failed.

    A chain without subtasks was not run. Its length is 0, and it has no effect on the rates of the subtasks.

    Attributes:
        number: Index of the chain among the 1,000 chains.
        played: Results of the subtasks that were started, in order.
    """

    number: int
    played: tuple[SubtaskResult, ...]

    @property
    def length(self) -> int:
        """Number of subtasks done in a row, from 0 to 5."""
        return sum(subtask.success for subtask in self.played)


@dataclass(frozen=True, slots=True)
class MeanLength:
    """Average length of chains with its 95 % confidence interval. The values are between 0 and 5."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class ChainSummary:
    """Summary of the results of one run on CALVIN chains.

    Attributes:
        chains: Number of chains.
        in_a_row: Fractions of chains in which at least 1, 2, 3, 4 and 5 subtasks were done in a row.
        length: Average length of the chains.
        subtasks: Success rate of each subtask over the chains that reached it, by name. A policy reaches later subtasks
            only after successes. The rates of two policies are therefore not computed over the same trials.
    """

    chains: int
    in_a_row: tuple[Rate, ...]
    length: MeanLength
    subtasks: dict[str, Rate]

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {
            "chains": self.chains,
            "in_a_row": [rate.to_json() for rate in self.in_a_row],
            "length": asdict(self.length),
            "subtasks": {name: rate.to_json() for name, rate in self.subtasks.items()},
        }


@dataclass(frozen=True, slots=True)
class ChainContrast:
    """Comparison of two runs on the CALVIN chains that both contain.

    Attributes:
        chains: Number of chains that are in both runs.
        p_values: p-values of exact McNemar tests for the five rates, with Holm's correction for five tests.
        difference: Average length in the first run minus average length in the second run, divided by 5. Its interval
            is computed by a paired bootstrap.
    """

    chains: int
    p_values: tuple[float, ...]
    difference: Difference


def summarize(results: Sequence[ChainResult]) -> ChainSummary:
    """Summarize the results of a run on CALVIN chains.

    Raises:
        InvalidInputError: If there is no chain, if a chain occurs twice, or if a result contains subtasks other than
            those of its chain.
    """
    _check(results)
    n = len(results)
    lengths = [result.length for result in results]
    begun: dict[str, list[bool]] = {}
    for result in results:
        for subtask in result.played:
            begun.setdefault(subtask.name, []).append(subtask.success)
    return ChainSummary(
        n,
        tuple(Rate(sum(length >= k for length in lengths), n) for k in range(1, CHAIN_LENGTH + 1)),
        _mean_length(results),
        {name: Rate(sum(begun[name]), len(begun[name])) for name in sorted(begun)},
    )


def contrast(first: Sequence[ChainResult], second: Sequence[ChainResult]) -> ChainContrast:
    """Compare two runs on the chains that both contain.

    Raises:
        InvalidInputError: If the runs have no chain in common, or if :func:`summarize` would reject one of them.
    """
    _check(first)
    _check(second)
    other = {result.number: result for result in second}
    pairs = [(result, other[result.number]) for result in first if result.number in other]
    if not pairs:
        raise InvalidInputError(
            "chains", "the two runs have no chain in common", "Run both policies on the same chains"
        )
    tables = [
        PairedTable.from_outcomes((a.length >= k, b.length >= k) for a, b in pairs) for k in range(1, CHAIN_LENGTH + 1)
    ]
    return ChainContrast(len(pairs), tuple(holm([mcnemar_p(table) for table in tables])), _difference(pairs))


def _check(results: Sequence[ChainResult]) -> None:
    if not results:
        raise InvalidInputError("chains", "there is no chain", "Run at least one chain")
    every = calvin_chains()
    seen: set[int] = set()
    for result in results:
        where = f"chain {result.number}"
        if not 0 <= result.number < len(every) or result.number in seen:
            problem = "occurs twice" if result.number in seen else (f"is not one of the {len(every)} chains")
            raise InvalidInputError(where, problem, "List each chain once, by its index (starting at 0)")
        seen.add(result.number)
        if not result.played:
            continue
        names = tuple(subtask.name for subtask in result.played)
        if names != every[result.number].names[: len(names)]:
            raise InvalidInputError(
                where, f"expected the subtasks {', '.join(every[result.number].names)}", "Run these subtasks"
            )
        ended = len(names) == CHAIN_LENGTH or not result.played[-1].success
        if not ended or not all(subtask.success for subtask in result.played[:-1]):
            raise InvalidInputError(
                where,
                "does not end at the first failed subtask",
                "Continue the chain until a subtask fails or all are done",
            )


def _mean_length(results: Sequence[ChainResult]) -> MeanLength:
    """Return the average length with its interval.

    If all chains have the same length, Wilson's interval for n out of n is used.
    """
    empty = [ChainResult(result.number, ()) for result in results]
    found = _difference(list(zip(results, empty, strict=True)))
    mean = sum(result.length for result in results) / len(results)
    low, high = CHAIN_LENGTH * found.low, CHAIN_LENGTH * found.high
    if len({result.length for result in results}) == 1:
        slack = CHAIN_LENGTH * (1.0 - wilson_interval(len(results), len(results)).low)
        low, high = max(0.0, mean - slack), min(float(CHAIN_LENGTH), mean + slack)
    return MeanLength(mean, low, high)


def _difference(pairs: Sequence[tuple[ChainResult, ChainResult]]) -> Difference:
    """Return the mean difference in length, divided by 5, with its interval.

    In the bootstrap, chains with the same start are resampled together.
    """
    every = calvin_chains()
    ordered = sorted(pairs, key=lambda pair: pair[0].number)
    return paired_bootstrap(
        [a.length / CHAIN_LENGTH for a, _ in ordered],
        [b.length / CHAIN_LENGTH for _, b in ordered],
        generator=np.random.default_rng(_SEED),
        clusters=[str(dict(every[a.number].start)) for a, _ in ordered],
    )
