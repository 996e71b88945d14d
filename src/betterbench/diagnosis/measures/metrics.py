"""Metrics of a run, with their counts and uncertainty."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from betterbench.diagnosis.instruction_effect import instruction_effects
from betterbench.diagnosis.until_decided import UntilDecided
from betterbench.diagnosis.verdict import Metric, TrialDiagnosis
from betterbench.statistics import (
    Difference,
    PairedTable,
    Rate,
    anytime_interval,
    delta_success_rate,
    evidence_above,
    exchange_p,
    holm,
    mcnemar_p,
    paired_bootstrap,
    wider_paired_difference,
)
from betterbench.statistics.betting import SIGNED
from betterbench.tasks import Axis, stream
from betterbench.tasks.labels import Kind
from betterbench.tasks.worlds.libero_plus import AXES as PLUS_AXES
from betterbench.tasks.worlds.libero_plus import axis_of

Trials = Sequence[TrialDiagnosis]

ANYTIME = "anytime-valid"
"""Name of the method for confidence intervals that remain valid at any stopping time."""

_Rates = tuple[tuple[str, Callable[[TrialDiagnosis], bool]], ...]

_RATES: _Rates = (
    ("success_rate", lambda t: t.success),
    ("success_with_a_needless_step", lambda t: t.success and bool(t.needless)),
    ("intention_accuracy", lambda t: bool(t.intention_correct)),
    ("reasoning_failure_rate", lambda t: t.kind is Kind.REASONING),
    ("execution_failure_rate", lambda t: t.kind is Kind.EXECUTION),
    ("system_failure_rate", lambda t: t.kind is Kind.SYSTEM),
    ("collision_rate", lambda t: bool(t.collisions)),
)
"""Rates over planned trials. Each has a name and a function that returns whether a trial counts toward the rate.

