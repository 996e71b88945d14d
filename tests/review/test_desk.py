"""The desk of a reviewer, and the agreement of two: edits, verdicts and undoing without a page."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace

import pytest
import trimesh
from tests.kept_registry import kept_registry

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, RecordError
from betterbench.geometry import Pose, from_axis_angle
from betterbench.review.agreement import agreement
from betterbench.review.desk import ReviewDesk
from betterbench.review.drawing import box_edges, foot, head, ruler, turned_about_middle
from betterbench.review.panel import queue_list
from betterbench.review.queue import QueuedObject, folder_queue, queue_of
from betterbench.sim.assets.authoring.registry import asset_of, unregister
from betterbench.sim.assets.folders.manifest import FolderAsset, manifest_bytes, manifest_of
from betterbench.sim.assets.folders.reviewed import stored_asset, write_reviewed_folder
from betterbench.sim.assets.importing import imported
from betterbench.sim.assets.importing.importer import Wishes, import_mesh
from betterbench.sim.assets.importing.registration import mesh_imports
from betterbench.sim.assets.importing.review import ReviewJournal, ReviewState, read_reviews
from betterbench.sim.assets.importing.stored import to_bytes
from betterbench.sim.scenes.tryouts import try_drop, try_lift
from betterbench.tasks.user_files import ASSET_MANIFEST


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    path = tmp_path_factory.mktemp("meshes") / "block.stl"
    trimesh.creation.box((0.05, 0.04, 0.06)).export(path)
    return path, import_mesh(path, Wishes(name="block", size_m=0.06, mass_kg=0.1, up="z"))


@pytest.fixture
def desk(block, tmp_path):
    path, made = block
    queue = [QueuedObject(path, digit * 64, [ReviewState(made)]) for digit in "ab"]
    with ReviewJournal(tmp_path / "r.jsonl") as journal:
        opened = ReviewDesk(queue, journal, "ada")
        opened.open_first()
        yield opened


def kinds(desk):
    return [r.decision.kind for r in desk.journal.reviews]


def test_an_edit_is_a_decision_only_when_it_is_kept(desk):
    desk.turn_by((1.0, 0.0, 0.0), 90.0)
    desk.turn_by((1.0, 0.0, 0.0), -5.0)
    assert kinds(desk) == []
    desk.drop_edit()
    assert desk.edit is None
    desk.turn_by((1.0, 0.0, 0.0), 90.0)
    assert desk.keep()
    assert kinds(desk) == ["pose"]
    assert desk.state.size_m == pytest.approx((0.05, 0.06, 0.04), abs=1e-5)
    desk.undo()
    assert kinds(desk) == ["pose", "undo"]
    assert desk.state.size_m == pytest.approx((0.05, 0.04, 0.06), abs=1e-5)
    desk.undo()
    assert desk.is_problem
    assert "nothing to undo" in desk.message


def test_another_kind_of_edit_keeps_the_one_in_progress(desk):
    desk.weigh(0.15)
    desk.call("wooden block")
    desk.choose("grasp")
    desk.accept()
    assert kinds(desk) == ["mass", "name", "verdict"]
    assert desk.journal.reviews[-1].decision.verdict == "fix"
    assert desk.index == 1
    desk.accept()
    assert desk.journal.reviews[-1].decision.verdict == "accept"
    assert desk.judged == 2


def test_the_gizmo_moves_what_is_chosen(desk):
    desk.choose("support")
    desk.drag(Pose((0.0, 0.0, 0.005), from_axis_angle((0.0, 0.0, 1.0))))
    assert desk.plane.height_m == pytest.approx(0.005)
    desk.drop_edit()
    desk.choose("frame")
    first = desk.region
    desk.drag(Pose((0.01, 0.0, 0.02)))
    assert desk.edit.before == first
    desk.drag(Pose((0.02, 0.0, 0.02)))
    assert desk.edit.before == first
    assert desk.region.position == (0.02, 0.0, 0.02)
    desk.choose("grasp")
    desk.add()
    desk.drag(Pose((0.0, 0.01, 0.03), desk.grasp.pose.quaternion))
    assert desk.keep()
    added = desk.state.imported.draft.grasps[-1]
    assert added.pose.position == (0.0, 0.01, 0.03)
    assert added.preference == min(g.preference for g in desk.state.imported.draft.grasps)
    desk.selected = len(desk.state.imported.draft.grasps) - 1
    desk.remove()
    assert added.name not in {g.name for g in desk.state.imported.draft.grasps}
    assert kinds(desk) == ["region", "grasp", "grasp"]


def test_what_is_not_possible_is_said_and_neither_computed_nor_written(desk, monkeypatch):
    monkeypatch.delattr("betterbench.review.desk.changed")
    for edit in (lambda: desk.size(5.0), lambda: desk.weigh(-1.0), lambda: desk.call(" ")):
        edit()
        assert not desk.keep()
        assert desk.is_problem
        assert "\n" not in desk.message
    desk.reject("  ")
    assert "reason" in desk.message
    desk.choose("pose")
    desk.add()
    assert desk.is_problem
    assert kinds(desk) == []


def test_a_review_goes_on_where_it_stopped(desk, block, tmp_path):
    desk.turn_by((0.0, 1.0, 0.0), 90.0)
    desk.accept()
    desk.journal.close()
    with ReviewJournal(tmp_path / "r.jsonl") as journal:
        again = ReviewDesk(desk.queue, journal, "bob")
        again.open_first()
        assert again.index == 1
        assert len(journal.history("a" * 64).changes) == 1


def test_the_block_is_dropped_and_lifted(desk):
    assert desk.try_drop().passed
    lifted = desk.try_lift()
    assert lifted.passed, lifted.sentence
    assert lifted.asset[-1, 2] > 0.08
    assert set(lifted.gripper) == {"hand", "left_finger", "right_finger"}


def test_bad_objects_fail_the_trials(block):
    asset = asset_of(block[1].draft, "block", color="gray")
    wide = type(asset.grasps[0])("wrong", Pose((0.0, 0.0, 0.2), asset.grasps[0].pose.quaternion), 0.04)
    assert "without lifting" in try_lift(asset, wide).sentence
    tall = replace(asset, center_of_mass=(0.0, 0.06, 0.05))
    fallen = try_drop(tall)
    assert not fallen.passed
    assert "Tips over" in fallen.sentence


def test_what_is_drawn(desk, block):
    assert box_edges((0.5, 0.5, 0.5)).shape == (12, 2, 3)
    assert len(ruler((0.05, 0.04, 0.06))) == 12 + 5 + 4 + 6
    asset = desk.asset
    turned = turned_about_middle(asset, Pose((0.0, 0.0, 0.0), from_axis_angle((math.pi / 4, 0.0, 0.0))))
    lowest = min(turned.apply(v)[2] for part in asset.visual for v in part.vertices.tolist())
    assert lowest == pytest.approx(0.0, abs=1e-9)
    desk.call("<script>x</script>")
    assert "<script>" not in head(desk) + foot(desk) + queue_list([q.name for q in desk.queue], desk.verdicts(), 0)


# ------------------------------------------------------------------------------------------------------ the command


def judge(path, queue, *verdicts):
    with ReviewJournal(path) as journal:
        desk = ReviewDesk(queue, journal, path.stem)
        desk.open_first()
        for verdict in verdicts:
            if verdict == "fix":
                desk.weigh(0.2)
            if verdict == "reject":
                desk.reject("too heavy")
            else:
                desk.accept()


def test_two_reviews_agree_as_far_as_they_do(block, tmp_path, capsys):
    path, made = block
    a, b = tmp_path / "ada.jsonl", tmp_path / "bob.jsonl"
    judge(a, [QueuedObject(path, d * 64, [ReviewState(made)]) for d in "abcd"], "accept", "fix", "reject", "accept")
    judge(b, [QueuedObject(path, d * 64, [ReviewState(made)]) for d in "abc"], "accept", "reject", "reject")
    found = agreement(a, b)
    assert found.all.counts == ((1, 0, 0), (0, 0, 1), (0, 0, 1))
    assert found.usable.counts == ((1, 1), (0, 1))
    assert (found.only_first, found.only_second) == (1, 0)
    assert found.apart == (("block.stl", "fix", "reject"),)
    assert main(["review", "agree", str(a), str(b)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Both agree on 2 of 3 objects; Cohen's kappa 0.50" in said
    assert main(["review", "agree", str(a), str(b), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["use_reject"]["kappa"] == pytest.approx(0.4)
    empty = tmp_path / "c.jsonl"
    judge(empty, [QueuedObject(path, "e" * 64, [ReviewState(made)])], "accept")
    with pytest.raises(InvalidInputError, match="have none in common"):
        agreement(a, empty)
    with pytest.raises(RecordError, match="does not exist"):
        agreement(a, tmp_path / "d.jsonl")
    assert len(read_reviews(a)) == 5


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (["nowhere"], "nowhere: it does not exist"),
        ([], "no mesh file was found"),
        (["text.txt"], "its format is not known"),
        (["agree", "a.jsonl"], "1 files are given"),
        (["block.stl", "--json"], "--json"),
        (["block.stl", "--author", "two\nlines"], "--author"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, monkeypatch, capsys, given, text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.txt").write_text("x")
    (tmp_path / "block.stl").write_text("x")
    assert main(["review", *given]) == 2
    assert text in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "reviews.jsonl").exists()


def test_files_of_the_same_content_are_one_object(block, tmp_path):
    for name in ("a.stl", "b.stl"):
        (tmp_path / name).write_bytes(block[0].read_bytes())
    (tmp_path / "c.txt").write_text("not a mesh")
    assert [q.path.name for q in queue_of([tmp_path, block[0]])] == ["a.stl"]


def test_what_a_task_file_imports_is_reviewed_with_its_options(block, tmp_path):
    imported("reviewed_block", block[0], color="gray", name="wooden block", size_m=0.08, any_license=True)
    try:
        (queued,) = queue_of([], mesh_imports())
        assert queued.wishes.name == "wooden block"
        assert queued.wishes.size_m == 0.08
        assert queue_of([block[0]], mesh_imports())[0].wishes == queued.wishes
        assert queue_of([block[0]])[0].wishes == Wishes()
    finally:
        unregister("reviewed_block")
    assert mesh_imports() == ()


# ---------------------------------------------------------------------------------------------------- asset folders


@pytest.fixture
def asset_folder(block, tmp_path):
    """A folder with two imported assets."""
    folder = tmp_path / "my_assets"
    folder.mkdir()
    listed = {}
    for k, name in enumerate(("my_block", "my_brick")):
        whole = to_bytes(replace(block[1], notes=(f"number {k}",)))
        (folder / f"{name}.npz").write_bytes(whole)
        listed[name] = FolderAsset(
            file=f"{name}.npz",
            sha256=hashlib.sha256(whole).hexdigest(),
            color="gray",
            size_m=(0.05, 0.04, 0.06),
            mass_kg=0.1,
            license="CC0-1.0",
            source="block.stl",
        )
    (folder / ASSET_MANIFEST).write_bytes(manifest_bytes(listed))
    with kept_registry():
        yield folder


def test_the_assets_of_a_folder_are_reviewed_and_written_anew(asset_folder, tmp_path, capsys):
    queue = folder_queue([asset_folder])
    assert [item.name for item in queue] == ["my_block", "my_brick"]
    reviews = tmp_path / "r.jsonl"
    judge(reviews, queue[:1], "fix")
    options = ["--asset-dir", str(asset_folder), "--out"]
    assert main(["review", "apply", str(reviews), *options, str(tmp_path / "early")]) == 2
    assert "my_brick: r.jsonl has no decision" in " ".join(capsys.readouterr().err.split())
    judge(reviews, queue[1:], "reject")
    for name in ("one", "two"):
        assert main(["review", "apply", str(reviews), *options, str(tmp_path / name)]) == 0
    assert "my_brick is left out: too heavy" in " ".join(capsys.readouterr().err.split())
    files = [{p.name: p.read_bytes() for p in (tmp_path / n).iterdir() if p.suffix != ".lock"} for n in ("one", "two")]
    assert files[0]["my_block.npz"] == files[1]["my_block.npz"]
    assert files[0][ASSET_MANIFEST] == files[1][ASSET_MANIFEST]
    (entry,) = manifest_of(tmp_path / "one").assets.values()
    assert entry.mass_kg == 0.2
    assert stored_asset(tmp_path / "one", "my_block").draft.mass_kg == 0.2
    assert stored_asset(asset_folder, "my_block").draft.mass_kg == 0.1
    with pytest.raises(InvalidInputError, match="Use a different folder"):
        write_reviewed_folder(asset_folder, asset_folder, {})
    with pytest.raises(InvalidInputError, match="it has no asset 'my_blok'"):
        stored_asset(asset_folder, "my_blok")


def test_the_needed_opening_of_a_grasp_is_shown(desk):
    desk.choose("grasp")
    assert "needs an opening of" in foot(desk)
    before = desk.grasp
    desk.drag(before.pose.translated(z=0.2))
    assert "there is nothing between the pads" in foot(desk)
