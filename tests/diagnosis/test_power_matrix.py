"""The power matrix: read back, judged by its counts, and silent about tasks that have changed since."""

from __future__ import annotations

import dataclasses

import pytest
from tests.diagnosis.small_matrix import L1, LEXICAL, R1, T1, failing, matrix, solving

from betterbench.diagnosis.failure_mode import exposed_labels
from betterbench.diagnosis.measures import power_matrix
from betterbench.diagnosis.measures.power_matrix import (
    BLIND,
    PowerCell,
    PowerMatrix,
    packaged_power_matrix,
    task_versions,
)
from betterbench.errors import InvalidInputError, RecordError
from betterbench.statistics import Rate
from betterbench.tasks import Label, get_task


def test_a_rule_fails_where_it_solves_at_most_half():
    assert failing(LEXICAL).fails
    assert PowerCell(3, 6, 0).fails
    assert not PowerCell(4, 6, 0).fails
    assert not PowerCell(0, 0, 0).fails


def test_a_claim_is_backed_by_a_rule_that_fails_with_its_label():
    found = matrix()
    assert found.backed(L1) == {Label.LEXICAL_KINEMATIC_SHORTCUT, Label.EARLY_HALT}
    assert found.backed(R1) == {Label.EARLY_HALT}
    assert found.exposed(L1) == ("zoo:lexical", "zoo:shape", "zoo:halt")


def test_where_only_the_rule_that_fails_everywhere_fails_is_a_control_cell():
    assert not matrix().control(L1)
    assert matrix().control(R1)
    assert not matrix().control(T1), "nothing was measured there"


def test_the_ceiling_is_the_best_of_those_that_are_to_fail():
    ceiling = matrix().ceiling(L1)
    assert ceiling is not None
    assert (ceiling.pretender, ceiling.rate) == ("zoo:shape", Rate(3, 6))
    ceiling = matrix().ceiling(R1)
    assert ceiling is not None
    assert ceiling.rate == Rate(14, 14), "lexical solves R1 too, but R1 is not there to fail it"
    assert matrix().ceiling(T1) is None


def test_a_rule_that_passes_with_a_needless_step_is_not_claimed_to_be_exposed():
    wrongly = PowerCell(6, 6, 3, wrong={LEXICAL: 6})
    found = matrix(zoo_shape={L1: wrongly, R1: solving(shared=6)})
    assert found.exposed(L1) == ("zoo:lexical", "zoo:halt")
    assert found.passing_wrongly(L1) == ("zoo:shape",)
    ceiling = found.ceiling(L1)
    assert ceiling is not None
    assert ceiling.pretender == "probe:no-language"


def test_nothing_that_is_claimed_by_the_suite_passes():
    found = packaged_power_matrix()
    assert found is not None
    for key in found.variations:
        for name in found.exposed(key):
            assert found.cells[name][key].fails, (name, key)
        ceiling = found.ceiling(key)
        assert ceiling is not None
        full = ceiling.rate.k == ceiling.rate.n
        assert not full or (ceiling.pretender == BLIND[0] and found.chances[key] >= 1.0), key


def test_blind_cells_are_tested_raw_and_corrected():
    cells = {(c.pretender, c.variation): c for c in matrix().blind_cells()}
    assert len(cells) == 10
    guessed = cells["probe:no-language", "R1"]
    assert guessed.above
    assert guessed.flagged
    assert guessed.p_value < guessed.p_adjusted < 0.05
    assert guessed.chance == 0.5
    assert cells["probe:replay", "R1"].chance == 0.25
    assert cells["probe:replay", "R1"].flagged
    assert not cells["probe:replay", "L1"].above
    assert not cells["random", "L1"].flagged, "far below chance is not above it"


def test_few_trials_flag_nothing_and_one_instruction_alone_cannot_be_guessed():
    few = matrix(**{"probe_no-language": {L1: PowerCell(2, 2, 2)}})
    assert not [c for c in few.blind_cells() if c.pretender == BLIND[0] and c.flagged]
    alone = dataclasses.replace(matrix(), chances={L1: 1.0, R1: 0.5})
    cell = next(c for c in alone.blind_cells() if (c.pretender, c.variation) == (BLIND[0], "L1"))
    assert cell.speechless
    assert not cell.flagged


def test_doing_nothing_where_nothing_is_to_be_done_is_no_knowledge():
    still = PowerMatrix({"noop": {("morning_coffee", "T1"): solving()}}, {}, {})
    assert still.blind_cells() == ()


def test_the_json_form_reads_back_line_by_line():
    found = matrix()
    text = found.to_text()
    assert PowerMatrix.from_json(text.encode()) == found
    assert text.count("\n") > sum(len(row) for row in found.cells.values())
    assert '"shared"' not in next(line for line in text.splitlines() if "fast_food/L1" in line and "14" in line)


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"versions": {}, "chances": {}, "cells": {"a": {"b/L1": {"k": 1}}}}'],
)
def test_a_spoilt_file_is_one_clear_error(text):
    with pytest.raises(RecordError, match=r"calibrate --power"):
        PowerMatrix.from_json(text.encode())
    with pytest.raises(RecordError, match="is not the name of a variation"):
        PowerMatrix.from_json(b'{"versions": {}, "chances": {}, "cells": {"a": {"L1": {"k": 1, "n": 1, "right": 1}}}}')


