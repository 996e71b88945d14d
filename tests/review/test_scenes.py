"""Review of scenes: changes, verdicts and what is written from them, without a browser."""

from __future__ import annotations

from dataclasses import replace

import pytest

from betterbench.certification import examine
from betterbench.certification.examine import Watched
from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, RecordError, UnknownNameError
from betterbench.geometry import Pose, from_yaw
from betterbench.jobs.decisions import Undo, Verdict, now
from betterbench.json_form import dump_json
from betterbench.review.agreement import agreement
from betterbench.review.scenes.changes import (
    FrameChange,
    SceneJournal,
    SceneReview,
    SlotChange,
    SlotPlace,
    read_scene_reviews,
    said,
)
from betterbench.review.scenes.desk import SceneDesk
from betterbench.review.scenes.forms import changed_form, patched, place_of, scene_content, task_content
from betterbench.review.scenes.queue import condition_of, scene_queue
from betterbench.review.scenes.writing import reviewed_form, reviewed_forms, write_reviewed_tasks
from betterbench.sim.assets import build
from betterbench.sim.assets.authoring.registry import moved_regions
from betterbench.tasks import task_from_json, user_files
from betterbench.tasks.authoring.task_form import task_forms


@pytest.fixture(scope="module")
def form():
    return task_forms(["morning_coffee"])["morning_coffee"]


def slot_of(form, name):
    return place_of(next(slot for slot in form["slots"] if slot["name"] == name))


def moved(form, name, x=0.0, y=0.0, yaw=0.0):
    before = slot_of(form, name)
    return SlotChange(name, before, SlotPlace(before.x + x, before.y + y, before.yaw + yaw))


# ------------------------------------------------------------------------------------------------------------ changes


def test_a_moved_slot_gives_a_new_form_and_leaves_the_old_one(form):
    before = dump_json(form)
    change = moved(form, "near", x=0.02, yaw=0.1)
    new = patched(form, [change])
    assert slot_of(new, "near") == change.after
    assert new["version"] == form["version"] + 1
    assert dump_json(form) == before
    assert dump_json(patched(form, [change])) == dump_json(new)
    assert slot_of(new, "far") == slot_of(form, "far")
    back = SlotChange("near", change.after, change.before)
    assert slot_of(changed_form(new, back), "near") == slot_of(form, "near")
    assert said(change) == "slot near moved by +20 mm, +0 mm, +6°"


def test_a_change_of_another_state_is_refused(form):
    change = moved(form, "near", x=0.02)
    with pytest.raises(InvalidInputError, match=r"in the review, the slot 'near' was at \(0.6 m.*here it is at \(0.62"):
        patched(form, [change, change])
    strange = replace(change, slot="neer")
    with pytest.raises(InvalidInputError, match=r"Unknown slot 'neer'\. Did you mean 'near'"):
        patched(form, [strange])


def test_the_hash_of_a_scene_follows_what_it_uses(form):
    task = task_from_json(form)
    other = task_from_json(patched(form, [moved(form, "far", y=0.01)]))
    for name in ("train1", "L1"):
        assert scene_content(task, condition_of(task, name)) != scene_content(other, condition_of(other, name))
    done = condition_of(task, "O1")  # the red can lies in the near slot, the mug in the far slot
    assert scene_content(task, done) == scene_content(task, condition_of(task_from_json(form), "O1"))
    region = build("coffee_machine").regions[0]
    frame = FrameChange("coffee_machine", region, replace(region, position=(0.0, 0.0, 0.1)))
    mug = FrameChange("plate", region, replace(region, position=(0.0, 0.0, 0.1)))
    assert scene_content(task, done, [frame]) != scene_content(task, done)
    assert scene_content(task, done, [mug]) == scene_content(task, done)


def test_moved_regions_apply_inside_the_context_only():
    region = build("coffee_machine").regions[0]
    there = replace(region, position=(0.01, 0.02, 0.03))
    with moved_regions({"coffee_machine": {region.name: there}}):
        assert build("coffee_machine").region(region.name) == there
    assert build("coffee_machine").region(region.name) == region


