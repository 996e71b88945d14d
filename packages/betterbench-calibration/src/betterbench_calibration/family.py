"""Calibration of the diagnosis on the independent family. Its trials are those in which a habit shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from betterbench.calibration.run import CalibrationProgress, assess, run_plans
from betterbench.diagnosis import Calibration
from betterbench.errors import InvalidInputError
from betterbench.evaluation import Plan, Trial
from betterbench.tasks import stream
from betterbench.tasks.interventions import resolve_condition
from betterbench_calibration.independent import FAMILY_PARTS, INDEPENDENT, IndependentPolicy, Shown, shown_in


def independent_plans(part: str, *, trials: int = 4, seed: int = 0) -> tuple[Plan, ...]:
    """Return one plan per policy in a part of the independent family: each habit in each motion style.

    Args:
        part: One of ``FAMILY_PARTS``: "development", "held_out", "second", and so on.
        trials: Number of trials per policy in which its behavior is wrong, spread over the tasks. For a habit without a
            fault, all trials in which the habit shows count. For a habit whose label needs several trials, complete
            tasks are added until this number is reached.
        seed: First seed. If a habit shows in fewer conditions than ``trials``, the next seeds are also used.

    Raises:
        InvalidInputError: If the part does not exist, or ``trials`` is below 1.
    """
    if part not in FAMILY_PARTS:
        raise InvalidInputError("part", f"{part!r} is unknown", f"Use {' or '.join(FAMILY_PARTS)}")
    if trials < 1:
        raise InvalidInputError("trials", f"{trials} is out of range", "It must be ≥ 1")
    policies = (p for p in INDEPENDENT.values() if p.part == part)
    return tuple(Plan(p.address, _chosen(p, trials, seed), "ee_delta", "state_only", "standard") for p in policies)


def calibrate_independent(
    part: str,
    out: Path,
    *,
    trials: int = 4,
    seed: int = 0,
    workers: int = 1,
    on_progress: Callable[[CalibrationProgress], None] | None = None,
) -> Calibration:
    """Run a part of the independent family, diagnose the records, and compare the labels with the true labels.

    Raises the errors of :func:`independent_plans` and :func:`~betterbench.calibration.run.calibrate`.
    """
    plans = {plan.policy.replace(":", "-"): plan for plan in independent_plans(part, trials=trials, seed=seed)}
    return assess(run_plans(plans, out, workers=workers, on_progress=on_progress))


def _chosen(policy: IndependentPolicy, trials: int, seed: int) -> tuple[Trial, ...]:
    shown = shown_in(policy.habit.name)
    faulty = _spread([s for s in shown if s.faulty], policy, seed)
    if policy.habit.paired:
        tasks: list[str] = []
        for task in dict.fromkeys(s.task for s in faulty):
            if sum(s.task in tasks for s in faulty) < trials:
                tasks.append(task)
        return tuple(_trial(s, seed) for s in shown if s.task in tasks)
    return tuple(_trial(faulty[i % len(faulty)], seed + i // len(faulty)) for i in range(trials))


def _spread(shown: Sequence[Shown], policy: IndependentPolicy, seed: int) -> list[Shown]:
    """Return conditions in random order, alternating between tasks."""
    order = stream("independent", seed, policy.address).permutation(len(shown))
    by_task: dict[str, list[Shown]] = {}
    for i in order.tolist():
        by_task.setdefault(shown[i].task, []).append(shown[i])
    longest = max(map(len, by_task.values()))
    return [of[i] for i in range(longest) for of in by_task.values() if i < len(of)]


def _trial(shown: Shown, seed: int) -> Trial:
    found = resolve_condition(shown.task, shown.condition)
    varied = found.variation
    return Trial(
        shown.task,
        shown.condition,
        None if varied is None else varied.name,
        found.axis,
        None if varied is None else varied.base,
        seed,
        found.condition.expected.value,
    )
