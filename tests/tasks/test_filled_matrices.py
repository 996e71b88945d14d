"""The two matrices as policies with known faults fill them, cell by cell, against the paper's tables.

The expert is right everywhere. In the long matrix, ``zoo:inertia`` shows behavioral inertia where the second fruit is
absent, and ``zoo:phase`` shows phase conflict where the first fruit is in the basket and the second one is not. Both
are right in all other cells, as in the paper.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from tests.daily import others_slow

from betterbench.diagnosis import Label, RunDiagnosis, diagnose_run
from betterbench.evaluation import evaluate, make_plan
from betterbench.report.tables.matrices import Matrix, matrices_of
from betterbench.tasks import Expected, get_task
from betterbench.tasks.authoring.condition_matrix import State
from betterbench.tasks.interventions.resolve import resolve_condition

TASK = get_task("fruit_basket")
CELLS = {cell.conditions[0]: cell for matrix in TASK.matrices for cell in matrix.cells}
"""The first condition of each cell."""

AMBIGUOUS = {name for name in CELLS if resolve_condition(TASK.id, name).condition.expected is Expected.AMBIGUOUS}
INERTIA, PHASE = Label.BEHAVIORAL_INERTIA, Label.PHASE_CONFLICT

FAILED: Mapping[str, Mapping[str, Label]] = {
    "expert": {},
    "zoo:habit-place": {},
    "zoo:inertia": dict.fromkeys(("O6", "T7"), INERTIA),
    "zoo:phase": dict.fromkeys(("T5", "T7"), PHASE),
    "zoo:lexical": dict.fromkeys(("T1", "T2", "T3", "T4", "T6", "T7", "O8"), INERTIA),
}
"""Cells that a policy fails, by their condition, with the label; it is right in all others."""

AIR_GRASPS = dict.fromkeys(("zoo:inertia", "zoo:lexical"), AMBIGUOUS)
"""Cells with an air grasp at the slot of the lemon that is not a failure; the paper's ambiguous cells have one, too."""


def run_of(policy: str, names: set[str], out: Path, seed: int = 0) -> RunDiagnosis:
    """Returns the diagnosis of one trial of each condition."""
    plan = make_plan(policy, tasks=[TASK.id], trials=1, seed=seed, observation="state_only", quality="fast")
    kept = tuple(t for t in plan.trials if t.condition in names and t.seed == seed)
    kept = tuple({t.condition: t for t in kept}.values())
    assert {t.condition for t in kept} == names
    return diagnose_run(evaluate(replace(plan, trials=kept), out, workers=1))


def labels_of(run: RunDiagnosis) -> dict[str, Label]:
    return {t.variation or t.condition: t.label for t in run.counted_trials if not t.success}


@pytest.mark.physics
@pytest.mark.parametrize(
    ("policy", "failed"),
    others_slow(
        [("zoo:inertia", {"O6": INERTIA, "T7": INERTIA}), ("zoo:phase", {"T5": PHASE, "T7": PHASE}), ("expert", {})], 3
    ),
)
def test_the_red_cells_of_the_paper(policy, failed, tmp_path):
    assert labels_of(run_of(policy, {"O6", "T5", "T7"}, tmp_path / "run")) == failed


@pytest.fixture(scope="module", params=FAILED)
def filled(request, tmp_path_factory) -> RunDiagnosis:
    return run_of(request.param, set(CELLS), tmp_path_factory.mktemp("runs") / "run")


@pytest.mark.slow
def test_each_policy_fails_the_cells_of_its_fault(filled):
    assert labels_of(filled) == FAILED[filled.policy]


@pytest.mark.slow
def test_both_matrices_are_full_and_say_what_is_ambiguous(filled):
    cells = [cell for matrix in matrices_of(filled) for row in matrix.cells for cell in row]
    assert len(cells) == 18
    assert not any(cell.empty for cell in cells)
    assert {s.id.partition("/")[2] for cell in cells if cell.ambiguous for s in cell.sources} == AMBIGUOUS
    needless = {s.id.partition("/")[2] for cell in cells for s in cell.sources if s.needless}
    assert needless == AIR_GRASPS.get(filled.policy, set())


@pytest.mark.slow
def test_the_red_cells_of_the_long_matrix_lie_where_the_paper_has_them(filled):
    long: Matrix = matrices_of(filled)[1]
    red = {
        (cell.row, cell.column): dict(cell.labels)
        for row in long.cells
        for cell in row
        if not cell.ambiguous and cell.success.k < cell.success.n
    }
    absent = {(State.TABLE, State.ABSENT), (State.TARGET, State.ABSENT)}
    started = {(State.TARGET, State.TABLE), (State.TARGET, State.ABSENT)}
    if filled.policy == "zoo:inertia":
        assert red == {cell: {INERTIA: 1} for cell in absent}
        assert long.cell(State.TABLE, State.ABSENT).paper.startswith("behavioral inertia")
    elif filled.policy == "zoo:phase":
        assert red == {cell: {PHASE: 1} for cell in started}
        assert all(long.cell(*cell).paper.startswith("phase conflict") for cell in started)
    elif filled.policy != "zoo:lexical":
        assert not red
