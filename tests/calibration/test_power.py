"""Measuring the power matrix: enough trials, nothing simulated twice, resumed where it stopped."""

from __future__ import annotations

import pytest

from betterbench.calibration import PowerTrials, measure_power, power_trials
from betterbench.calibration.power import GUESS_TRIALS, STILL_TRIALS, trials_to_flag
from betterbench.cli.verbs.calibrate import calibrate_command
from betterbench.diagnosis.measures.power_matrix import BLIND, EXPERT, FLOOR
from betterbench.errors import InvalidInputError
from betterbench.policies.experts.registry import witnessed
from betterbench.statistics import Rate, chance_p
from betterbench.tasks import get_task


@pytest.mark.parametrize("chance", [0.1, 0.25, 0.5, 2 / 3])
def test_the_fewest_trials_that_can_be_flagged_are_counted_out(chance):
    n = trials_to_flag(chance, 290)
    assert 290 * chance_p(Rate(n, n), chance=chance) < 0.05 <= 290 * chance_p(Rate(n - 1, n - 1), chance=chance)


def test_eight_trials_could_not_flag_a_choice_of_two():
    assert trials_to_flag(0.5, 174) > 8
    assert trials_to_flag(0.25, 290) == 7
    assert trials_to_flag(0.5, 290) == 14


def test_every_pretender_is_planned_on_every_variation():
    planned = power_trials()
    assert set(planned.of) == {EXPERT, *witnessed(), *BLIND, *FLOOR}
    assert all(len(row) == 60 for row in planned.of.values())
    assert not {"zoo:clumsy", "zoo:slow", "zoo:crash"} & set(planned.of), "their motion is the fault"
    assert set(planned.of["noop"].values()) == {STILL_TRIALS}
    for key, chance in planned.chances.items():
        flagged_at = trials_to_flag(chance, 290) if 0.25 < chance < 0.9 else 7
        assert planned.of[BLIND[0]][key] == max(GUESS_TRIALS, flagged_at), key
        assert planned.of[BLIND[1]][key] == 7
        assert planned.of[EXPERT][key] >= planned.of[BLIND[0]][key]


def test_the_trials_of_a_task_do_not_depend_on_what_else_is_measured():
    whole, one = power_trials(), power_trials(["fast_food"])
    assert {key: n for key, n in whole.of[BLIND[0]].items() if key[0] == "fast_food"} == one.of[BLIND[0]]
    assert set(one.of[EXPERT]) == {("fast_food", v.name) for v in get_task("fast_food").variations}


@pytest.mark.parametrize("options", [{"policies": ("zoo:halt",)}, {"trials": 3}, {"seed": 1}, {"strengths": (0.5,)}])
def test_options_that_the_matrix_fixes_are_refused(options):
    with pytest.raises(InvalidInputError, match="--power"):
        calibrate_command(power=True, **options)


def test_a_part_of_the_other_calibration_is_not_packaged():
    """Its labels depend on all trials of a policy, and its counts on all policies."""
    with pytest.raises(InvalidInputError, match="--write-package"):
        calibrate_command(tasks=("fast_food",), write_package=True)


@pytest.mark.physics
def test_a_small_matrix_is_measured_shared_and_resumed(tmp_path):
    l1, l3 = ("morning_coffee", "L1"), ("morning_coffee", "L3")
    of = {name: {l1: 1, l3: 1} for name in (EXPERT, "zoo:lexical", "zoo:phase", "probe:replay")}
    planned = PowerTrials(of, {l1: 0.5, l3: 0.5})
    steps = []
    found = measure_power(planned, tmp_path, on_progress=steps.append)
    assert found.cells[EXPERT][l1].k == found.cells[EXPERT][l3].k == 1
    assert found.cells["zoo:lexical"][l1].shared == 1
    assert found.cells["zoo:lexical"][l1].k == 1
    assert found.cells["zoo:lexical"][l3].k == found.cells["zoo:lexical"][l3].right == 0
    assert found.cells["zoo:lexical"][l3].failed == {"lexical_kinematic_shortcut": 1}
    assert found.cells["probe:replay"][l3].k == 0
    assert (tmp_path / "zoo-lexical").exists()
    assert not (tmp_path / "zoo-phase").exists(), "it decides like the expert in both, and is not run"
    assert steps[-1].done == steps[-1].planned == planned.total
    assert found.stale_tasks() == ()
    written = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.parquet")}
    assert measure_power(planned, tmp_path) == found
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.parquet")} == written
