"""A verdict depends on what happened and on nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from betterbench.diagnosis import TrialDiagnosis, diagnose_record, diagnose_records, offline_truth
from betterbench.errors import RecordError


def acts():
    """Names episodes that end in different labels: (task, name, what is done)."""
    return {
        "inertia": ("fast_food", "R1", lambda s: s.bring(s.at("first")).bring(s.of("fries")).home()),
        "skip": ("fast_food", "T1", lambda s: s.bring(s.of("fries")).home()),
        "order": ("fast_food", "T1", lambda s: s.bring(s.of("fries")).bring(s.at("first")).home()),
        "repeat": ("fast_food", "train1", lambda s: s.bring(s.at("first")).grasp(s.at("second")).lift().home()),
        "look_alike": ("fast_food", "O1", lambda s: s.grasp(s.at("first")).lift()),
        "drop": ("fast_food", "train1", lambda s: s.grasp(s.at("first")).lift().open().home()),
        "miss": ("fast_food", "train1", lambda s: s.grasp(s.at("first"), beside=(0.052, 0.0)).lift().open().home()),
        "air": ("fast_food", "T1", lambda s: s.air_grasp("second").home()),
        "halt": ("fast_food", "train1", lambda s: s.bring(s.at("first")).home().wait(4)),
        "freeze": ("fast_food", "T1", lambda s: s.wait(4)),
        "beside": (
            "morning_coffee",
            "train1",
            lambda s: s.grasp(s.of("red mug")).lift().carry(s.goal_place() + np.array([0.02, 0.0, 0.0])).home(),
        ),
        "wrong_mug": ("morning_coffee", "L3", lambda s: s.bring(s.of("blue mug")).home()),
    }


def core(d: TrialDiagnosis) -> tuple[object, ...]:
    """Returns the parts of a diagnosis that names must not change."""
    return (
        d.label, d.kind, d.evidence.rule, d.evidence.start_s, d.evidence.shared, d.evidence.candidates, d.success,
        d.first_slot, d.intended, d.intention_correct, d.progress, [(a.slot, a.result, a.secured) for a in d.attempts],
    )  # fmt: skip


@pytest.mark.parametrize("act", acts())
def test_names_of_objects_mean_nothing(stage, renamed, act):
    task, name, play = acts()[act]
    record = play(stage(task, name)).end()
    shuffled = {o.name: f"thing_{k * 7 % 11}" for k, o in enumerate(record.metadata.scene.objects)}
    before, after = diagnose_record(record), diagnose_record(renamed(record, shuffled))
    assert core(before) == core(after)
    assert after.first_attempt == shuffled.get(before.first_attempt or "")


@pytest.mark.parametrize("act", acts())
def test_idle_time_at_the_end_means_nothing(stage, act):
    task, name, play = acts()[act]
    labels = []
    for idle in (5.0, 12.0):
        found = diagnose_record(play(stage(task, name)).wait(idle).end())
        labels.append((found.label, found.evidence.rule, found.evidence.start_s, found.attempts, found.progress))
    assert labels[0] == labels[1]


def test_idle_time_after_the_limit_makes_no_halt_of_a_timeout(stage):
    s = stage("fast_food", "train1").wander(27.5)
    first = diagnose_record(s.end())
    s = stage("fast_food", "train1").wander(27.5)
    assert diagnose_record(s.wait(60).end()).label is first.label


def test_the_order_of_trials_means_nothing(policies):
    names = ("train1", "train3", "train4", "L3", "L4", "O1", "T1")
    records = [policies["lexical"]("morning_coffee", n, s) for n in names for s in range(2)]
    rng = np.random.default_rng(0)
    first = diagnose_records(records)
    for _ in range(3):
        shuffled = diagnose_records([records[i] for i in rng.permutation(len(records))])
        assert {t.key: t for t in first.trials} == {t.key: t for t in shuffled.trials}
        assert first.findings == shuffled.findings
        assert first.metrics == shuffled.metrics


@pytest.mark.parametrize("act", acts())
def test_offline_truth_is_live_truth(stage, act):
    task, name, play = acts()[act]
    record = play(stage(task, name)).end()
    truths = offline_truth(record)
    assert np.array_equal([t.subgoals for t in truths], record.subgoals)
    assert np.array_equal([t.relations for t in truths], record.predicates)
    assert np.array_equal([t.goal for t in truths], record.goal)
    assert np.array_equal([t.forbidden for t in truths], record.forbidden)
    assert any(t.success for t in truths) == record.outcome.success


def test_a_record_without_its_predicates_is_refused(stage):
    record = stage("fast_food", "train1").wait(0.2).end()
    broken = replace(record, metadata=replace(record.metadata, predicate_names=("a",) * len(record.predicates[0])))
    with pytest.raises(RecordError, match=r"no predicate inside\(burger_1"):
        diagnose_record(broken)


def test_a_diagnosis_does_not_change_the_record(stage):
    record = stage("fast_food", "R1").bring("burger_1").end()
    assert diagnose_record(record) == diagnose_record(record)
