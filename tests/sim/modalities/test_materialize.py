"""Modalities follow from records alone, agree with each other and with rays, and are what the policy saw."""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest
from tests.looping import each
from tests.resealing import rewrite
from tests.sim.modalities.agreement import (
    Rays,
    boxes_fit_the_masks,
    camera_of,
    centers_lie_in_the_boxes,
    pixels_off_the_objects,
)
from tests.sim.modalities.conftest import VIEWS, draw_in_one_process

from betterbench.errors import InvalidInputError, RecordError, RunConflictError, StorageError, UnknownNameError
from betterbench.geometry import Pose
from betterbench.jobs import durable
from betterbench.records import RunFolder
from betterbench.records.modalities.file import ModalityFile
from betterbench.records.modalities.labels import SEMANTIC_IDS, STAGE, semantic_id, semantic_ids
from betterbench.records.modalities.spec import PlacedCamera, ViewSpec
from betterbench.sim.assets import categories
from betterbench.sim.modalities.folder import ModalityFolder, Wanted
from betterbench.sim.modalities.run import default_views, materialize_run

pytestmark = [pytest.mark.physics, pytest.mark.render]

PLACED = ViewSpec("top", 80, 60, PlacedCamera((0.45, 0.0, 1.3), (0.45, 0.0, 0.0), 40.0))


def hashes(folder):
    names = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.name != ".lock"]
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in names}


def place(folder, view, seed=0):
    return folder / "fast_food" / "train1" / str(seed) / f"{view.name}.parquet"


@pytest.fixture(scope="module")
def made(recorded, processes, tmp_path_factory):
    out = tmp_path_factory.mktemp("later") / "modalities"
    with pytest.MonkeyPatch.context() as patch:
        draw_in_one_process(patch, processes)
        done = materialize_run(recorded.run, out, Wanted((*VIEWS, PLACED)))
    assert (done.trials, done.files, done.kept, done.rows) == (2, 6, 0, 2 * 3 * len(recorded.records[0]))
    return out


def test_colors_are_what_the_policy_saw_pixel_for_pixel(recorded, made):
    for seed, seen in recorded.seen.items():
        for view in VIEWS:
            with ModalityFile(place(made, view, seed)) as file:
                for observation in seen:
                    colors = file.read(observation.step, ["rgb"])["rgb"]
                    np.testing.assert_array_equal(colors, observation.images[view.camera])
                assert len(seen) == len(file) - 1  # nobody is asked after the last step


def test_drawn_while_recording_is_drawn_later_byte_for_byte(recorded, made):
    later = hashes(made)
    live = hashes(recorded.live)
    parquet = [name for name in live if name.endswith(".parquet")]
    assert len(parquet) == 4
    assert all(live[name] == later[name] for name in parquet)


@pytest.mark.slow
def test_two_workers_draw_the_same_bytes(recorded, made, tmp_path):
    materialize_run(recorded.run, tmp_path / "modalities", Wanted((*VIEWS, PLACED)), workers=2)
    assert hashes(tmp_path / "modalities") == hashes(made)


def test_boxes_are_tight_to_the_masks_and_fractions_are_those_of_pixels(recorded, made):
    for view in (*VIEWS, PLACED):
        with ModalityFile(place(made, view)) as file:
            assert sum(boxes_fit_the_masks(file.header, values) for values in file.rows()) > 0


def test_centers_lie_in_the_boxes_and_depth_on_the_objects(recorded, made):
    for view in (*VIEWS, PLACED):
        with ModalityFile(place(made, view)) as file:
            for values in file.rows():
                centers_lie_in_the_boxes(file.header, values)
                assert pixels_off_the_objects(file.header, values)[0] == 0


def test_rays_hit_what_masks_and_depth_say(recorded, made):
    rays, draw = Rays(recorded.run, recorded.records[0]), np.random.default_rng(3)
    agreed = 0
    for row, view in ((0, VIEWS[0]), (len(recorded.records[0]) - 1, VIEWS[1]), (2, PLACED)):
        with ModalityFile(place(made, view)) as file:
            agreed += rays.agreeing(file.header, file.read(row), draw, pixels=150)
    # The rest are pixels at an edge, whose ray passes the other side of it by a rounding error.
    assert agreed >= 0.99 * 3 * 150


