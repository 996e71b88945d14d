"""The diverse-confounded regime shows as much as the balanced one, keeps each word at its place, and holds no test."""

from __future__ import annotations

import functools
import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from betterbench.cli.main import main
from betterbench.demonstrations.sets.proof import RegimeBounds
from betterbench.demonstrations.shortcuts.examine import audit_dataset
from betterbench.demonstrations.shortcuts.facts import facts_of_condition
from betterbench.demonstrations.shortcuts.prediction import predict
from betterbench.errors import InvalidInputError
from betterbench.tasks import get_task, suite_tasks
from betterbench.tasks.authoring.training_distribution import pairing
from betterbench.tasks.interventions import resolve_condition
from betterbench.tasks.interventions.listed_regimes import LISTED, crossed_in, listed_conditions, listed_tasks
from betterbench.tasks.interventions.regimes import conditions_of, in_regime

sys.path.insert(0, str(Path(__file__).parents[3] / "tools"))

from learned_page import STUDIES, TIED

REGIME = "diverse-confounded"
TASKS = listed_tasks(REGIME)
CHANGED_SINCE_STUDY = {"dinner_plates": {"T2"}}
"""Variations that break the tie in the task of today, and did not in the version that the study on the page played."""

PLACE_QUESTIONS = ("word_place", "thing_place", "words_first_place")
"""Questions of the audit about words or objects and the place where something is taken."""


