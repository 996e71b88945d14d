"""What the variations can tell apart, from decisions alone: every rule is walked through every variation."""

from __future__ import annotations

import functools

import pytest
from tests.calibration.ideal import Walk, walk
from tests.looping import each

from betterbench.diagnosis.failure_mode import exposed_labels
from betterbench.policies.experts.registry import witnessed
from betterbench.tasks import get_task, suite_tasks

pytestmark = pytest.mark.physics

VARIATIONS = [(task, v.name) for task in suite_tasks("better60") for v in get_task(task).variations]
RULES = [name for name in witnessed() if name.startswith("zoo:")]
CONTROL = {("morning_coffee", "L1")}
"""The variations in which word and place agree: every rule but the one that fails everywhere rightly succeeds."""


@functools.cache
def walks(task: str, name: str) -> dict[str, Walk]:
    return {rule: walk(rule, task, name) for rule in RULES}


@each("task, name", VARIATIONS)
def test_right_decisions_solve_every_variation(task, name):
    found = walk("expert", task, name)
    assert found.success, found.why
    assert found.truth is None


@each("task, name", VARIATIONS)
def test_a_card_claims_only_what_some_rule_fails_by(task, name):
    fails = {w.truth for w in walks(task, name).values() if not w.success}
    assert set(exposed_labels(task, name)) <= fails


@each("task, name", VARIATIONS)
def test_only_control_cells_are_failed_by_no_rule_that_acts(task, name):
    failing = {rule for rule, w in walks(task, name).items() if not w.success} - {"zoo:halt"}
    assert bool(failing) == ((task, name) not in CONTROL)


@each("task, name", [v for v in VARIATIONS if v[1][0] in "LO" and v not in CONTROL])
def test_layout_and_object_variations_fail_word_or_favorite_place(task, name):
    found = walks(task, name)
    assert not (found["zoo:lexical"].success and found["zoo:layout"].success)
