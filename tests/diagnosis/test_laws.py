"""A verdict depends on what happened and on nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.diagnosis import Label, TrialDiagnosis, diagnose_record, diagnose_records, offline_truth
from betterbench.errors import RecordError
from betterbench.tasks import suite_tasks


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
        d.first_slot, d.first_attempt_kind, d.intended_kind, d.intention_correct, d.progress,
        [(a.slot, a.result, a.secured) for a in d.attempts],
    )  # fmt: skip


@pytest.mark.parametrize("act", others_slow(acts(), 3))
def test_names_of_objects_mean_nothing(stage, renamed, act):
    task, name, play = acts()[act]
    record = play(stage(task, name)).end()
    shuffled = {o.name: f"thing_{k * 7 % 11}" for k, o in enumerate(record.metadata.scene.objects)}
    before, after = diagnose_record(record), diagnose_record(renamed(record, shuffled))
    assert core(before) == core(after)
    assert after.first_attempt == shuffled.get(before.first_attempt or "")
    assert after.intended == shuffled.get(before.intended or "")
    assert after.intended_any == tuple(shuffled[name] for name in before.intended_any)


@pytest.mark.parametrize("act", others_slow(acts(), 3))
def test_idle_time_at_the_end_means_nothing(stage, act):
    task, name, play = acts()[act]
    labels = []
    for idle in (5.0, 12.0):
        found = diagnose_record(play(stage(task, name)).wait(idle).end())
        labels.append((found.label, found.evidence.rule, found.evidence.start_s, found.attempts, found.progress))
    assert labels[0] == labels[1]


def test_idle_time_after_the_limit_makes_no_halt_of_a_timeout(stage):
    s = stage("fast_food", "train1").wander(51.0)
    first = diagnose_record(s.end())
    s = stage("fast_food", "train1").wander(51.0)
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


# -- the same over all ten tasks --------------------------------------------------------------------------------


def half(s):
    """Does the first step and goes home."""
    return s.serve(0).home().wait(4)


def drop(s):
    """Drops what is asked for first in mid-air."""
    goal = s.condition.instruction.subgoals[0]
    return s.grasp(s.condition.resolve(goal.reference)[0]).lift().open().home().wait(4)


def stranger(s):
    """Brings something that is not asked for where the first thing was to go."""
    asked = {n for g in s.condition.instruction.subgoals for n in s.condition.resolve(g.reference)}
    thing = next(o.name for o in s.condition.objects if o.role in ("item", "distractor") and o.name not in asked)
    goal = s.condition.instruction.subgoals[0]
    if goal.target == thing:  # a plate cannot stand on itself
        return s.grasp(thing).lift().open().home().wait(4)
    return s.bring(thing, s.goal(0)).home().wait(4)


DEEDS = {"half": half, "drop": drop, "stranger": stranger}
SCENES = {  # per task a variation in which something is left that nobody asked for
    "desk_meeting": "L1", "breakfast_table": "L1", "fruit_lunch": "R1", "fast_food": "R1", "tidy_desk": "O1",
    "morning_coffee": "L3", "office_drawer": "L1", "cheeseburger": "R1", "seasoning_rack": "L1", "dinner_plates": "L1",
}  # fmt: skip
ALL = [(task, deed) for task in SCENES for deed in DEEDS]


@pytest.fixture(scope="module")
def played():
    """Plays each deed once, for all laws."""
    return {}


@pytest.fixture
def record(stage, played, request):
    task, deed = request.param
    if request.param not in played:
        played[request.param] = DEEDS[deed](stage(task, SCENES[task])).end()
    return played[request.param]


everywhere = pytest.mark.parametrize(
    "record", others_slow([(case,) for case in ALL], 4), indirect=True, ids=["-".join(case) for case in ALL]
)
"""A quarter of all, another one each day, in which each deed occurs."""


def test_the_ten_tasks_are_all_here():
    assert set(SCENES) == set(suite_tasks("better60"))


@everywhere
def test_names_mean_nothing_in_any_task(record, renamed):
    names = {o.name: f"thing_{k * 7 % 11}" for k, o in enumerate(record.metadata.scene.objects)}
    before, after = diagnose_record(record), diagnose_record(renamed(record, names))
    assert core(before) == core(after)
    assert after.evidence.objects == tuple(names[n] for n in before.evidence.objects)
    assert [a.object for a in after.attempts] == [names.get(a.object or "") for a in before.attempts]


@pytest.mark.parametrize(("task", "deed"), others_slow(ALL, 4))
def test_the_order_of_objects_means_nothing_in_any_task(stage, task, deed, played):
    forth = played.get((task, deed)) or DEEDS[deed](stage(task, SCENES[task])).end()
    back = DEEDS[deed](stage(task, SCENES[task], backwards=True)).end()
    names = [[o.name for o in r.metadata.scene.objects] for r in (forth, back)]
    assert names[0] == names[1][::-1]
    assert diagnose_record(forth) == diagnose_record(back)


@everywhere
def test_cameras_mean_nothing_in_any_task(record):
    seen = replace(record, metadata=replace(record.metadata, camera_preset="duo", render_quality="high"))
    assert diagnose_record(seen) == diagnose_record(record)


@everywhere
def test_offline_truth_is_live_truth_in_any_task(record):
    truths = offline_truth(record)
    assert np.array_equal([t.subgoals for t in truths], record.subgoals)
    assert np.array_equal([t.relations for t in truths], record.predicates)
    assert np.array_equal([t.goal for t in truths], record.goal)
    assert any(t.success for t in truths) == record.outcome.success


@pytest.mark.parametrize("task", others_slow(SCENES, 5))
def test_idle_time_after_the_limit_means_nothing_in_any_task(stage, task):
    s = stage(task, SCENES[task])
    s.serve(0)  # and no halt yet: it wanders on until its time is up
    limit = s.task.step_limit(s.condition)
    while s.step < limit:
        s.wander(0.05)
    verdicts = []
    for idle in (0.0, 5.0):
        verdicts.append(diagnose_record(s.wait(idle).builder.finish(termination="step_limit", success=False)))
    assert verdicts[0] == verdicts[1]


@pytest.mark.parametrize(("task", "deed"), others_slow([a for a in ALL if a[1] != "half"], 5))
def test_idle_time_after_a_halt_means_nothing_in_any_task(stage, task, deed):
    verdicts = []
    for idle in (0.0, 2.0):
        found = diagnose_record(DEEDS[deed](stage(task, SCENES[task])).wait(idle).end())
        verdicts.append((found.label, found.evidence.rule, found.evidence.start_s, found.attempts, found.progress))
    assert verdicts[0] == verdicts[1]


def test_the_order_of_trials_means_nothing_over_all_tasks(stage, played):
    records = [
        played.get((task, deed)) or DEEDS[deed](stage(task, SCENES[task])).end()
        for task in SCENES
        for deed in ("half",)
    ]
    first = diagnose_records(records)
    for seed in range(2):
        shuffled = diagnose_records([records[i] for i in np.random.default_rng(seed).permutation(len(records))])
        assert {t.key: t for t in first.trials} == {t.key: t for t in shuffled.trials}
        assert first.findings == shuffled.findings
        assert {(m.name, m.scope): m for m in first.metrics} == {(m.name, m.scope): m for m in shuffled.metrics}


@pytest.mark.parametrize("task", others_slow(SCENES, 5))
def test_a_crash_stays_in_the_denominator_of_any_task(stage, task):
    fine = half(stage(task, SCENES[task])).end()
    crash = stage(task, SCENES[task], seed=1).serve(0).end(termination="policy_error", error="connection lost")
    found = diagnose_records([fine, crash])
    scope = f"{task}/{SCENES[task]}"
    assert found.metric("success_rate", scope).n == 2
    assert found.metric("reasoning_failure_rate", scope).n == 2
    assert [t.label for t in found.trials][1] is Label.POLICY_ERROR
    assert "connection lost" in found.trials[1].evidence.text


def test_a_record_without_its_predicates_is_refused(stage):
    record = stage("fast_food", "train1").wait(0.2).end()
    broken = replace(record, metadata=replace(record.metadata, predicate_names=("a",) * len(record.predicates[0])))
    with pytest.raises(RecordError, match=r"no predicate inside\(burger_1"):
        diagnose_record(broken)


def test_a_record_without_a_slot_of_its_task_is_one_line(stage):
    record = stage("morning_coffee", "train1").end()
    scene = record.metadata.scene
    slots = tuple(replace(s, name="elsewhere") if s.name == "near" else s for s in scene.slots)
    forged = replace(record, metadata=replace(record.metadata, scene=replace(scene, slots=slots)))
    with pytest.raises(RecordError, match=r"no slot near\. Record the trial again"):
        diagnose_record(forged)


def test_a_diagnosis_does_not_change_the_record(stage):
    record = stage("fast_food", "R1").bring("burger_1").end()
    assert diagnose_record(record) == diagnose_record(record)
