"""Sets of demonstrations: what their records say, that they replay, and that nothing but seed and sources decides."""

from __future__ import annotations

import gc
import json
import re
import shutil
import weakref
from dataclasses import replace

import numpy as np
import pytest

from betterbench.demonstrations.making import production
from betterbench.demonstrations.making.acceptance import acceptance_of, write_acceptance
from betterbench.demonstrations.making.amplifier import AmplifierSettings
from betterbench.demonstrations.making.attempt import DemonstrationAttempt, amplify_attempt, collect_attempt
from betterbench.demonstrations.making.production import amplify, attempts_of, collect, method_of, scene_of, set_hash
from betterbench.demonstrations.making.sources import demonstrated_source, load_library
from betterbench.errors import InvalidInputError, RecordError, RunConflictError
from betterbench.evaluation import check_record
from betterbench.json_form import sealed_form
from betterbench.policies.experts.planner import Planner
from betterbench.records import RunFolder
from betterbench.tasks import TrialId
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED

pytestmark = pytest.mark.physics


def test_records_say_who_demonstrated_and_which_rows_serve_which_subgoal(sources, amplified):
    names = {str(e.key) for e in sources.entries()}
    for run, kind in ((sources, "expert"), (amplified, "amplified")):
        records = list(run.records())
        assert len(records) == 4
        for record in records:
            meta = record.metadata
            assert record.outcome.success
            assert meta.seed >= FIRST_DEMONSTRATION_SEED
            assert meta.demonstrator.kind == kind
            assert set(meta.demonstrator.sources) <= names
            assert bool(meta.demonstrator.sources) is (kind == "amplified")
            assert [s.subgoal for s in meta.segments if s.subgoal] == list(meta.subgoal_names)
            rows = [row for s in meta.segments for row in range(s.start, s.stop)]
            assert rows == list(range(len(record)))
            assert all(s.start <= w.start < w.stop <= s.stop for s in meta.segments for w in s.skills)


def test_the_label_is_free_of_the_noise_of_what_was_executed(sources, amplified):
    for record in sources.records():
        assert np.array_equal(record.action[1:], record.applied[1:])
    for record in amplified.records():
        off = record.applied[1:] - record.action[1:]
        sigma = record.metadata.demonstrator.action_noise
        assert np.array_equal(record.action[1:, 6], record.applied[1:, 6])
        assert 0.3 * sigma < off[:, :6].std() < 1.1 * sigma
        closing = np.flatnonzero(np.diff(record.gripper_command > 0.0)) + 1
        assert (off[closing - 1, :6] == 0.0).all()  # the row of the change


def test_a_demonstration_replays_to_the_same_bits(sources, amplified):
    for run in (sources, amplified):
        entry = run.entries()[0]
        found = check_record(run.record_path(entry.task, entry.condition, entry.seed))
        assert found.identical, found.differing


def test_the_same_command_again_changes_nothing(sources, amplified, record_files):
    before, hashed = record_files(amplified), set_hash(amplified)
    again = amplify(sources.path, amplified.path, demos=1)
    assert record_files(again) == before
    assert set_hash(again) == hashed


def test_another_method_or_fewer_demonstrations_are_another_run(sources, amplified):
    with pytest.raises(RunConflictError, match="action_noise"):
        amplify(sources.path, amplified.path, demos=1, settings=AmplifierSettings(action_noise=0.05))
    with pytest.raises(RunConflictError):
        collect(["morning_coffee"], amplified.path, demos=1)


