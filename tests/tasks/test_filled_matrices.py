"""The two matrices as policies with known faults fill them, cell by cell, against the paper's tables.

The expert is right everywhere. Of the paper's three red cells, ``zoo:inertia`` shows the one that it calls behavioral
inertia (the first fruit is packed, then an air grasp where the second one lay), and ``zoo:phase`` the two that it calls
phase conflict. What else a policy fails follows from its fault: ``zoo:inertia`` begins with the lemon wherever it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

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
    "zoo:inertia": dict.fromkeys(("T1", "T2", "T3", "O6", "T6", "T7", "O8"), INERTIA),
    "zoo:phase": dict.fromkeys(("T4", "T5", "T7"), PHASE),
    "zoo:lexical": dict.fromkeys(("T1", "T2", "T3", "T4", "T6", "T7", "O8"), INERTIA),
}
"""Cells that a policy fails, by their condition, with the label; it is right in all others."""

AIR_GRASPS = {"zoo:inertia": {"T5", "O7", *AMBIGUOUS}, "zoo:lexical": AMBIGUOUS}
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
    ("policy", "failed"), [("zoo:inertia", {"O6": INERTIA}), ("zoo:phase", {"T5": PHASE, "T7": PHASE}), ("expert", {})]
)
def test_the_red_cells_of_the_paper(policy, failed, tmp_path):
    assert labels_of(run_of(policy, {"O6"} if policy != "zoo:phase" else {"T5", "T7"}, tmp_path / "run")) == failed


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
def test_the_top_row_of_the_long_matrix_is_that_of_the_paper(filled):
    long: Matrix = matrices_of(filled)[1]
    inertia = dict(long.cell(State.TABLE, State.ABSENT).labels)
    if filled.policy == "zoo:inertia":
        assert inertia == {INERTIA: 1}
        assert long.cell(State.TABLE, State.ABSENT).paper.startswith("behavioral inertia")
    assert dict(long.cell(State.TABLE, State.TABLE).labels) == {Label.SUCCESS: 1}
