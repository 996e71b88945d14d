"""The fruit basket of the SO-101: its cells, its cloths, its robot, and trials that no rate counts."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from tests.looping import each

sys.path.insert(0, str(Path(__file__).parents[1] / "report"))

from factory import diagnosis, trial

from betterbench.diagnosis import Label
from betterbench.diagnosis.measures.metrics import compute_metrics
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.evaluation import make_plan
from betterbench.report.tables.matrices import matrices_of, plain_matrix
from betterbench.sim.scenes.appearance import room_of
from betterbench.sim.scenes.rooms import ROOMS, with_cloth
from betterbench.tasks import Expected, get_task, suite_tasks
from betterbench.tasks.authoring.condition_matrix import ConditionMatrix, Horizon, State
from betterbench.tasks.authoring.registry import suite_of
from betterbench.tasks.interventions.resolve import resolve_condition
from betterbench.tasks.labels import Kind

TASK = get_task("fruit_basket")
SHORT, LONG = TASK.matrices
CELLS = [(matrix, cell) for matrix in TASK.matrices for cell in matrix.cells]


def state_of(condition, name: str) -> State:
    if name in condition.preplaced:
        return State.TARGET
    return State.TABLE if name in condition.layout else State.ABSENT


def test_it_has_a_suite_of_its_own() -> None:
    assert suite_of("fruit_basket") == "real_world"
    assert suite_tasks("real_world") == ("fruit_basket",)
    assert "fruit_basket" not in suite_tasks("better60")
    assert suite_of("nothing") is None


@each("matrix, cell", CELLS)
def test_the_conditions_of_a_cell_have_its_states(matrix, cell) -> None:
    for name in cell.conditions:
        condition = resolve_condition("fruit_basket", name).condition
        assert state_of(condition, "lemon") is cell.row
        assert state_of(condition, "mangosteen") is cell.column
        assert {"block", "soap_bar"} <= condition.layout.keys()
        assert condition.cloth == ("blue" if matrix is SHORT else "green")
        assert ("lemon" in condition.instruction.text) is (matrix is SHORT)


def test_expected_behavior_follows_from_what_is_left_to_pack() -> None:
    for matrix, cell in CELLS:
        states = [cell.row] if matrix is SHORT else [cell.row, cell.column]
        expected = (
            Expected.SUCCEED
            if State.TABLE in states
            else Expected.STAY_STILL
            if State.TARGET in states
            else Expected.AMBIGUOUS
        )
        for name in cell.conditions:
            condition = resolve_condition("fruit_basket", name).condition
            assert condition.expected is expected, name
            assert condition.premise_broken is (expected is Expected.AMBIGUOUS), name


def test_cells_are_exactly_the_trained_conditions_and_the_variations_of_two_axes() -> None:
    named = {name for _, cell in CELLS for name in cell.conditions}
    known = {c.name for c in TASK.training} | {v.name for v in TASK.variations}
    assert known - named == {"L1", "L2"}
    assert not named - known


def test_a_matrix_names_each_pair_and_each_condition_once() -> None:
    with pytest.raises(InvalidInputError, match="8 cells that do not match the nine pairs"):
        replace(SHORT, cells=SHORT.cells[:-1])
    doubled = (replace(LONG.cells[0], conditions=("O1",)), replace(LONG.cells[1], conditions=("O1",)), *LONG.cells[2:])
    with pytest.raises(InvalidInputError, match="'O1' is in two cells"):
        ConditionMatrix(Horizon.LONG, "lemon", "mangosteen", doubled)


def test_a_cloth_changes_the_table_top_and_nothing_else() -> None:
    room = room_of("fruit_basket", 3)
    blue, green = with_cloth(room, "blue"), with_cloth(room, "green")
    assert blue.table != green.table
    assert replace(blue, name="", table=room.table, surface="") == replace(room, name="", surface="")
    assert with_cloth(room, None) is room
    with pytest.raises(UnknownNameError, match="Did you mean 'green'"):
        with_cloth(ROOMS[0], "gren")


def test_twins_have_the_same_cloth() -> None:
    for variation in TASK.variations:
        test = resolve_condition("fruit_basket", variation.name).condition
        assert test.cloth == TASK.train(variation.base).cloth


def test_conditions_without_a_cloth_keep_their_form() -> None:
    assert "cloth" not in resolve_condition("fruit_lunch", "train1").condition.to_json()
    assert TASK.training[0].to_json()["cloth"] == "blue"


def test_a_run_takes_the_robot_of_its_task_and_refuses_another() -> None:
    plan = make_plan("expert", tasks=["fruit_basket"], trials=1)
    assert plan.robot == "so101"
    message = "fruit_basket is made for robot 'so101', but the run uses 'panda'"
    with pytest.raises(InvalidInputError, match=message):
        replace(plan, robot="panda")
    with pytest.raises(InvalidInputError, match="fast_food is made for robot 'panda', but the run uses 'so101'"):
        make_plan("expert", tasks=["fruit_basket", "fast_food"], trials=1)


def run_of(outcomes: dict[str, list[Label]]):
    trials = []
    for name, labels in outcomes.items():
        setting = resolve_condition("fruit_basket", name)
        varied = setting.variation is not None
        trials += [
            trial(
                "fruit_basket",
                name if varied else None,
                setting.base,
                seed,
                label=label,
                axis=setting.axis,
                expected=setting.condition.expected.value,
            )
            for seed, label in enumerate(labels)
        ]
    return diagnosis(trials)


def test_both_matrices_are_filled_from_a_run() -> None:
    run = run_of(
        {
            "train1": [Label.SUCCESS] * 2,
            "train2": [Label.SUCCESS],
            "O5": [Label.CORRECT_REFUSAL, Label.SEMANTIC_FEATURE_COLLAPSE],
            "O6": [Label.BEHAVIORAL_INERTIA] * 3,
            "T5": [Label.PHASE_CONFLICT, Label.SUCCESS],
            "L1": [Label.EXECUTION_FAILURE],
        }
    )
    short, long = matrices_of(run)
    assert short.cell(State.TABLE, State.TABLE).labels == ((Label.SUCCESS, 3),)
    assert dict(short.cell(State.ABSENT, State.ABSENT).labels) == {
        Label.CORRECT_REFUSAL: 1,
        Label.SEMANTIC_FEATURE_COLLAPSE: 1,
    }
    assert short.cell(State.ABSENT, State.ABSENT).ambiguous
    assert plain_matrix([short]).rows[8][3:8] == (None, 2, None, None, None)
    assert not long.cell(State.TABLE, State.ABSENT).ambiguous
    inertia = long.cell(State.TABLE, State.ABSENT)
    assert inertia.labels == ((Label.BEHAVIORAL_INERTIA, 3),)
    assert inertia.paper.startswith("behavioral inertia")
    assert dict(long.cell(State.TARGET, State.TABLE).labels) == {Label.PHASE_CONFLICT: 1, Label.SUCCESS: 1}
    assert sum(c.success.n for m in (short, long) for row in m.cells for c in row) == 10


def test_ambiguous_trials_are_shown_and_counted_in_no_rate() -> None:
    run = run_of({"O5": [Label.SEMANTIC_FEATURE_COLLAPSE] * 4, "O1": [Label.SUCCESS] * 2})
    assert len(run.trials) == 6
    assert all(t.label.kind is Kind.REASONING for t in run.trials if t.variation == "O5")
    assert {t.variation for t in run.even_trials} == {"O1"}
    overall = {m.name: m for m in compute_metrics(run.trials) if m.scope == "overall"}
    assert (overall["success_rate"].k, overall["success_rate"].n) == (2, 2)
    assert overall["reasoning_failure_rate"].k == 0