@functools.cache
def audit_of(regime, task, demos=120):
    conditions = conditions_of(get_task(task), regime)
    each = max(1, demos // len(conditions))
    facts = [replace(facts_of_condition(c), episode=f"{c.id}/{i}") for c in conditions for i in range(each)]
    return audit_dataset(regime, facts)


def shortcuts_of(audit):
    """Return per question and first value of a shortcut the second values that go with it."""
    (group,) = audit.groups
    return {(f.question, first): set(seconds) for f in group.shortcuts for first, seconds in f.seen.items()}


def start_of(condition):
    return pairing(condition)[1]


def kinds_of(condition):
    return Counter(spec.kind for spec in condition.objects)


def beside(condition):
    """Return the kinds of the objects on the table that the instruction does not take."""
    taken = {n for goal in condition.instruction.subgoals for n in condition.resolve(goal.reference)}
    return Counter(condition.object(name).kind for name in condition.layout if name not in taken)


def test_two_tasks_have_it():
    assert TASKS == ("dinner_plates", "morning_coffee")
    assert listed_tasks("balanced") == tuple(sorted(suite_tasks("better60")))


@pytest.mark.parametrize("task", TASKS)
def test_the_audit_finds_each_word_at_its_place_as_in_training(task):
    trained, found = (shortcuts_of(audit_of(regime, task)) for regime in ("training", REGIME))
    places = {key: at for key, at in trained.items() if key[0] in PLACE_QUESTIONS}
    assert places
    assert {key: at for key, at in found.items() if key[0] in PLACE_QUESTIONS} == places


@pytest.mark.parametrize("task", TASKS)
def test_the_audit_finds_no_rule_that_training_does_not_have(task):
    trained, found = (shortcuts_of(audit_of(regime, task)) for regime in ("training", REGIME))
    assert found.keys() <= trained.keys()
    assert shortcuts_of(audit_of("balanced", task)) == {}


@pytest.mark.parametrize("task", TASKS)
def test_the_variations_that_break_the_tie_are_predicted_to_fail_and_no_others(task):
    (group,) = audit_of("training", task).groups
    breaking = {name for f in group.shortcuts if f.question in PLACE_QUESTIONS for name, _ in f.separating}
    forecast = predict(audit_of(REGIME, task))
    assert {f.variation for f in forecast.variations if f.risk > 0.0} == breaking
    assert breaking == set(TIED[task]) | CHANGED_SINCE_STUDY.get(task, set())


def test_a_task_whose_variations_break_the_tie_otherwise_has_another_version_than_in_the_study():
    study = json.loads((STUDIES / "diverse.json").read_text())
    for task, changed in CHANGED_SINCE_STUDY.items():
        assert not changed & set(TIED[task])
        assert study["task_versions"][task] < get_task(task).version


@pytest.mark.parametrize("task", TASKS)
def test_it_has_as_many_conditions_layouts_and_bystanders_as_balanced(task):
    diverse, balanced = (conditions_of(get_task(task), regime) for regime in (REGIME, "balanced"))
    assert len(diverse) == len(balanced) == len({pairing(c) for c in diverse})
    assert len({start_of(c) for c in diverse}) >= len({start_of(c) for c in balanced})
    assert {c.instruction.text for c in diverse} == {c.instruction.text for c in balanced}
    assert {kind for c in diverse for kind in beside(c)} == {kind for c in balanced for kind in beside(c)}
    assert {kind for c in diverse for kind in kinds_of(c)} == {kind for c in balanced for kind in kinds_of(c)}
    assert {len(c.objects) for c in diverse} == {len(c.objects) for c in balanced}
    assert {slot for c in diverse for slot in c.layout.values()} == {s for c in balanced for s in c.layout.values()}
    shared = {pairing(c) for c in diverse} & {pairing(c) for c in balanced}
    assert 2 * len(shared) >= len(balanced)


def test_each_instruction_is_given_equally_often():
    for task in TASKS:
        said = Counter(
            tuple((goal.word, goal.target) for goal in c.instruction.subgoals)
            for c in conditions_of(get_task(task), REGIME)
        )
        assert len(set(said.values())) == 1, said


@pytest.mark.parametrize("task", TASKS)
def test_no_test_leaks_in(task):
    """Neither a test with its instruction, nor its start, nor its instruction alone, unless training has them."""
    bounds = RegimeBounds.of(get_task(task), REGIME)
    trained = get_task(task).training
    tests = conditions_of(get_task(task), "covered")
    leaving = [t for t in tests if pairing(t) not in {pairing(c) for c in trained}]
    assert {t.id for t in bounds.forbidden} == {t.id for t in leaving}
    starts = {start_of(t) for t in leaving} - {start_of(c) for c in trained}
    assert not starts & {start_of(c) for c in bounds.shown}
    said = {t.instruction.text for t in leaving} - {c.instruction.text for c in trained}
    assert not said & {c.instruction.text for c in bounds.shown}


@pytest.mark.parametrize("task", TASKS)
def test_its_conditions_are_found_by_name_with_their_slots(task):
    assert crossed_in(REGIME, task)[0].startswith("tied:")
    for number, condition in enumerate(listed_conditions(REGIME, task), start=1):
        assert condition.name == f"diverse{number}"
        found = resolve_condition(task, condition.name)
        assert found.condition == condition
        assert found.variation is None
        assert set(condition.layout.values()) <= {slot.name for slot in found.task.slots}
    shown = in_regime(get_task(task), REGIME)
    assert shown.training == listed_conditions(REGIME, task)
    assert set().union(*(c.layout.values() for c in shown.training)) <= {slot.name for slot in shown.slots}


def test_a_task_without_it_is_refused_with_those_that_have_it(capsys, tmp_path):
    for task in set(suite_tasks("better60")) - set(TASKS):
        assert listed_conditions(REGIME, task) == ()
        with pytest.raises(
            InvalidInputError, match=rf"{task} has no {REGIME} conditions.*dinner_plates, morning_coffee"
        ):
            conditions_of(get_task(task), REGIME)
    out = tmp_path / "set"
    assert main(["dataset", "--tasks", "fruit_lunch", "--regime", REGIME, "--demos", "8", "--out", str(out)]) == 2
    assert f"fruit_lunch has no {REGIME} conditions" in " ".join(capsys.readouterr().err.split())


def test_no_two_regimes_name_a_condition_alike():
    names = [c.name for regime in LISTED for c in listed_conditions(regime, "morning_coffee")]
    assert len(names) == len(set(names)) == 64
