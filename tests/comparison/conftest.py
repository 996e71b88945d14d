"""Diagnoses written down trial by trial, so that a comparison can be worked out by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import pytest

from betterbench.comparison import Side
from betterbench.diagnosis import Evidence, Label, RunDiagnosis, TrialDiagnosis
from betterbench.diagnosis.measures.metrics import compute_metrics
from betterbench.tasks import get_task

SHORTCUT, MISSED = Label.LEXICAL_KINEMATIC_SHORTCUT, Label.EXECUTION_FAILURE
CONVENTIONS = {"suite_version": "1.0", "engine:mujoco": "3.17.0", "task_version:fast_food": "1", "package_version": "1"}


def trial(task: str, name: str, seed: int, label: Label, policy: str) -> TrialDiagnosis:
    known = next((v for v in get_task(task).variations if v.name == name), None)
    lost = label is Label.POLICY_ERROR
    return TrialDiagnosis(
        task=task, variation=None if known is None else name, condition=name if known is None else known.base,
        axis=None if known is None else known.axis.value, seed=seed, policy=policy, instruction="Put it there.",
        success=label is Label.SUCCESS, expected="succeed", label=label, first_attempt=None,
        first_attempt_kind=None, first_slot=None,
        intended=None, intended_kind=None, intended_any=(),
        intention_correct=None, progress=float(label is Label.SUCCESS), attempts=(),
        evidence=Evidence("no_record" if lost else label.value, "So it is.", 1.0, 2.0), collisions=None, steps=100,
        duration_s=5.0, record=None if lost else f"records/{task}/{name}/{seed}.parquet",
    )  # fmt: skip


def side_of(
    policy: str,
    failures: Mapping[tuple[str, str], Mapping[int, Label]],
    *,
    conditions: tuple[tuple[str, str], ...] = (("fast_food", "train1"), ("fast_food", "L1"), ("fast_food", "R1")),
    seeds: range = range(20),
    **changes: object,
) -> Side:
    """Returns a side that succeeds in every trial but the ones named: (task, condition) to seed to label."""
    trials = tuple(
        trial(task, name, seed, failures.get((task, name), {}).get(seed, Label.SUCCESS), policy)
        for task, name in conditions
        for seed in seeds
    )
    found = RunDiagnosis(policy, trials, compute_metrics(trials), (), (), {}, {})
    return replace(Side(policy, found, f"runs/{policy}", frozenset(), dict(CONVENTIONS)), **changes)  # type: ignore[arg-type]


@pytest.fixture
def side() -> Callable[..., Side]:
    return side_of


def failing(label: Label, *seeds: int) -> dict[int, Label]:
    return dict.fromkeys(seeds, label)


@pytest.fixture
def two() -> tuple[Side, Side]:
    """One policy that is right but for a trial, and one with a shortcut in 12 of 20 trials of L1."""
    good = side_of("good", {("fast_food", "R1"): failing(MISSED, 3)})
    bad = side_of("bad", {("fast_food", "L1"): failing(SHORTCUT, *range(12)), ("fast_food", "train1"): {0: MISSED}})
    return good, bad