def test_flow_leads_to_where_the_point_is_next(recorded, made):
    record, view = recorded.records[0], VIEWS[1]
    with ModalityFile(place(made, view)) as file:
        here, there = file.read(1), file.read(2)
        thing = next(o for i, o in enumerate(file.header.objects) if here["visible_pixels"][i] > 4)
        i = thing.instance - file.header.objects[0].instance
        before, after = camera_of(file.header, here), camera_of(file.header, there)
        assert np.isnan(file.read(len(record) - 1)["flow"]).all()
    points = before.unproject(here["depth"])
    rows, columns = np.nonzero(here["instances"] == thing.instance)
    poses = [Pose(tuple(record.object_positions[t, i]), tuple(record.object_quaternions[t, i])) for t in (1, 2)]
    moved = np.array([(poses[1] @ poses[0].inverse()).apply(p) for p in points[rows, columns]])
    pixels, _ = after.project(moved)
    told = here["flow"][rows, columns].astype(float) + np.stack([columns, rows], axis=1)
    assert np.abs(here["flow"][rows, columns]).max() > 0.5
    np.testing.assert_allclose(told, pixels, atol=0.03)
    with ModalityFile(place(made, VIEWS[0])) as file:
        values = file.read(0)
        assert not values["flow"][values["instances"] == file.header.stage["table"]].any()  # neither it nor we move


def test_any_row_is_read_alone_and_by_any_reader_of_parquet(recorded, made):
    path = place(made, VIEWS[1])
    table = pq.read_table(path)
    with ModalityFile(path) as file:
        assert len(file) == len(recorded.records[0])
        for row in (3, 0, 4):
            values = file.read(row)
            assert values["row"] == row
            depth = np.frombuffer(table.column("depth")[row].as_py(), "<f4").reshape(48, 64)
            np.testing.assert_array_equal(depth, values["depth"])
            assert table.column("camera_position")[row].as_py() == values["camera_position"].tolist()
            assert values["semantics"].tolist() == np.take(file.header.semantics, values["instances"]).tolist()
        with pytest.raises(IndexError):
            file.read(5)
        with pytest.raises(RecordError, match="no column 'normals'"):
            file.read(0, ["normals"])


def test_it_resumes_to_the_same_bytes_and_keeps_what_is_there(recorded, made, tmp_path, one_process):
    again = tmp_path / "modalities"
    shutil.copytree(made, again)
    place(again, VIEWS[0]).unlink()
    place(again, VIEWS[1], seed=1).write_bytes(b"PAR1 torn")
    (place(again, VIEWS[0]).parent / f".{VIEWS[0].name}.parquet.abcd1234.part").write_bytes(b"half")
    done = materialize_run(recorded.run, again, Wanted((*VIEWS, PLACED)))
    assert (done.files, done.kept) == (2, 4)
    assert hashes(again) == hashes(made)
    with pytest.raises(RunConflictError, match=r"materialize\.modalities"):
        materialize_run(recorded.run, again, Wanted((*VIEWS, PLACED), ("rgb",)))
    rewrite(again / "materialize.json", lambda form: form["renderer"].update(renderer="another card"))
    place(again, VIEWS[0]).unlink()
    with pytest.raises(RunConflictError, match="another card"):
        materialize_run(recorded.run, again, Wanted((*VIEWS, PLACED)))