# ------------------------------------------------------------------------------------------------------------ verdicts


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A desk that does not build scenes."""
    monkeypatch.setattr(SceneDesk, "_open", lambda _: None)
    with SceneJournal(tmp_path / "ada.jsonl") as journal:
        opened = SceneDesk(scene_queue(["morning_coffee"]), journal, "ada")
        opened.open_first()
        yield opened


def kinds(desk):
    return [review.decision.kind for review in desk.journal.reviews]


def go(desk, name):
    desk._go([scene.condition for scene in desk.queue].index(name))


def select(desk, slot):
    desk.choose("slot")
    desk.selected = [s.name for s in desk.slots].index(slot)


def test_an_edit_is_a_decision_only_when_it_is_kept(desk):
    select(desk, "near")
    desk.nudge((0.005, 0.0, 0.0))
    desk.nudge((0.005, 0.0, 0.0), 5.0)
    assert desk.slot.x == pytest.approx(0.61)
    desk.drop_edit()
    assert kinds(desk) == []
    desk.drag(Pose((0.62, -0.1, 0.3), from_yaw(-1.4)))
    assert desk.keep()
    assert kinds(desk) == ["slot"]
    assert (desk.task.slot("near").x, desk.task.slot("near").y) == (0.62, -0.1)
    assert desk.task.slot("near").yaw == pytest.approx(-1.4, abs=1e-3)
    assert desk.is_changed
    desk.undo()
    assert kinds(desk) == ["slot", "undo"]
    assert not desk.is_changed
    desk.drag(Pose((9.0, 0.0, 0.0)))
    assert not desk.keep()
    assert desk.is_problem
    assert kinds(desk) == ["slot", "undo"]


def test_a_verdict_stands_until_its_scene_changes(desk):
    desk.accept()
    assert desk.journal.reviews[-1].decision == Verdict("accept")
    assert desk.index == 1
    assert [v.verdict if v else "" for v in desk.verdicts()[:2]] == ["accept", ""]
    select(desk, "far")
    desk.nudge((0.0, 0.005, 0.0))
    desk.accept()
    assert desk.journal.reviews[-1].decision == Verdict("fix")
    assert [v.verdict if v else "" for v in desk.verdicts()[:2]] == ["", "fix"]
    desk.undo()
    assert "Undone: fix of morning_coffee/train2" in desk.message
    assert desk.index == 1
    desk.undo()
    assert "Undone: slot far moved" in desk.message
    assert [v.verdict if v else "" for v in desk.verdicts()[:2]] == ["accept", ""]
    desk.reject(" ")
    assert "reason" in desk.message
    desk.reject("the mug hides the can")
    assert desk.verdicts()[1] == Verdict("reject", "the mug hides the can")


def test_only_frames_of_imported_assets_can_be_moved(desk, monkeypatch):
    region = build("coffee_machine").region("ring")
    placement = type("P", (), {"spec": type("S", (), {"name": "m"}), "asset": build("coffee_machine"), "pose": Pose()})
    monkeypatch.setattr(SceneDesk, "frame", property(lambda _: (placement, region)))
    monkeypatch.setattr(SceneDesk, "poses", lambda _: {"m": Pose((0.1, 0.0, 0.0))})
    desk.choose("frame")
    desk.drag(Pose((0.2, 0.0, 0.1)))
    assert desk.edit is None
    assert "part of the library" in desk.message
    desk.movable = frozenset({"coffee_machine"})
    desk.drag(Pose((0.2, 0.0, 0.1)))
    assert isinstance(desk.edit, FrameChange)
    assert desk.edit.after.position == pytest.approx((0.1, 0.0, 0.1))
    assert desk.keep()
    assert kinds(desk) == ["frame"]
    assert desk.is_changed


# ------------------------------------------------------------------------------------------------------------ writing


def judge_all(desk, reject=()):
    for scene in desk.queue:
        go(desk, scene.condition)
        if scene.condition in reject:
            desk.reject("too far")
        else:
            desk.accept()


def test_reviewed_tasks_are_new_files_with_the_same_bytes_every_time(desk, form, tmp_path):
    select(desk, "near")
    desk.nudge((0.005, 0.0, 0.0))
    desk.keep()
    judge_all(desk, reject=("O1",))
    found = reviewed_forms(tmp_path / "ada.jsonl")
    written = [write_reviewed_tasks(found, tmp_path / str(k))[0].read_bytes() for k in (1, 2)]
    assert written[0] == written[1]
    task = task_from_json(written[0])
    assert task.version == form["version"] + 1
    assert task.slot("near").x == pytest.approx(0.605)
    assert [v.name for v in task.variations] == ["L1", "L2", "L3", "L4", "T1"]
    assert found["morning_coffee"].rejected == {"O1": "too far"}
    assert found["morning_coffee"].moved


def test_unfinished_and_foreign_reviews_are_refused(desk, form):
    go(desk, "L1")
    desk.accept()
    with pytest.raises(InvalidInputError, match=r"9 of 10 conditions have no verdict: train1, train2"):
        reviewed_form(form, desk.history)
    judge_all(desk, reject=("train2",))
    with pytest.raises(InvalidInputError, match="the training condition train2 was rejected: too far"):
        reviewed_form(form, desk.history)


def test_a_review_of_another_task_file_is_refused(desk, form, tmp_path):
    other = {**form, "title": "Other"}
    line = SceneReview("ada", now(), task_content(other), "morning_coffee", "train1", "0" * 64, Verdict("accept"))
    with SceneJournal(tmp_path / "b.jsonl") as journal:
        journal.append(line)
    with pytest.raises(InvalidInputError, match=r"reviewed with the content .*, but its content is now"):
        reviewed_forms(tmp_path / "b.jsonl")


def test_the_file_reveals_changed_lines_and_wrong_decisions(desk, tmp_path):
    with pytest.raises(RecordError, match="it undoes line 3"):
        desk._write(Undo(3))
    with pytest.raises(RecordError, match="'fix' without a change"):
        desk._write(Verdict("fix"))
    desk.accept()
    desk.journal.close()
    path = tmp_path / "ada.jsonl"
    assert len(read_scene_reviews(path)) == 1
    path.write_text(path.read_text().replace('"accept"', '"reject"'))
    with pytest.raises(RecordError, match="line 1 does not match the lines before it"):
        read_scene_reviews(path)


def test_two_reviews_of_scenes_agree_as_far_as_they_do(desk, tmp_path, capsys):
    judge_all(desk, reject=("O1", "T1"))
    desk.journal.close()
    with SceneJournal(tmp_path / "bob.jsonl") as journal:
        second = SceneDesk(scene_queue(["morning_coffee"]), journal, "bob")
        judge_all(second, reject=("O1",))
    found = agreement(tmp_path / "ada.jsonl", tmp_path / "bob.jsonl")
    assert found.all.counts == ((8, 0, 0), (0, 0, 0), (1, 0, 1))
    assert found.apart == (("morning_coffee/T1", "reject", "accept"),)
    assert main(["review", "agree", str(tmp_path / "ada.jsonl"), str(tmp_path / "bob.jsonl")]) == 0
    assert "Both agree on 9 of 10 scenes; Cohen's kappa 0.62" in " ".join(capsys.readouterr().out.split())
    (tmp_path / "objects.jsonl").write_text("")
    with pytest.raises(InvalidInputError, match=r"is a review of scenes, but .* is not"):
        agreement(tmp_path / "ada.jsonl", tmp_path / "objects.jsonl")


# ------------------------------------------------------------------------------------------------------------ the queue


def test_tasks_and_conditions_are_queued_once():
    assert [s.name for s in scene_queue(["fruit_lunch/L1", "fruit_lunch/L1"])] == ["fruit_lunch/L1"]
    assert len(scene_queue(["fruit_lunch/L1", "fruit_lunch"])) == 8
    with pytest.raises(UnknownNameError, match="'train1'"):
        scene_queue(["fruit_lunch/trein1"])


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (["scenes"], "no task is given"),
        (["scenes", "x"], "Pass tasks with --tasks"),
        (["scenes", "--tasks", "fruit_lunsh"], "Did you mean 'fruit_lunch'"),
        (["assets"], "Pass the folder with --asset-dir"),
        (["--tasks", "fruit_lunch"], "better review scenes --tasks TASK"),
        (["apply", "a.jsonl"], "no folder is given"),
        (["apply", "--out", "x"], "0 review files are given"),
        (["apply", "a.jsonl", "--out", "x"], "does not exist"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, monkeypatch, capsys, given, text):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(user_files, "_files", {})  # other tests load folders of assets
    monkeypatch.delenv(user_files.VARIABLE, raising=False)
    assert main(["review", *given]) == 2
    assert text in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


# ------------------------------------------------------------------------------------------------------ built scenes


@pytest.mark.physics
def test_a_scene_moves_with_its_slot_and_certifies_again(tmp_path, monkeypatch):
    with SceneJournal(tmp_path / "ada.jsonl") as journal:
        desk = SceneDesk(scene_queue(["morning_coffee/L1"]), journal, "ada")
        desk.open_first()
        assert desk.problem == ""
        assert {region.name for _, region in desk.frames} >= {"ring"}
        select(desk, "near")
        mug = desk.condition.occupant("near")
        before = desk.poses()
        desk.nudge((0.0, -0.01, 0.0))
        after = desk.poses()
        assert {name for name in before if before[name] != after[name]} == {mug}
        assert after[mug].position[1] - before[mug].position[1] == pytest.approx(-0.01)
        desk.certify()
        assert desk.certified is not None
        assert desk.certified.passed, desk.message
        assert "Certified with seed 0" in desk.message
        assert desk.poses()[mug].position == pytest.approx(after[mug].position, abs=1e-6)
        desk.accept()
        assert [r.decision.kind for r in journal.reviews] == ["slot", "verdict"]
        assert journal.reviews[-1].decision == Verdict("fix")
        select(desk, "near")
        desk.nudge((-0.18, 0.0, 0.0))  # onto the other mug
        monkeypatch.setattr(examine, "watch_expert", lambda _: Watched("", 1, ()))  # it would try to the step limit
        desk.certify()
        assert not desk.certified.passed
        assert "c" in desk.certified.failed
        assert "Not certified" in desk.message