def test_a_run_with_a_seed_of_tests_is_no_source(sources, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(sources.path, copy)
    for name in ("run.json", "journal.jsonl"):
        text = (copy / name).read_text()
        seed = str(sources.entries()[0].seed)
        assert seed in text
    lines = [json.loads(line) for line in (copy / "journal.jsonl").read_text().splitlines()]
    plan = json.loads((copy / "run.json").read_text())
    for form in (lines[0], *plan["plan"]["trials"]):
        form["seed"] = 7 if form["condition"] == lines[0]["condition"] else form["seed"]
    for line in lines:
        line.pop("link")
    (copy / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    (copy / "run.json").write_text(json.dumps(sealed_form(plan)))
    with pytest.raises(InvalidInputError, match="a test seed"):
        amplify(copy, tmp_path / "out", demos=1)


def test_a_condition_that_nobody_demonstrated_is_named_with_the_command_that_demonstrates_it(
    sources, tmp_path, monkeypatch
):
    """The demonstrations by hand of one condition go on in their own folder, and not beside those of the expert."""
    copy = tmp_path / "by hand"
    shutil.copytree(sources.path, copy)
    lines = (copy / "journal.jsonl").read_text().splitlines(keepends=True)
    first = json.loads(lines[0])
    first.pop("link")
    (copy / "journal.jsonl").write_text(json.dumps(first) + "\n")
    kept = first["condition"]
    missing = "morning_coffee/" + ("train2" if kept == "train1" else "train1")
    with pytest.raises(InvalidInputError, match=f"{missing}.*better collect --tasks morning_coffee --out RUN"):
        amplify(copy, tmp_path / "out", demos=1)
    monkeypatch.setattr(production, "TELEOPERATED", "demonstrator:expert")  # as if a person had given them
    with pytest.raises(InvalidInputError, match=f"{missing}.*better teleop --tasks morning_coffee --out '.*by hand'"):
        amplify(copy, tmp_path / "out", demos=1)
    monkeypatch.setattr(production, "options_for", lambda tasks: f" --suite {tasks[0]}s")  # as if it were of a suite
    with pytest.raises(InvalidInputError, match="better teleop --suite morning_coffees --tasks morning_coffee --out"):
        amplify(copy, tmp_path / "out", demos=1)


def test_bad_input_is_one_clear_error(sources, tmp_path):
    for settings, field in ((AmplifierSettings(action_noise=9.0), "--noise"),):
        with pytest.raises(InvalidInputError, match=field):
            amplify(sources.path, tmp_path / "a", settings=settings)
    with pytest.raises(InvalidInputError, match="--attempts"):
        collect(["fast_food"], tmp_path / "b", demos=1, attempts=0)
    with pytest.raises(InvalidInputError, match="folder of the source demonstrations"):
        amplify(sources.path, sources.path)
    with pytest.raises(InvalidInputError, match="no successful demonstration of fast_food"):
        amplify(sources.path, tmp_path / "c", tasks=["fast_food"])
    assert not any((tmp_path / name).exists() for name in "abc")


def test_a_damaged_source_or_one_of_another_version_is_one_clear_error(sources, tmp_path, monkeypatch):
    copy = tmp_path / "copy"
    shutil.copytree(sources.path, copy)
    record = min(copy.glob("records/*/*/*.parquet"))
    record.write_bytes(record.read_bytes()[:5000])
    with pytest.raises(RecordError, match=re.escape(str(record))):
        amplify(copy, tmp_path / "out", demos=1)
    monkeypatch.setattr("betterbench.demonstrations.making.sources.SUITE_VERSION", "9.9")
    with pytest.raises(RecordError, match=r"recorded with version 2\.0 of the suite, but this is version 9\.9"):
        amplify(sources.path, tmp_path / "out", demos=1)
    assert not (tmp_path / "out").exists()


def test_sources_that_change_while_they_are_carried_over_end_it(sources, tmp_path, monkeypatch):
    copy = tmp_path / "copy"
    shutil.copytree(sources.path, copy)
    hashed = production.set_hash

    def then_changed(run, tasks=None):
        found = hashed(run, tasks)
        journal = run.path / "journal.jsonl"
        journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:3]))
        return found

    monkeypatch.setattr(production, "set_hash", then_changed)
    with pytest.raises(RecordError, match=f"{re.escape(str(copy))}: its demonstrations have changed"):
        amplify(copy, tmp_path / "out", demos=1)
    assert not list((tmp_path / "out").rglob("*.parquet"))


def test_the_method_of_a_run_makes_the_same_attempts_again(sources, amplified):
    (entry, *_) = amplified.entries()
    record = amplified.read_record(entry.task, entry.condition, entry.seed)
    notes = attempts_of(amplified.path)[entry.key].notes
    method = method_of(amplified)
    again = production.attempt_at(
        production.scene_of(entry.key, method.quality, method.robot), len(notes) - 1, method
    ).record
    assert np.array_equal(again.qpos, record.qpos)


def test_stored_segments_are_not_trusted(sources):
    record = next(sources.records())
    (first, *rest) = record.metadata.segments
    forged = replace(first, stop=first.stop + 10**6, skills=())
    lied = replace(record, metadata=replace(record.metadata, segments=(forged, *rest)))
    assert demonstrated_source(lied).segments == record.metadata.segments