A trial without a record stays in the denominator, but counts neither as a success nor as a correct intention. A success
has a needless step if the policy also executed a step that was usual in training but was not requested, such as a grasp
at a slot that is now empty. The collision rate counts collisions with fixtures, which do not rule out success.
"""

OF_CAUSES = frozenset(
    {
        *("success_with_a_needless_step", "intention_accuracy", "reasoning_failure_rate", "execution_failure_rate"),
        *("collision_rate", "distractor_grasp_rate", "instruction_effect"),
    }
)
"""Metrics that are unknown if only the outcome of each trial is judged."""

_UNFINISHED: _Rates = (("unfinished_rate", lambda t: t.kind is Kind.UNFINISHED),)
"""Rate of the trials that a stopped run left unfinished. This rate is reported separately."""


def compute_metrics(trials: Trials, decided: UntilDecided | None = None) -> tuple[Metric, ...]:
    """Return all metrics of a run.

    Args:
        trials: The trials of the run.
        decided: Decisions of a run with ``--until-decided``, or None for other runs. In such a run, the intervals of
            metrics of one condition are valid at any stopping time, and metrics over several conditions use only the
            seeds of the first round.

    Returns:
        The rates, the distractor grasp rate and the progress, each for the whole run and for each task, axis and
        condition. They are followed by the instruction effects, the ΔSR of recompositions (change in success rate), and
        the illusion gaps. Each gap comes with two success rates, one for the training twins (training trials with the
        same seeds) and one for the variations in the same pairs. Ambiguous trials are not part of any metric.
    """
    trials = [t for t in trials if not t.ambiguous]
    even = trials if decided is None else [t for t in trials if t.seed in decided.first_seeds]
    rates = (*_RATES, *_UNFINISHED) if any(t.kind is Kind.UNFINISHED for t in trials) else _RATES
    metrics: list[Metric] = []
    for scope, members in scopes(trials):
        one_condition = "/" in scope and not scope.endswith("/training")
        if decided is not None and one_condition:
            metrics += _anytime(scope, members, rates)
            continue
        kept = members if decided is None else [t for t in members if t.seed in decided.first_seeds]
        metrics += [Metric.of_rate(n, scope, Rate(sum(map(f, kept)), len(kept))) for n, f in rates]
        metrics.append(_distractor_grasp_rate(scope, kept))
        metrics.append(_progress(scope, kept))
    metrics += instruction_effects(even)
    metrics += _delta_success_rates(even)
    metrics += _illusion_gaps(even, trials if decided is not None else None)
    return tuple(metrics)


def _anytime(scope: str, trials: Trials, rates: _Rates) -> Iterator[Metric]:
    """Yield the rates, the distractor grasp rate and the progress of one condition.

    Their confidence intervals are valid at any stopping time.
    """
    results = [a.result for t in trials for a in t.attempts if a.result != "null"]
    counted = [(name, [shows(t) for t in trials]) for name, shows in rates]
    counted.append(("distractor_grasp_rate", [result == "distractor" for result in results]))
    for name, seen in counted:
        ends = anytime_interval(map(float, seen))
        value = sum(seen) / len(seen) if seen else None
        yield Metric(name, scope, sum(seen), len(seen), value, *ends, method=ANYTIME)
    progress = [t.progress for t in trials]
    mean = sum(progress) / len(progress)
    yield Metric("progress", scope, None, len(progress), mean, *anytime_interval(progress), method=ANYTIME)


def scopes(trials: Trials) -> Iterator[tuple[str, Trials]]:
    """Yield each scope for which metrics are computed, together with its trials.

    A scope is the whole run, an axis, a task or a condition (see :class:`~betterbench.diagnosis.Metric`).
    """
    varied = [t for t in trials if t.variation is not None]
    yield "overall", varied
    yield "training", [t for t in trials if t.variation is None]
    for axis in (*(axis.value for axis in Axis), *PLUS_AXES):
        members = [t for t in varied if t.axis == axis]
        if members:
            yield f"axis:{axis}", members
    for task in sorted({t.task for t in trials}):
        mine = [t for t in trials if t.task == task]
        if any(t.variation is not None for t in mine):
            yield task, [t for t in mine if t.variation is not None]
        if any(t.variation is None for t in mine):
            yield f"{task}/training", [t for t in mine if t.variation is None]
        for name in sorted({t.pool for t in mine}):
            yield f"{task}/{name}", [t for t in mine if t.pool == name]


def twins(trials: Trials) -> list[tuple[TrialDiagnosis, TrialDiagnosis]]:
    """Return pairs of a counterfactual twin (the training trial with the same seed) and its variation trial.

    Pairs with an unfinished or missing trial are left out.
    """
    ended = [t for t in trials if t.kind is not Kind.UNFINISHED]
    by_key = {t.key: t for t in ended if t.variation is None}
    return [(by_key[t.twin_key], t) for t in ended if t.twin_key is not None and t.twin_key in by_key]


def _distractor_grasp_rate(scope: str, trials: Trials) -> Metric:
    results = [a.result for t in trials for a in t.attempts if a.result != "null"]
    return Metric.of_rate("distractor_grasp_rate", scope, Rate(results.count("distractor"), len(results)))


def _progress(scope: str, trials: Trials) -> Metric:
    values = [t.progress for t in trials]
    generator = stream("diagnosis", 0, f"bootstrap:progress:{scope}")
    mean = paired_bootstrap(values, [0.0] * len(values), generator=generator)
    low, high = (max(0.0, mean.low), mean.high)
    return Metric("progress", scope, None, len(values), mean.value, low, high, method="bootstrap")


def _delta_success_rates(trials: Trials) -> list[Metric]:
    """Return ΔSR of each recomposition: its success rate minus the mean success rate of the training compositions."""
    metrics = []
    for task in sorted({t.task for t in trials}):
        mine = [t for t in trials if t.task == task]
        novel = [t for t in mine if t.axis == Axis.PRIMITIVE_RECOMPOSITION.value]
        names = sorted({t.condition for t in mine if t.variation is None})
        seen = [_success_rate([t for t in mine if t.variation is None and t.condition == name]) for name in names]
        if not seen or not novel:
            continue
        groups = {f"{task}/{t.variation}": [u for u in novel if u.variation == t.variation] for t in novel}
        for scope, members in [(task, novel), *sorted(groups.items())]:
            found = delta_success_rate(_success_rate(members), seen)
            metrics.append(_of_difference("delta_sr", scope, len(members), found))
    return metrics


def _success_rate(trials: Trials) -> Rate:
    return Rate(sum(t.success for t in trials), len(trials))


def _illusion_gaps(trials: Trials, stopped: Trials | None) -> list[Metric]:
    """Return the illusion gaps: success rates of the training twins minus success rates of the variations.

    The p-values are corrected by Holm's method, separately for the gap over the whole run, the gaps per axis, the gaps
    per task and the gaps per condition.

    Args:
        trials: The trials for computing the gaps.
        stopped: All trials of a run with ``--until-decided``, which are used for the gaps of single variations. None
            for other runs.
    """
    pairs = twins(trials)
    if not pairs:
        return []
    families: list[dict[str, list[tuple[TrialDiagnosis, TrialDiagnosis]]]] = [{"overall": pairs}, {}, {}, {}]
    for twin, trial in pairs:
        keys = (f"axis:{trial.axis}", trial.task)
        for family, key in zip(families[1:3], keys, strict=True):
            family.setdefault(key, []).append((twin, trial))
    for twin, trial in pairs if stopped is None else twins(stopped):
        families[3].setdefault(f"{trial.task}/{trial.pool}", []).append((twin, trial))
    metrics: list[Metric] = []
    test = "exact exchange of twins" if all(axis_of(trial.variation) for _, trial in pairs) else "exact McNemar"
    for family in families:
        anytime = stopped is not None and family is families[3]
        gap = _anytime_gap if anytime else _gap
        found = [gap(scope, members) for scope, members in sorted(family.items())]
        for scope, members in sorted(family.items()):
            metrics += _sides(scope, members, anytime=anytime)
        corrected = holm([m.p_value for m in found if m.p_value is not None])
        note = f", Holm over {len(found)}" if len(found) > 1 else ""
        method = f"{ANYTIME}, one-sided bet" if anytime else f"paired bootstrap or Newcombe, the wider; {test}"
        metrics += [replace(m, p_value=p, method=method + note) for m, p in zip(found, corrected, strict=True)]
    return metrics


def _sides(scope: str, pairs: Sequence[tuple[TrialDiagnosis, TrialDiagnosis]], *, anytime: bool) -> Iterator[Metric]:
    """Yield the success rates of the training twins and of the variations over the pairs of an illusion gap.

    A twin of several variations is counted once for each of its pairs. The confidence interval therefore uses Kish's
    effective number of independent pairs: the square of the number of pairs, divided by the sum over all twins of the
    square of their number of pairs.
    """
    uses = Counter(twin.key for twin, _ in pairs)
    worth = len(pairs) ** 2 / sum(count**2 for count in uses.values())
    for name, side in (("twin_success_rate", 0), ("paired_success_rate", 1)):
        solved = [pair[side].success for pair in pairs]
        k, n = sum(solved), len(solved)
        if anytime:
            ends = anytime_interval(map(float, solved))
            yield Metric(name, scope, k, n, k / n, *ends, method=ANYTIME)
        elif side == 0 and len(uses) < n:
            size = max(1, int(worth))
            found = Rate(round(k / n * size), size)
            low, high = min(found.low, k / n), max(found.high, k / n)
            yield Metric(name, scope, k, n, k / n, low, high, method=f"wilson of {size} effective pairs")
        else:
            yield Metric.of_rate(name, scope, Rate(k, n))


def _anytime_gap(scope: str, pairs: Sequence[tuple[TrialDiagnosis, TrialDiagnosis]]) -> Metric:
    values = [float(twin.success) - float(trial.success) for twin, trial in pairs]
    p = min(1.0, 1.0 / evidence_above(values, 0.0, span=SIGNED))
    ends = anytime_interval(values, span=SIGNED)
    return Metric("illusion_gap", scope, None, len(pairs), sum(values) / len(values), *ends, p_value=p)


def _gap(scope: str, pairs: Sequence[tuple[TrialDiagnosis, TrialDiagnosis]]) -> Metric:
    outcomes = [(twin.success, trial.success) for twin, trial in pairs]
    names = [twin.key for twin, _ in pairs]
    # The variants of a LIBERO-Plus task share a few training twins, so whole tasks are resampled.
    once = all(axis_of(trial.variation) for _, trial in pairs)
    difference = wider_paired_difference(
        outcomes,
        generator=stream("diagnosis", 0, f"bootstrap:illusion_gap:{scope}"),
        strata=["" if once else trial.task for _, trial in pairs],
        clusters=names,
    )
    p = exchange_p(outcomes, names) if once else mcnemar_p(PairedTable.from_outcomes(outcomes))
    return replace(_of_difference("illusion_gap", scope, len(pairs), difference), p_value=p)


def _of_difference(name: str, scope: str, n: int, found: Difference) -> Metric:
    return Metric(name, scope, None, n, found.value, found.low, found.high, method=found.method)
