"""Illusion gaps across simulated worlds. An illusion gap is the drop of a policy's success when the scene is changed.

A gap is measured on pairs of trials or chains, one in the base suite and one in the changed suite. In LIBERO-PRO, the
two trials of a pair have the same initial-state index, but the initial states themselves differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from betterbench.comparison.across.suite_runs import OURS, InitialState, SuiteRun
from betterbench.diagnosis import diagnose_run
from betterbench.statistics import Difference, PairedTable, Rate, exchange_p, holm, mcnemar_p, wider_paired_difference
from betterbench.tasks import stream
from betterbench.tasks.worlds.calvin import contrast, summarize
from betterbench.tasks.worlds.calvin.sequences import CHAIN_LENGTH
from betterbench.tasks.worlds.libero import PLUS_SUITES
from betterbench.tasks.worlds.libero_plus import AXES, axis_of


@dataclass(frozen=True, slots=True)
class WorldGap:
    """Illusion gap of one policy in one world, i.e. the drop of its success when the scene is changed.

    Attributes:
        policy: Name of the policy.
        world: "better60", "LIBERO-PRO", "LIBERO-Plus" or "CALVIN".
        suite: Base suite, i.e. the suite with unchanged scenes.
        change: Name of the change ("swap", "resampled"), axis of LIBERO-Plus, or "all variations" in betterbench's own
            suite.
        base: Success rate without the change. For CALVIN, this is the mean fraction of the subtasks of a chain that are
            solved before the first failure.
        changed: The same rate in the changed scenes.
        pairs: Number of pairs. A pair is a trial in the unchanged scene and a trial in the changed scene.
        difference: ``base - changed`` as a fraction, with its confidence interval.
        p_value: p-value of the paired test, after Holm's correction over the gaps of the policy. None for the average
            length of CALVIN chains, where only an interval is computed.
    """

    policy: str
    world: str
    suite: str
    change: str
    base: float
    changed: float
    pairs: int
    difference: Difference
    p_value: float | None

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {**asdict(self), "difference": self.difference.to_json()}


def gaps_of(runs: Sequence[SuiteRun], *, alpha: float = 0.05, allow_mixed: bool = False) -> tuple[WorldGap, ...]:
    """Return all gaps that can be computed from the runs of each policy, in run order.

    A gap in LIBERO-PRO needs a run of the base suite and a run of the changed suite. A gap in CALVIN needs the official
    chains and the resampled chains. The gap in betterbench's own suite is taken from the diagnosis of the run.

    Raises:
        RecordError: If a run of betterbench's own suite cannot be read.
        RunConflictError: If a run of betterbench's own suite mixes versions and ``allow_mixed`` is False.
    """
    by = {(run.policy, run.suite): run for run in runs}
    found: list[WorldGap] = []
    for run in runs:
        base = by.get((run.policy, run.base))
        if run.suite == OURS:
            found += _of_ours(run, allow_mixed=allow_mixed)
        elif run.change is not None and base is not None:
            gaps = _of_chains if run.chains else _of_plus if run.suite in PLUS_SUITES else _of_libero
            found += gaps(base, run, alpha)
    return tuple(_corrected(found))


def _of_libero(base: SuiteRun, run: SuiteRun, alpha: float) -> list[WorldGap]:
    keys = sorted(base.successes.keys() & run.successes.keys())
    if not keys:
        return []
    outcomes = [(base.successes[key], run.successes[key]) for key in keys]
    difference = wider_paired_difference(
        outcomes,
        generator=stream("across", 0, f"bootstrap:gap:{run.suite}"),
        strata=[task for task, _ in keys],
        clusters=[str(key) for key in keys],
        confidence=1.0 - alpha,
    )
    n = len(keys)
    before, after = Rate(sum(a for a, _ in outcomes), n), Rate(sum(b for _, b in outcomes), n)
    p = mcnemar_p(PairedTable.from_outcomes(outcomes))
    return [
        WorldGap(
            run.policy, "LIBERO-PRO", run.base, str(run.change), before.value or 0.0, after.value or 0.0, n,
            difference, p,
        )
    ]  # fmt: skip


def _of_plus(base: SuiteRun, run: SuiteRun, alpha: float) -> list[WorldGap]:
    """Return the illusion gap for each axis of LIBERO-Plus, i.e. for each kind of change.

    All variants of a task are paired with the same trial of the base suite.
    """
    pairs: dict[str, list[tuple[InitialState, bool]]] = {}
    for (name, seed), success in sorted(run.successes.items()):
        task, _, condition = name.partition("/")
        if (task, seed) in base.successes:
            pairs.setdefault(str(axis_of(condition)), []).append(((task, seed), success))
    gaps = []
    for axis in (axis for axis in AXES if axis in pairs):
        outcomes = [(base.successes[key], success) for key, success in pairs[axis]]
        shared = [str(key) for key, _ in pairs[axis]]
        difference = wider_paired_difference(
            outcomes,
            generator=stream("across", 0, f"bootstrap:gap:{run.suite}:{axis}"),
            strata=[""] * len(outcomes),
            clusters=shared,
            confidence=1.0 - alpha,
        )
        n = len(outcomes)
        before, after = Rate(sum(a for a, _ in outcomes), n), Rate(sum(b for _, b in outcomes), n)
        gaps.append(
            WorldGap(
                run.policy, "LIBERO-Plus", run.base, axis, before.value or 0.0, after.value or 0.0, n, difference,
                exchange_p(outcomes, shared),
            )
        )  # fmt: skip
    return gaps


def _of_chains(base: SuiteRun, run: SuiteRun, alpha: float) -> list[WorldGap]:
    del alpha  # not used, because chains are always compared with 95 % intervals
    shared = {c.number for c in base.chains} & {c.number for c in run.chains}
    if not shared:
        return []
    first = [c for c in base.chains if c.number in shared]
    second = [c for c in run.chains if c.number in shared]
    told = contrast(first, second)
    before, after = (summarize(chains).length.value / CHAIN_LENGTH for chains in (first, second))
    return [
        WorldGap(run.policy, "CALVIN", run.base, str(run.change), before, after, len(shared), told.difference, None)
    ]


def _of_ours(run: SuiteRun, *, allow_mixed: bool) -> list[WorldGap]:
    diagnosis = diagnose_run(run.path, allow_mixed=allow_mixed, whole=True)
    metrics = {(m.name, m.scope): m for m in diagnosis.metrics}
    gap, twins, changed = (
        metrics.get((name, "overall")) for name in ("illusion_gap", "twin_success_rate", "paired_success_rate")
    )
    if gap is None or twins is None or changed is None or None in (gap.value, twins.value, changed.value):
        return []
    difference = Difference(gap.value or 0.0, gap.low or 0.0, gap.high or 0.0, gap.method, 0.95)
    rates = (twins.value or 0.0, changed.value or 0.0)
    return [WorldGap(run.policy, OURS, OURS, "all variations", *rates, gap.n, difference, gap.p_value)]


def _corrected(gaps: Sequence[WorldGap]) -> list[WorldGap]:
    """Correct the p-values of the gaps by Holm's method, separately for each policy, and return the gaps."""
    result = list(gaps)
    for policy in dict.fromkeys(gap.policy for gap in gaps):
        tested = [(i, g.p_value) for i, g in enumerate(result) if g.policy == policy and g.p_value is not None]
        for (i, _), p in zip(tested, holm([p for _, p in tested]), strict=True):
            result[i] = replace(result[i], p_value=p)
    return result
