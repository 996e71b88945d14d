"""A run: nothing planned is lost, nothing is mixed silently, and the numbers are those of the trials."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from betterbench.diagnosis import Label, diagnose_records, diagnose_run
from betterbench.diagnosis.measures.metrics import compute_metrics
from betterbench.errors import RecordError, RunConflictError
from betterbench.records import JournalEntry, RunFolder
from betterbench.tasks import THRESHOLDS
from betterbench.tasks.interventions.resolve import resolve_condition


def plan(*trials: tuple[str, str, str | None, int]) -> dict[str, object]:
    listed = [{"task": t, "condition": c, "variation": v, "seed": s} for t, c, v, s in trials]
    return {"policy": "scripted", "trials": listed}


@pytest.fixture
def run(tmp_path, policies):
    """A run of four trials, of which one broke down and one was never begun."""
    folder = RunFolder.start(
        tmp_path / "run",
        plan(
            ("fast_food", "train1", None, 0),
            ("fast_food", "train1", "R1", 0),
            ("fast_food", "train1", "L1", 0),
            ("fast_food", "train2", "R2", 0),
        ),
    )
    with folder.journal() as journal:
        for name in ("R1", "train1"):
            folder.write_record(policies["inertia"]("fast_food", name, 0))
            journal.append(JournalEntry("fast_food", name, None if name == "train1" else name, 0))
        journal.append(JournalEntry("fast_food", "L1", "L1", 0, "error", "the server went away"))
    return folder


def test_every_planned_trial_appears_in_plan_order(run):
    found = diagnose_run(run.path)
    assert [t.key for t in found.trials] == [f"fast_food/{n}/0" for n in ("train1", "R1", "L1", "R2")]
    labels = [t.label for t in found.trials]
    assert labels == [Label.SUCCESS, Label.BEHAVIORAL_INERTIA, Label.POLICY_ERROR, Label.UNFINISHED]
    assert "the server went away" in found.trials[2].evidence.text
    assert found.trials[0].record == "records/fast_food/train1/0.parquet"
    assert any(
        "1 planned trial has no record and counts as policy_error" in n and "fast_food/L1/0" in n for n in found.notes
    )
    rate = found.metric("success_rate", "overall")
    assert (rate.k, rate.n) == (0, 3)  # a trial without a record stays in the denominator
    assert found.metric("intention_accuracy", "fast_food").n == 3
    assert found.metric("system_failure_rate", "overall").k == 1
    assert found.metric("unfinished_rate", "overall").k == 1
    assert found.thresholds["grasp_reach"] == THRESHOLDS.grasp_reach


def test_the_json_form_is_plain_json(run):
    form = json.loads(json.dumps(diagnose_run(run).to_json(), allow_nan=False))
    fields = {"task", "variation", "condition", "axis", "seed", "policy", "success", "expected", "label", "kind"}
    assert fields | {"first_attempt", "intended", "progress", "evidence"} <= set(form["trials"][0])
    assert all({"k", "n", "value", "low", "high"} <= set(m) for m in form["metrics"])


def test_a_run_folder_and_its_records_give_the_same(run):
    one = diagnose_run(run)
    same = diagnose_records([run.read_record("fast_food", n, 0) for n in ("train1", "R1")])
    assert [replace(t, record=None) for t in one.trials[:2]] == list(same.trials)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"engine": {"mujoco": "3.16.0"}}, ("3.17.0", "3.16.0")),
        ({"package_version": "9.9"}, ("0.1.0", "9.9")),
        ({"suite_version": "9.0"}, ("1.0", "9.0")),
        ({"policy": "another"}, ("scripted", "another")),
        ({"render_quality": "high"}, ("None", "high")),
    ],
)
def test_versions_are_not_mixed_silently(policies, change, named):
    a, b = (policies["right"]("fast_food", n, 0) for n in ("train1", "R1"))
    b = replace(b, metadata=replace(b.metadata, **change))
    with pytest.raises(RunConflictError) as caught:
        diagnose_records([a, b])
    assert all(value in str(caught.value) for value in named)
    mixed = diagnose_records([a, b], allow_mixed=True)
    assert any(" | " in v for v in mixed.versions.values())


def test_another_model_hash_is_no_other_version(policies):
    found = diagnose_records([policies["right"]("fast_food", "train1", s) for s in range(2)])
    assert found.versions["engine:mujoco"] == "3.17.0"


def test_another_task_version_is_refused(policies):
    record = policies["right"]("fast_food", "train1", 0)
    record = replace(record, metadata=replace(record.metadata, task_version=99))
    with pytest.raises(RunConflictError, match="version 99"):
        diagnose_records([record])


def test_a_record_without_a_target_of_its_task_is_refused(policies):
    record = policies["right"]("fast_food", "train1", 0)
    condition, scene = resolve_condition("fast_food", "train1").condition, record.metadata.scene
    kind = condition.object(condition.instruction.subgoals[0].target).kind
    others = tuple(replace(o, kind="nothing") if o.kind == kind else o for o in scene.objects)
    record = replace(record, metadata=replace(record.metadata, scene=replace(scene, objects=others)))
    with pytest.raises(RecordError, match=f"contains no object of the kind '{kind}'"):
        diagnose_records([record])


@pytest.mark.parametrize(
    ("bad", "text"),
    [
        ({"trials": []}, "plan: policy"),
        ({"policy": "p"}, "plan: trials"),
        ({"policy": "p", "trials": [3]}, r"trials\[0\]"),
        ({"policy": "p", "trials": [{"task": "fast_food", "condition": "train1", "seed": -1}]}, "seed"),
        (plan(*[("fast_food", "train1", None, 0)] * 2), "planned twice"),
    ],
)
def test_a_malformed_plan_is_named(tmp_path, bad, text):
    folder = RunFolder.start(tmp_path / "run", bad)
    with pytest.raises(RecordError, match=text):
        diagnose_run(folder)


def test_an_empty_run_has_numbers_without_values(tmp_path):
    found = diagnose_run(RunFolder.start(tmp_path / "run", plan()))
    assert found.trials == ()
    assert found.metric("success_rate", "overall").value is None


def test_metrics_are_those_of_suite_section_4(policies):
    names = ("train1", "train2", "R1", "R2", "L1")
    found = diagnose_records([policies["inertia"]("fast_food", n, s) for n in names for s in range(3)])

    def of(name, scope):
        return found.metric(name, scope)

    assert (of("success_rate", "training").k, of("success_rate", "training").n) == (6, 6)
    assert (of("success_rate", "overall").k, of("success_rate", "overall").n) == (3, 9)
    assert (of("intention_accuracy", "fast_food").k, of("intention_accuracy", "fast_food").n) == (3, 9)
    assert of("success_rate", "fast_food/R1").k == 0
    assert of("reasoning_failure_rate", "axis:primitive_recomposition").value == 1.0
    assert of("execution_failure_rate", "overall").k == 0
    assert of("delta_sr", "fast_food/R1").value == -1.0
    assert of("delta_sr", "fast_food").n == 6
    grasps = of("distractor_grasp_rate", "fast_food/R1")
    assert (grasps.k, grasps.n) == (3, 9)  # burger, fries, drink per trial
    gap = of("illusion_gap", "overall")
    assert gap.n == 9
    assert gap.value == pytest.approx(6 / 9)
    assert gap.p_value == pytest.approx(2 * 0.5**6)
    assert of("illusion_gap", "axis:spatial_layout_shift").value == 0.0
    assert "Holm over 2" in of("illusion_gap", "axis:primitive_recomposition").method


def test_null_attempts_are_no_grasps(stage):
    s = stage("fast_food", "T1")
    found = diagnose_records([s.air_grasp("second").wait(4).end()])
    assert found.metric("distractor_grasp_rate", "overall").n == 0


def test_metrics_do_not_need_twins(policies):
    found = diagnose_records([policies["right"]("fast_food", "R1", 0)])
    assert found.metric("illusion_gap", "overall") is None
    assert any("no counterfactual twin" in n for n in found.notes)
    assert compute_metrics(found.trials) == found.metrics