def test_a_changed_task_is_stale():
    assert matrix().stale_tasks() == ()
    assert matrix().stale_tasks({"task_version:fast_food": "0"}) == ("fast_food",)
    for name in task_versions(get_task("fast_food")):
        older = dataclasses.replace(matrix(), versions={**matrix().versions, name: "0"})
        assert older.stale_tasks() == ("fast_food",)
    assert matrix().without(["fast_food"]).variations == ()
    unknown = PowerMatrix({"expert": {("no_such_task", "L1"): solving()}}, {}, {})
    assert unknown.stale_tasks() == ("no_such_task",)


def other_task(k: int) -> PowerMatrix:
    """Returns a matrix of one variation of fast_food before its conditions changed, and one of an unchanged task."""
    found = matrix()
    key = ("office_drawer", "L1")
    cells = {name: {L1: PowerCell(k, 6, k), key: PowerCell(k, 6, k)} for name in found.cells}
    versions = {**found.versions, **task_versions(get_task("office_drawer")), "task_version:fast_food": "0"}
    return PowerMatrix(cells, {L1: 0.1, key: 0.5}, versions)


def test_tasks_that_were_measured_again_replace_their_cells_and_no_others():
    earlier, found = other_task(5), matrix()
    joined = found.with_kept(earlier)
    assert joined.variations == (*earlier.variations, R1)
    assert joined.without(["office_drawer"]).cells == found.cells
    assert joined.without(["fast_food"]).cells == earlier.without(["fast_food"]).cells
    assert joined.chances == {**found.chances, ("office_drawer", "L1"): 0.5}
    assert joined.stale_tasks() == ()


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"task_version:office_drawer": "0"}, "office_drawer has changed since it was measured"),
        ({"conditions:office_drawer": "0"}, "office_drawer has changed since it was measured"),
        ({"engine:mujoco": "3.0.0"}, "engine:mujoco was 3.0.0 when the matrix was measured, and is now None"),
    ],
)
def test_cells_of_other_versions_are_not_kept(changed, text):
    earlier = other_task(5)
    with pytest.raises(InvalidInputError, match=text):
        matrix().with_kept(dataclasses.replace(earlier, versions={**earlier.versions, **changed}))


def test_cells_are_not_kept_next_to_those_of_other_pretenders():
    earlier = other_task(5)
    fewer = dataclasses.replace(earlier, cells={n: row for n, row in earlier.cells.items() if n != "zoo:shape"})
    with pytest.raises(InvalidInputError, match="compared policies have changed: zoo:shape"):
        matrix().with_kept(fewer)


def fresh(suite: str = "better60") -> PowerMatrix:
    found = packaged_power_matrix(suite)
    if found is None:
        pytest.skip("this build ships no power matrix; better calibrate --power --write-package measures it")
    stale = found.stale_tasks()
    if stale:
        pytest.skip(f"the packaged power matrix is of another version of {', '.join(stale)}")
    return found


@pytest.mark.parametrize("suite", ["better60", "real_world", "so101"])
def test_every_claim_of_a_card_is_backed_by_the_packaged_matrix(suite):
    found = fresh(suite)
    unbacked = {
        "/".join(key): sorted(set(exposed_labels(*key)) - found.backed(key))
        for key in found.variations
        if set(exposed_labels(*key)) - found.backed(key)
    }
    assert unbacked == {}


def test_the_packaged_matrix_meets_the_targets_of_the_suite():
    found = fresh()
    control = {key for key in found.variations if found.control(key)}
    assert len(found.variations) == 60
    assert len(control) <= 6
    for key in found.variations:
        if key[1][0] in "LO" and key not in control:
            assert {"zoo:lexical", "zoo:layout"} & set(found.failing(key)), key
    replays = [found.cell("probe:replay", key) for key in found.variations]
    assert sum(cell is not None and cell.k <= 0.25 * cell.n for cell in replays) >= 50


def test_the_packaged_matrix_of_the_fruit_basket_has_the_cells_of_the_paper():
    """Inertia fails where the second fruit is absent, and the policy of phase conflict where the first one is done."""
    found = fresh("real_world")
    assert {task for task, _ in found.variations} == {"fruit_basket"}
    assert not found.stale_tasks()
    failed = {name: {key[1] for key in found.variations if name in found.failing(key)} for name in found.pretenders}
    assert failed["zoo:inertia"] == {"O6", "T7"}
    assert failed["zoo:phase"] == {"T5", "T7"}
    long = {"T4", "O6", "T5", "T6", "T7", "O7", "O8"}
    assert all(found.cell("expert", ("fruit_basket", name)).k > 0 for name in long)
    assert {Label.BEHAVIORAL_INERTIA, Label.PHASE_CONFLICT} <= found.backed(("fruit_basket", "T7"))


def test_a_calibration_shows_the_blind_probes_of_its_own_tasks_alone(monkeypatch):
    """The packaged matrix says nothing about a suite without one."""
    monkeypatch.setattr(power_matrix, "power_matrix_of", lambda _tasks: matrix())
    assert power_matrix.measured_on(["tidy_desk"]) is None
    assert power_matrix.measured_on(["fast_food"]) == matrix()
    assert power_matrix.measured_on([]) == matrix()