def test_a_damaged_record_is_one_line_and_the_others_are_done(recorded, tmp_path, one_process):
    shutil.copytree(recorded.run.path, tmp_path / "run")
    run = RunFolder.open(tmp_path / "run")
    path = run.record_path("fast_food", "train1", 0)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(RecordError, match=r"0\.parquet: the record is damaged") as problem:
        materialize_run(run, tmp_path / "out", Wanted((VIEWS[1],), ("boxes",)))
    assert "\n" not in str(problem.value)
    assert "more trials" not in str(problem.value)
    with ModalityFile(place(tmp_path / "out", VIEWS[1], seed=1)) as file:
        assert file.check() == len(recorded.records[1])
        assert "rgb" not in file.read(0)
    assert not place(tmp_path / "out", VIEWS[1]).exists()


class _Full(io.FileIO):
    """A file on a disk that is full after some bytes."""

    def write(self, data):
        if self.tell() + len(data) > 2000:
            raise OSError(28, os.strerror(28))
        return super().write(data)


def test_a_full_disk_is_one_line_and_leaves_nothing_behind(recorded, tmp_path, monkeypatch, one_process):
    wanted = Wanted((VIEWS[1],), ("rgb",))
    ModalityFolder(tmp_path / "out", wanted)
    monkeypatch.setattr(durable.os, "fdopen", _Full)
    with pytest.raises(StorageError, match="No space left on device") as problem:
        materialize_run(recorded.run, tmp_path / "out", wanted)
    assert "\n" not in str(problem.value)
    assert not list((tmp_path / "out").rglob("*.parquet*"))


def test_damage_to_a_file_is_found(made, tmp_path):
    path = tmp_path / "x.parquet"
    data = bytearray(place(made, VIEWS[1]).read_bytes())
    data[len(data) // 3] ^= 16
    path.write_bytes(data)
    with pytest.raises(RecordError, match=r"x\.parquet: is damaged"), ModalityFile(path) as file:
        file.check()
    path.write_bytes(b"")
    with pytest.raises(RecordError, match="damaged"):
        ModalityFile(path)
    with pytest.raises(RecordError, match="the file does not exist"):
        ModalityFile(tmp_path / "none.parquet")


def test_semantic_ids_are_given_once_and_hold_every_category(made):
    known = json.loads((made / "semantics.json").read_text())["ids"]
    assert set(categories()) | set(STAGE) <= set(SEMANTIC_IDS) <= set(known)
    assert len(set(known.values())) == len(known)
    assert 0 not in known.values()
    # Numbers in files of others: never to be changed.
    some = [semantic_id(n) for n in ("floor", "left_finger", "apple", "waste_bin", "my own gadget")]
    assert some == [1, 6, 16, 65, 55526]
    assert semantic_ids(["my own gadget"])["my own gadget"] == 55526


@pytest.mark.parametrize(
    ("text", "view"),
    [
        ("front", ViewSpec("front")),
        ("wrist:448", ViewSpec("wrist", 448, 448)),
        ("left_shoulder:320x180", ViewSpec("left_shoulder", 320, 180)),
        ("top=0.45,0,1.3/0.45,0,0/40:80x60", PLACED),
    ],
)
def test_views_are_read_from_texts(text, view):
    assert ViewSpec.parse(text) == view
    assert ViewSpec.parse(view.text) == view


@each(
    "text",
    ["", "front:0", "front:1x2x3", "front:-5", "../x", "a=1,2/3", "a=0,0,0/0,0,0/40", "a=0,0,nan/1,0,0/40", "f:9999"],
)
def test_bad_views_are_one_line(text):
    with pytest.raises(InvalidInputError):
        ViewSpec.parse(text)


def test_an_unknown_camera_is_named():
    with pytest.raises(UnknownNameError, match=r"'left_sholder'. Did you mean 'left_shoulder'"):
        Wanted((ViewSpec("left_sholder"),))


def test_views_of_a_run_are_those_of_its_policy():
    run = RunFolder.__new__(RunFolder)
    object.__setattr__(run, "plan", {"observation": {"name": "droid"}})
    assert default_views(run) == (ViewSpec("left_shoulder", 320, 180), ViewSpec("wrist", 320, 180))
    object.__setattr__(run, "plan", {"observation": {"name": "state_only"}})
    assert default_views(run) == (ViewSpec("front"), ViewSpec("wrist"))
