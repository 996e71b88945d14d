"""The calibration zoo: every policy runs everywhere, decides by its one rule, and its true labels are well formed."""

from __future__ import annotations

import numpy as np
import pytest

from betterbench.diagnosis.verdict import Label
from betterbench.experts import EXPERTS, expert_names, make_expert, true_label
from betterbench.experts.zoo import truth
from betterbench.tasks import all_tasks, get_task

pytestmark = pytest.mark.physics

CONDITIONS = [(t.id, c.name) for t in all_tasks() for c in (*t.training, *t.variations)]
VARIATIONS = [(t.id, v.name) for t in all_tasks() for v in t.variations]
ZOO = [name for name in expert_names() if name.startswith("zoo:")]
FAULTS = [(policy, *condition.split("/")) for policy, faults in truth._FAULTS.items() for condition in sorted(faults)]
FAULTS += [("zoo:clumsy", t, n) for t, n in CONDITIONS if true_label("zoo:clumsy", t, n) == "execution_failure"]
BY_POLICY = {policy: (policy, task, name) for policy, task, name in FAULTS}
"""The last condition of the table on which each policy's rule speaks: a quick one."""
QUICK = [BY_POLICY[policy] for policy in ZOO]


def ran(record):
    assert record.outcome.termination != "policy_error", record.outcome.error
    assert record.outcome.clipped_actions == 0
    assert np.abs(record.action[1:]).max() <= 1.0


@pytest.mark.parametrize(("policy", "task_id", "name"), QUICK, ids=["-".join(q) for q in QUICK])
def test_a_broken_rule_that_speaks_costs_the_goal(episode, policy, task_id, name):
    record = episode(policy, task_id, name)
    ran(record)
    assert not record.outcome.success


@pytest.mark.slow
@pytest.mark.parametrize(("task_id", "name"), VARIATIONS, ids=[f"{t}/{v}" for t, v in VARIATIONS])
@pytest.mark.parametrize("policy", ZOO)
def test_every_zoo_policy_runs_on_every_variation(episode, policy, task_id, name):
    record = episode(policy, task_id, name)
    ran(record)
    right = true_label(policy, task_id, name) in ("success", "correct_freeze")
    assert record.outcome.success is right


def test_true_labels_name_only_what_exists():
    known = {f"{t}/{n}" for t, n in CONDITIONS}
    assert set(truth._FAULTS) == set(ZOO)
    for policy, faults in truth._FAULTS.items():
        for condition, label in faults.items():
            assert condition in known, f"{policy} {condition}"
            assert Label(label).kind in ("reasoning", "execution"), label


@pytest.mark.parametrize(("task_id", "name"), CONDITIONS, ids=[f"{t}/{n}" for t, n in CONDITIONS])
def test_true_label_of_the_expert_is_what_is_expected(task_id, name):
    task = get_task(task_id)
    expected = "succeed" if name.startswith("train") else task.variation(name).expected.value
    right = {"succeed": "success", "stay_still": "correct_freeze", "refuse": "correct_refusal"}[expected]
    assert true_label("expert", task_id, name) == right
    for policy in ZOO:
        assert Label(true_label(policy, task_id, name))


@pytest.mark.parametrize("task_id", [t.id for t in all_tasks()])
def test_every_fault_can_be_exposed_by_the_variation_that_shows_it(task_id):
    """A variation says which failure modes it can bring out; every reasoning label of the table is among known ones."""
    for variation in get_task(task_id).variations:
        for label in variation.exposes:
            assert Label(label).kind in ("reasoning", "execution", "none")


@pytest.mark.parametrize("policy", ZOO)
def test_zoo_policy_says_what_it_does(policy):
    assert EXPERTS[policy].summary.endswith(".")
    assert EXPERTS[policy].address == policy


def test_agents_answer_the_same_on_the_same_states(scene):
    """Two agents of one address in two equal scenes play the same episode: nothing but the trial decides."""
    for policy in ("expert", "zoo:clumsy", "zoo:halt"):
        one, two = scene("morning_coffee", "train2", 3), scene("morning_coffee", "train2", 3)
        a, b = make_expert(policy, one), make_expert(policy, two)
        assert a.name == policy
        first, second = one.reset(), two.reset()
        for _ in range(40):
            x, y = a.act_on_state(first), b.act_on_state(second)
            assert np.array_equal(x, y)
            one.step(x)
            two.step(y)
            first, second = one.state(), two.state()
