"""Reviews of imported objects as data: laws of changes, the file of decisions, and their replay."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from betterbench.errors import InvalidInputError, RecordError, RunConflictError
from betterbench.geometry import IDENTITY_QUATERNION, Pose, from_axis_angle
from betterbench.interface.state import Region
from betterbench.jobs.decisions import now
from betterbench.sim.assets import build
from betterbench.sim.assets.asset import Grasp, VisualPart
from betterbench.sim.assets.authoring.registry import unregister
from betterbench.sim.assets.importing import child, imported
from betterbench.sim.assets.importing.importer import Wishes, import_mesh
from betterbench.sim.assets.importing.review import (
    GraspChange,
    MassChange,
    NameChange,
    Plane,
    PoseChange,
    RegionChange,
    Review,
    ReviewJournal,
    ReviewState,
    ScaleChange,
    SupportChange,
    Undo,
    Verdict,
    apply,
    changed,
    content_hash,
    history_of,
    read_reviews,
)
from betterbench.sim.assets.importing.review.journal import accepted
from betterbench.sim.assets.importing.stored import from_bytes, to_bytes

TILT = math.radians(30.0)
"""More than the import sets right by itself."""
SIDE = 0.04
"""Width of the block [m]."""
QUARTER = from_axis_angle((-0.5 * math.pi, 0.0, 0.0))


def cup():
    """Return a cup as a closed surface of revolution [m], standing on z = 0."""
    r, h, w = 0.035, 0.09, 0.004
    return trimesh.creation.revolve([(0, 0), (r, 0), (r, h), (r - w, h), (r - w, w), (0, w)], sections=12)


@pytest.fixture(scope="module")
def tilted(tmp_path_factory):
    """A cup that leans by 30 degrees in its file."""
    path = tmp_path_factory.mktemp("meshes") / "tumbler.stl"
    leaning = cup()
    leaning.apply_transform(trimesh.transformations.rotation_matrix(TILT, [1, 0, 0]))
    leaning.export(path)
    return import_mesh(path, Wishes(name="object", size_m=0.11294, mass_kg=0.2, up="z"))


@pytest.fixture(scope="module")
def block_mesh(tmp_path_factory):
    """A block that stands on its narrow side."""
    path = tmp_path_factory.mktemp("meshes") / "tumbler.stl"
    trimesh.creation.box((SIDE, SIDE, 0.09)).export(path)
    return path


@pytest.fixture(scope="module")
def block(block_mesh):
    return import_mesh(block_mesh, Wishes(name="object", size_m=0.09, mass_kg=0.2, up="z"))


def points(it):
    return np.concatenate([p.vertices for p in it.draft.parts if isinstance(p, VisualPart)]).astype(float)


def region_names(it):
    return {region.name for region in it.draft.regions}


# ------------------------------------------------------------------------------------------------------------ changes


def test_no_change_leaves_the_object_as_it_is(block):
    assert to_bytes(apply(block, [])) == to_bytes(block)


def test_a_cup_that_leans_is_righted(tilted):
    upright = apply(tilted, [PoseChange(IDENTITY_QUATERNION, from_axis_angle((-TILT, 0.0, 0.0)))])
    assert {"opening", "inside", "floor", "base"} <= region_names(upright)
    assert np.ptp(points(upright), axis=0) == pytest.approx((0.07, 0.07, 0.09), abs=2e-3)
    assert points(upright).min(axis=0)[2] == pytest.approx(0.0, abs=1e-6)
    opening = next(r for r in upright.draft.regions if r.name == "opening")
    assert opening.position == pytest.approx((0.0, 0.0, 0.09), abs=4e-3)
    assert opening.half_size[0] == pytest.approx(opening.half_size[1], abs=2e-3)
    body = upright.draft.body
    assert body.mass_kg == 0.2
    assert body.center_of_mass[:2] == pytest.approx((0.0, 0.0), abs=2e-3)
    assert upright.draft.grasps
    assert upright.fit.inside_m < 0.003


def test_the_same_changes_give_the_same_bytes(block):
    changes = [PoseChange(IDENTITY_QUATERNION, QUARTER), MassChange(0.2, 0.3), NameChange("object", "drinking cup")]
    one, two = apply(block, changes), apply(from_bytes(to_bytes(block), "block"), changes)
    assert to_bytes(one) == to_bytes(two)
    assert one.kind is not None
    assert one.draft.description.startswith("drinking cup")
    assert "cup" in one.draft.tags


def test_a_turn_and_its_inverse_give_back_the_shape(block):
    back = apply(block, [PoseChange(IDENTITY_QUATERNION, QUARTER), PoseChange(QUARTER, IDENTITY_QUATERNION)])
    assert np.abs(points(back) - points(block)).max() < 1e-6
    assert region_names(back) == region_names(block)


def test_scale_is_proportional_and_keeps_the_mass(block):
    longest = float(np.ptp(points(block), axis=0).max())
    small = apply(block, [ScaleChange(longest, 0.8 * longest)])
    assert np.abs(points(small) - 0.8 * points(block)).max() < 1e-6
    assert small.draft.mass_kg == block.draft.mass_kg
    ratio = np.array(small.draft.body.inertia[:3]) / np.array(block.draft.body.inertia[:3])
    assert ratio == pytest.approx([0.64] * 3, rel=0.03)
    assert max(g.width_m for g in small.draft.grasps) < max(g.width_m for g in block.draft.grasps)


def test_mass_scales_the_inertia_alone(block):
    heavy = apply(block, [MassChange(0.2, 0.5)])
    assert np.array(heavy.draft.body.inertia) == pytest.approx(2.5 * np.array(block.draft.body.inertia), rel=1e-5)
    assert heavy.draft.body.mass_kg == heavy.draft.mass_kg == 0.5
    assert (points(heavy) == points(block)).all()


def test_a_support_plane_levels_the_object_and_cuts_what_touches(block):
    tilt = math.radians(10.0)
    tilted = apply(block, [PoseChange(IDENTITY_QUATERNION, from_axis_angle((0.0, tilt, 0.0)))])
    normal = (math.sin(tilt), 0.0, math.cos(tilt))
    leveled = apply(tilted, [SupportChange(Plane(), Plane(normal, height_m=float((points(tilted) @ normal).min())))])
    assert np.ptp(points(leveled), axis=0) == pytest.approx(np.ptp(points(block), axis=0), abs=1e-4)
    raised = apply(block, [SupportChange(Plane(), Plane(height_m=0.01))])
    assert points(raised)[:, 2].min() == pytest.approx(-0.01, abs=1e-6)
    hulls = np.concatenate([p.vertices for p in raised.draft.parts if not isinstance(p, VisualPart)])
    assert hulls[:, 2].min() >= -1e-6
    with pytest.raises(InvalidInputError, match="below its support plane"):
        apply(block, [SupportChange(Plane(), Plane(height_m=0.5))])
    with pytest.raises(InvalidInputError, match="length 2"):
        apply(block, [SupportChange(Plane(), Plane((0.0, 0.0, 2.0)))])


def test_grasps_and_frames_are_added_moved_and_removed(block):
    first = block.draft.grasps[0]
    moved = replace(first, pose=first.pose.translated(0.0, 0.0, 0.01))
    new = Grasp("rim", Pose((0.033, 0.0, 0.085), first.pose.quaternion), 0.004)
    slot = Region("slot", (0.0, 0.0, 0.05), (0.01, 0.01, 0.001))
    done = apply(block, [GraspChange(first, moved), GraspChange(None, new), RegionChange(None, slot)])
    assert done.draft.grasps[0] == moved
    assert done.draft.grasps[-1] == new
    assert done.draft.regions[-1] == slot
    undone = apply(done, [RegionChange(slot, None), GraspChange(new, None), GraspChange(moved, first)])
    assert undone.draft.grasps == block.draft.grasps
    assert undone.draft.regions == block.draft.regions
    with pytest.raises(InvalidInputError, match="already exists"):
        apply(done, [GraspChange(None, new)])
    with pytest.raises(InvalidInputError, match="no grasp 'rim'"):
        apply(block, [GraspChange(new, None)])
    with pytest.raises(InvalidInputError, match="has no frame"):
        apply(block, [RegionChange(None, None)])


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (PoseChange(QUARTER, IDENTITY_QUATERNION), "rotation"),
        (ScaleChange(0.3, 0.1), "longest side was 0.3 m in the review, but is 0.09"),
        (MassChange(0.9, 0.1), "mass was 0.9 kg in the review, but is 0.2 kg here"),
        (NameChange("teapot", "cup"), "name was 'teapot' in the review, but is 'object' here"),
        (SupportChange(Plane((0.0, 1.0, 0.0)), Plane()), "support plane"),
    ],
)
def test_a_change_of_another_state_is_refused(block, change, text):
    with pytest.raises(InvalidInputError, match=text) as caught:
        changed(ReviewState(block), change, where="tumbler.stl")
    assert str(caught.value).startswith("tumbler.stl: ")
    assert "\n" not in str(caught.value)


# --------------------------------------------------------------------------------------------------- content and file


def test_the_content_hash_follows_the_file_and_what_it_refers_to(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("mtllib a.mtl\nv 0 0 0\n")
    without = content_hash(path)
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd a.png\n")
    plain = content_hash(path)
    Image.new("RGB", (2, 2), "red").save(tmp_path / "a.png")
    painted = content_hash(path)
    (tmp_path / "reviews.jsonl").write_text("beside it")
    assert content_hash(path) == painted
    Image.new("RGB", (2, 2), "blue").save(tmp_path / "a.png")
    assert len({without, plain, painted, content_hash(path)}) == 4
    assert all(len(h) == 64 for h in (plain, painted))


def review(decision, *, content="a" * 64, author="ada", size=(SIDE, SIDE, 0.09), asset="tumbler.stl"):
    return Review(author, now(), content, asset, size, decision)


def write(path, *reviews):
    with ReviewJournal(path) as journal:
        for one in reviews:
            journal.append(one)


def test_decisions_are_kept_in_order_and_undoing_appends(tmp_path):
    path = tmp_path / "r.jsonl"
    write(path, review(MassChange(0.2, 0.3)), review(MassChange(0.3, 0.4)), review(Undo(2)), review(Verdict("fix")))
    assert len(path.read_text().splitlines()) == 4
    history = history_of(path, "a" * 64, "tumbler.stl")
    assert history.changes == (MassChange(0.2, 0.3),)
    assert history.verdict == Verdict("fix")
    write(path, review(Undo(4)), review(Undo(1)), review(Verdict("accept")))
    assert history_of(path, "a" * 64, "tumbler.stl").changes == ()
    assert len(read_reviews(path)) == 7


def test_every_kind_of_decision_survives_the_file(tmp_path, block):
    grasp, region = block.draft.grasps[0], block.draft.regions[0]
    decisions = [
        PoseChange(IDENTITY_QUATERNION, QUARTER),
        ScaleChange(0.09, 0.1),
        SupportChange(Plane(), Plane(height_m=0.002)),
        GraspChange(grasp, None),
        GraspChange(None, grasp),
        RegionChange(region, replace(region, half_size=(0.01, 0.01, 0.001))),
        MassChange(0.2, 0.25),
        NameChange("object", "mug"),
        Verdict("reject", "the wall leaks"),
        Undo(9),
    ]
    write(tmp_path / "r.jsonl", *map(review, decisions))
    assert [r.decision for r in read_reviews(tmp_path / "r.jsonl")] == decisions


def test_a_change_after_a_verdict_makes_it_pending(tmp_path):
    path = tmp_path / "r.jsonl"
    write(path, review(Verdict("accept")), review(MassChange(0.2, 0.3)))
    assert history_of(path, "a" * 64, "x").verdict is None


@pytest.mark.parametrize(
    ("decision", "text"),
    [
        (Undo(7), "undoes line 7, which is not the last active decision on tumbler.stl .it is line 1"),
        (Verdict("accept"), "'accept' with 1 changes of tumbler.stl, expected 'fix'"),
    ],
)
def test_decisions_that_do_not_fit_are_not_written(tmp_path, decision, text):
    path = tmp_path / "r.jsonl"
    with ReviewJournal(path) as journal:
        journal.append(review(MassChange(0.2, 0.3)))
        before = path.read_bytes()
        with pytest.raises(RecordError, match=text):
            journal.append(review(decision))
        assert path.read_bytes() == before


@pytest.mark.parametrize(
    "decision",
    [
        MassChange(0.2, math.inf),
        MassChange(0.2, -1.0),
        ScaleChange(0.1, 40.0),
        NameChange("a", " "),
        GraspChange(None, Grasp("g", Pose((math.nan, 0.0, 0.0)), 0.02)),
    ],
)
def test_values_out_of_range_are_not_written(tmp_path, decision):
    path = tmp_path / "r.jsonl"
    with ReviewJournal(path) as journal, pytest.raises(InvalidInputError):
        journal.append(review(decision))
    assert path.read_bytes() == b""


def test_a_rejection_needs_a_reason():
    with pytest.raises(ValueError, match="must have a reason"):
        Verdict("reject", "  ")


def test_a_torn_last_line_is_cut_off_and_the_rest_is_kept(tmp_path):
    path = tmp_path / "r.jsonl"
    write(path, review(MassChange(0.2, 0.3)))
    whole = path.read_bytes()
    path.write_bytes(whole + whole[:40])
    assert len(read_reviews(path)) == 1
    write(path, review(Verdict("fix")))
    assert [r.decision.kind for r in read_reviews(path)] == ["mass", "verdict"]


def test_a_file_that_was_changed_by_hand_is_one_clear_line(tmp_path):
    path = tmp_path / "r.jsonl"
    write(path, review(MassChange(0.2, 0.3)), review(Verdict("fix")))
    lines = path.read_text().splitlines()
    for damaged in ([lines[0].replace("0.3", "0.4"), lines[1]], lines[1:], lines[::-1], ["[]", lines[1]]):
        path.write_text("\n".join(damaged) + "\n")
        for use in (read_reviews, ReviewJournal):
            with pytest.raises(RecordError, match=r"r\.jsonl: line 1 (does not match|is corrupt)") as caught:
                use(path)
            assert "\n" not in str(caught.value)
    path.write_text("a diary\nof mine\n")
    with pytest.raises(RecordError, match="line 1"):
        ReviewJournal(path)


def test_two_writers_at_once_are_refused(tmp_path):
    path = tmp_path / "r.jsonl"
    with ReviewJournal(path), pytest.raises(RunConflictError, match="another process"):
        ReviewJournal(path)
    write(path, review(Verdict("accept")))


# ------------------------------------------------------------------------------------------------------------- replay


def history(tmp_path, content, *decisions, size=(SIDE, SIDE, 0.09)):
    path = tmp_path / "reviews.jsonl"
    write(path, *(review(d, content=content, size=size) for d in decisions))
    return history_of(path, content, "tumbler.stl")


def test_only_what_was_accepted_is_used(tmp_path, block, block_mesh):
    content = content_hash(block_mesh)
    pose = PoseChange(IDENTITY_QUATERNION, QUARTER)
    with pytest.raises(InvalidInputError, match="1 changes and no verdict"):
        accepted(block, history(tmp_path, content, pose), asset="tumbler.stl", content=content)
    size = ReviewState(apply(block, [pose])).size_m
    found = history(tmp_path, content, Verdict("fix"), size=size)
    used = accepted(block, found, asset="tumbler.stl", content=content)
    assert np.ptp(points(used), axis=0) == pytest.approx((SIDE, 0.09, SIDE), abs=1e-5)
    with pytest.raises(InvalidInputError, match=f"content {content[:16]}, but the file has {'b' * 16}"):
        accepted(block, found, asset="tumbler.stl", content="b" * 64)
    small = import_mesh(block_mesh, Wishes(name="object", size_m=0.05, up="z"))
    with pytest.raises(InvalidInputError, match="accepted with a size of"):
        accepted(small, found, asset="tumbler.stl", content=content)


@pytest.mark.usefixtures("imports_here")
def test_a_task_gets_the_reviewed_object_and_no_rejected_one(tmp_path, monkeypatch, block_mesh):
    monkeypatch.setattr(child, "cache_folder", lambda: tmp_path / "cache")
    path = Path(block_mesh.parent / "reviews.jsonl")
    content = content_hash(block_mesh)
    before = child.import_safely(block_mesh, Wishes(name="object", size_m=0.09, up="z"))
    state = changed(ReviewState(before), PoseChange(IDENTITY_QUATERNION, QUARTER))
    write(path, review(PoseChange(IDENTITY_QUATERNION, QUARTER), content=content, size=(SIDE, SIDE, 0.09)))
    write(path, review(Verdict("fix"), content=content, size=state.size_m))
    options = {"color": "gray", "name": "object", "size_m": 0.09, "up": "z", "review": path}

    def built():
        imported("reviewed_tumbler", block_mesh, any_license=True, **options)
        try:
            return build("reviewed_tumbler")
        finally:
            unregister("reviewed_tumbler")

    first = built()
    assert first.size_m == pytest.approx((SIDE, 0.09, SIDE), abs=1e-5)
    stored = {p.name: p.read_bytes() for p in (tmp_path / "cache").rglob("*.npz")}
    monkeypatch.setattr(child, "cache_folder", lambda: tmp_path / "fresh")
    assert built().content_hash() == first.content_hash()
    assert {p.name: p.read_bytes() for p in (tmp_path / "fresh").rglob("*.npz")} == stored
    for damaged in (tmp_path / "fresh" / "reviewed").iterdir():
        damaged.write_bytes(b"damaged")
    assert built().content_hash() == first.content_hash()
    write(path, review(Verdict("reject", "it looks like a pipe"), content=content, size=state.size_m))
    with pytest.raises(InvalidInputError, match=r"ada rejected it on .*: it looks like a pipe"):
        built()
    other = tmp_path / "tumbler.stl"
    other.write_bytes(block_mesh.read_bytes() + b" ")
    with pytest.raises(InvalidInputError, match=f"{content[:16]}, but the file now has {content_hash(other)[:16]}"):
        history_of(path, content_hash(other), "tumbler.stl")
    with pytest.raises(RecordError, match="does not exist"):
        read_reviews(tmp_path / "none.jsonl")
    assert json.loads(path.read_text().splitlines()[0])["decision"]["kind"] == "pose"