def test_the_report_counts_every_attempt(sources, amplified):
    found = acceptance_of(amplified)
    (task,) = found.tasks
    notes = [note for outcome in attempts_of(amplified.path).values() for note in outcome.notes]
    assert task.attempts.attempts == len(notes) >= 4
    assert task.attempts.accepted == found.demonstrations == 4
    assert sum(t.attempts for t in task.sources.values()) == len(notes)
    assert sum(task.failures.values()) == len(notes) - 4
    page = write_acceptance(amplified, found, {}, {}).read_text()
    assert "relative to the number that the set can reach" in page
    assert found.sha256 in page
    assert "morning_coffee" in page
    form = json.loads((amplified.path / "acceptance" / "acceptance.json").read_text())
    assert form["sha256"] == set_hash(amplified)
    assert method_of(amplified).sources == str(sources.path)


def test_a_run_of_trials_is_no_set_of_demonstrations(tmp_path):
    run = RunFolder.start(tmp_path / "run", {"policy": "expert", "trials": []})
    with pytest.raises(RecordError, match=r"plan\.demonstrations"):
        method_of(run)


@pytest.mark.slow
def test_neither_workers_nor_interruptions_decide(sources, amplified, tmp_path, record_files):
    wanted = record_files(amplified)
    two = amplify(sources.path, tmp_path / "two", demos=1, workers=2)
    assert record_files(two) == wanted

    def stop(progress):
        if progress.last is not None:
            raise KeyboardInterrupt

    for _ in range(4):
        with pytest.raises(KeyboardInterrupt):
            amplify(sources.path, tmp_path / "broken", demos=1, on_progress=stop)
    broken = amplify(sources.path, tmp_path / "broken", demos=1)
    assert record_files(broken) == wanted
    assert set_hash(broken) == set_hash(amplified)
    grown = amplify(sources.path, tmp_path / "two", demos=2)
    assert wanted.items() < record_files(grown).items()


@pytest.mark.parametrize("fails", [False, True])
def test_an_amplified_attempt_frees_its_scene_without_the_garbage_collector(sources, monkeypatch, fails):
    if fails:
        for ways in ("free_way", "way_to"):  # those of the sources, and planned ones
            monkeypatch.setattr(Planner, ways, lambda *_, **__: None)
    scene = production.scene_of(next(iter(sources.entries())).key, "standard", "panda")
    library = load_library(sources, "morning_coffee")
    gc.collect()
    gc.disable()
    try:
        attempt = amplify_attempt(scene, 0, library, AmplifierSettings())
        there = weakref.ref(scene)
        del scene
        assert there() is None
    finally:
        gc.enable()
    assert attempt.note.failure == ("no free way" if fails else "")


@pytest.mark.slow
def test_the_scene_of_a_start_is_freed_before_the_one_after_the_next(sources, tmp_path, monkeypatch):
    scenes, real = [], production.scene_of

    def kept(*arguments):
        assert sum(scene() is not None for scene in scenes) <= 1
        scene = real(*arguments)
        scenes.append(weakref.ref(scene))
        return scene

    monkeypatch.setattr(production, "scene_of", kept)
    amplify(sources.path, tmp_path / "run", demos=1)
    assert len(scenes) >= 4


@pytest.mark.parametrize("how", ["removed", "moved"])
def test_a_set_whose_folder_vanishes_while_it_is_made_is_whole_all_the_same(
    sources, tmp_path, record_files, how, monkeypatch
):
    """The expert demonstrates as it did for the set that nothing disturbed."""
    out = tmp_path / "out"
    vanished = []

    def as_before(scene, number, _):
        (key,) = (
            k for k in notes if (k.task, k.condition, k.seed) == (scene.task.id, scene.condition.name, scene.seed)
        )
        return DemonstrationAttempt(notes[key].notes[number], sources.read_record(key.task, key.condition, key.seed))

    notes = attempts_of(sources.path)
    monkeypatch.setattr(production, "attempt_at", as_before)

    def vanish(progress):
        if progress.done == 2 and not vanished:
            vanished.append(out)
            shutil.rmtree(out) if how == "removed" else out.rename(tmp_path / "elsewhere")

    run = collect(["morning_coffee"], out, demos=1, on_progress=vanish)
    assert vanished
    assert record_files(run) == record_files(sources)
    assert set_hash(RunFolder.open(out)) == set_hash(sources)
    assert len(attempts_of(out)) == len(attempts_of(sources.path))


def test_an_arm_with_a_fixed_finger_moves_up_to_the_object_before_it_closes():
    scene = scene_of(TrialId("fruit_basket", "train4", 21035931), "fast", "so101")
    assert not collect_attempt(scene, 0).note.failure
