"""Sources of assets: what they list, and what they make of damaged and hostile files."""

from __future__ import annotations

import gzip
import hashlib
import json
import struct

import pytest
from tests.looping import each

from betterbench.errors import InvalidInputError, MissingDependencyError, UnknownNameError
from betterbench.sim.assets.catalogue.sources import SOURCES, SourceOptions, open_source
from betterbench.sim.assets.catalogue.sources.mesh_facts import mesh_facts
from betterbench.sim.assets.catalogue.sources.procedural import asset_address
from betterbench.sim.assets.catalogue.terms import terms
from betterbench.sim.assets.licenses import license_kind, license_name
from betterbench.sim.assets.names import words_of

CUBE_OBJ = "".join(f"v {x} {y} {z}\n" for x in (0, 0.2) for y in (0, 0.1) for z in (0, 0.3)) + "f 1 2 3 4\nf 5 6 7\n"


def glb(form, *, cut=0):
    text = json.dumps(form).encode() if isinstance(form, dict) else form
    text += b" " * (-len(text) % 4)
    whole = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text
    return whole[: len(whole) - cut]


def triangle(**node):
    return {
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1], "scale": [2, 2, 2]}, {"mesh": 0, **node}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [{"count": 8, "min": [0, 0, 0], "max": [1, 2, 3]}, {"count": 36}],
    }


def rows(source):
    """Rows of a source by id, and the names of what was skipped."""
    skipped, found = {}, {}
    for item in source.items(on_skip=skipped.__setitem__):
        try:
            found[item.id] = item.read()
        except InvalidInputError as error:
            skipped[item.id] = str(error)
    return found, skipped


@each(
    "said, name, kind",
    [
        ("by", "CC-BY-4.0", "free"),
        ("by-sa", "CC-BY-SA-4.0", "free"),
        ("by-nc", "CC-BY-NC-4.0", "restricted"),
        ("by-nc-sa", "CC-BY-NC-SA-4.0", "restricted"),
        ("by-nd", "CC-BY-ND-4.0", "restricted"),
        ("cc0", "CC0-1.0", "free"),
        ("CC BY 3.0", "CC-BY-3.0", "free"),
        ("Creative Commons Attribution-NonCommercial", "CC-BY-NC-4.0", "restricted"),
        ("Apache-2.0", "Apache-2.0", "free"),
        ("free for non-commercial use", "free for non-commercial use", "restricted"),
        ("editorial", "editorial", "unknown"),
        ("mitigated", "mitigated", "unknown"),
        ("", "", "unknown"),
    ],
)
def test_licenses_have_one_name_and_a_kind(said, name, kind):
    assert license_name(said) == name
    assert license_kind(name) == kind
    assert license_name(name) == name


def test_names_of_files_are_said_as_people_say_them():
    assert " ".join(words_of("burgerCheeseDouble")) == "burger cheese double"
    assert " ".join(words_of("025_mug")) == "mug"
    assert " ".join(words_of("065-a_cups")) == "cups"
    assert " ".join(words_of("1234")) == "1234"


def test_terms_are_singular_and_without_accents():
    assert terms("Two Crêpes, loaves & glasses: FRIES!") == ["two", "crepe", "loaf", "glass", "fries"]
    assert terms("a bus of grey dishes, knives, cookies") == ["a", "bus", "of", "gray", "dish", "knife", "cookie"]


def test_a_row_of_the_procedural_library_stands_for_all_looks(monkeypatch):
    module = __import__("betterbench.sim.assets.catalogue.sources.procedural", fromlist=["x"])
    monkeypatch.setattr(module, "categories", lambda: ("lemon", "apple"))
    found, skipped = rows(open_source("procedural"))
    assert list(found) == [f"procedural/{n}" for n in ("lemon-yellow", "apple-red", "apple-green", "apple-yellow")]
    apple = found["procedural/apple-red"]
    assert (apple.color, apple.variants, apple.license, skipped) == ("red", 8, "Apache-2.0", {})
    assert 0.05 < max(apple.size_m) < 0.08
    assert asset_address("procedural/apple-red#3") == ("apple", "red", 3)
    with pytest.raises(InvalidInputError, match="not an asset of the procedural library"):
        asset_address("kenney/apple.glb")


def test_a_folder_gives_one_row_for_each_object(tmp_path):
    (tmp_path / "redMug.glb").write_bytes(glb(triangle()))
    (tmp_path / "025_bowl").mkdir()
    (tmp_path / "025_bowl" / "textured.obj").write_text(CUBE_OBJ)
    (tmp_path / "025_bowl" / "nontextured.stl").write_bytes(bytes(80) + struct.pack("<I", 1) + bytes(50))
    (tmp_path / "cabinet").mkdir()
    (tmp_path / "cabinet" / "door.obj").write_text(CUBE_OBJ)
    urdf = (
        '<robot name="cabinet"><link><visual><geometry><mesh filename="door.obj"/></geometry></visual></link></robot>'
    )
    (tmp_path / "cabinet" / "cabinet.urdf").write_text(urdf)
    (tmp_path / "notes.xml").write_text("<notes/>")
    found, skipped = rows(open_source(str(tmp_path), SourceOptions(name="mine", license="cc0", author="Ada")))
    assert list(found) == ["mine/025_bowl/textured.obj", "mine/cabinet/cabinet.urdf", "mine/redMug.glb"]
    assert skipped == {}
    bowl, _, mug = found.values()
    assert (bowl.name, bowl.faces, bowl.size_m) == ("bowl", 3, (0.2, 0.1, 0.3))
    assert (mug.name, mug.faces, mug.size_m) == ("red mug", 12, (2.0, 4.0, 6.0))
    assert mug.content_hash == hashlib.sha256((tmp_path / "redMug.glb").read_bytes()).hexdigest()
    assert (mug.path, mug.license, mug.author) == (str(tmp_path / "redMug.glb"), "CC0-1.0", "Ada")


@pytest.mark.parametrize("table", [True, False])
def test_a_sidecar_describes_files(tmp_path, table):
    (tmp_path / "x1.stl").write_bytes(bytes(80) + struct.pack("<I", 1) + bytes(50))
    if table:
        (tmp_path / "assets.csv").write_text("file,name,tags,license\nx1.stl,toy car,toy; vehicle,by-nc\n")
    else:
        row = {"file": "x1.stl", "name": "toy car", "tags": ["toy", "vehicle"], "license": "by-nc"}
        (tmp_path / "assets.json").write_text(json.dumps([row]))
    found, _ = rows(open_source(f"folder:{tmp_path}", SourceOptions(name="toys", license="cc0")))
    (car,) = found.values()
    assert (car.name, car.tags, car.license) == ("toy car", ("toy", "vehicle"), "CC-BY-NC-4.0")


def test_a_wrong_sidecar_is_one_clear_error(tmp_path):
    (tmp_path / "assets.json").write_text('[{"file": "a.obj", "licence": "cc0"}]')
    with pytest.raises(InvalidInputError, match=r"assets.json: \[0\].licence: is unknown"):
        rows(open_source(str(tmp_path)))


HOSTILE = {
    "cut.glb": glb(triangle(), cut=9),
    "word.glb": b"glTF",
    "ring.glb": glb({**triangle(), "nodes": [{"children": [0]}]}),
    "nowhere.glb": glb({**triangle(), "accessors": []}),
    "negative.glb": glb({**triangle(), "nodes": [{"mesh": -1}]}),
    "text.glb": glb({**triangle(), "accessors": [{"count": "many"}, {"count": 3}]}),
    "list.glb": glb(b"[1, 2]"),
    "deep.gltf": b"[" * 5000 + b"]" * 5000,
    "vertex.obj": b"v 1 2\nv a b c\n",
    "empty.obj": b"# nothing\n",
    "short.stl": b"\x01" * 40,
    "count.stl": bytes(80) + struct.pack("<I", 2**31) + bytes(50),
    "bomb.urdf": b'<!DOCTYPE x [<!ENTITY a "aaaa">]><robot name="&a;"/>',
    "open.xml": b"<mujoco><mesh",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_damaged_file_is_named_and_skipped(tmp_path, name):
    (tmp_path / name).write_bytes(HOSTILE[name])
    (tmp_path / "good.obj").write_text(CUBE_OBJ)
    found, skipped = rows(open_source(str(tmp_path), SourceOptions(name="mine")))
    assert list(found) == ["mine/good.obj"]
    assert [key.removeprefix("mine/") for key in skipped] == [name]


def test_numbers_that_are_not_finite_are_unknown(tmp_path):
    (tmp_path / "nan.obj").write_text("v nan 0 0\nv 1 1 1\nv inf 2 2\nf 1 2 3\n")
    assert mesh_facts(tmp_path / "nan.obj").size is None
    endless = triangle(translation=[1e308, 0, 0], scale=[1e308, 1, 1])
    (tmp_path / "far.glb").write_bytes(glb(endless))
    assert mesh_facts(tmp_path / "far.glb").size is None


def test_links_and_pipes_are_not_followed(tmp_path):
    (tmp_path / "outside.obj").write_text(CUBE_OBJ)
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link.obj").symlink_to(tmp_path / "outside.obj")
    (inside / "folder.obj").mkdir()
    assert rows(open_source(str(inside))) == ({}, {})


# ---------------------------------------------------------------------------------------------------------- Objaverse


@pytest.fixture
def objaverse(tmp_path):
    """The layout that the package keeps on disk, with three models."""
    root = tmp_path / "hf-objaverse-v1"
    (root / "metadata").mkdir(parents=True)
    (root / "glbs" / "000-001").mkdir(parents=True)
    (root / "glbs" / "000-001" / "aa11.glb").write_bytes(glb(triangle()))

    def pack(name, form):
        (root / name).write_bytes(gzip.compress(json.dumps(form).encode()))

    model = {
        "name": "Old Mug",
        "description": "A mug\nof tin",
        "tags": [{"name": "cup"}, {"name": "tin"}],
        "categories": [{"name": "food-drink"}],
        "license": "by",
        "faceCount": 120,
        "user": {"displayName": "Ada"},
    }
    pack("metadata/000-000.json.gz", {"aa11": model, "bb22": {**model, "license": "by-nc", "faceCount": "x"}})
    pack("metadata/000-001.json.gz", {"cc33": {"name": 7, "tags": "no", "user": None}, "../x": model, "dd": 3})
    pack("lvis-annotations.json.gz", {"pop_(soda)": ["bb22"], "mug": ["aa11"]})
    pack("object-paths.json.gz", {"aa11": "glbs/000-001/aa11.glb", "bb22": "../../secret.glb", "cc33": "/etc/passwd"})
    return root


def test_objaverse_is_read_from_its_own_files(objaverse):
    found, skipped = rows(open_source(f"objaverse:{objaverse}"))
    assert list(found) == ["objaverse/aa11", "objaverse/bb22", "objaverse/cc33"]
    assert set(skipped) == {"000-001.json.gz: ../x", "000-001.json.gz: dd"}
    mug, can, other = found.values()
    assert (mug.name, mug.description, mug.category) == ("Old Mug", "A mug of tin", "mug")
    assert (mug.tags, mug.license, mug.author, mug.faces) == (("cup", "tin", "food-drink"), "CC-BY-4.0", "Ada", 120)
    assert mug.content_hash == hashlib.sha256((objaverse / "glbs/000-001/aa11.glb").read_bytes()).hexdigest()
    assert (can.category, can.license, can.faces, can.path, can.content_hash) == (
        "pop (soda)",
        "CC-BY-NC-4.0",
        None,
        "",
        "",
    )
    assert (other.name, other.tags, other.license, other.path) == ("cc33", (), "", "")


def test_a_damaged_shard_is_skipped(objaverse):
    whole = (objaverse / "metadata" / "000-000.json.gz").read_bytes()
    (objaverse / "metadata" / "000-000.json.gz").write_bytes(whole[:-20])
    (objaverse / "lvis-annotations.json.gz").write_bytes(b"no archive")
    found, skipped = rows(open_source(f"objaverse:{objaverse}"))
    assert list(found) == ["objaverse/cc33"]
    assert {"000-000.json.gz", "lvis-annotations.json.gz"} <= set(skipped)


def test_without_its_package_objaverse_says_what_to_do(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "objaverse", None)
    with pytest.raises(MissingDependencyError, match=r"objaverse.*or read its files from a folder: objaverse:FOLDER"):
        open_source("objaverse")


def test_the_package_downloads_the_annotations_when_asked(monkeypatch, objaverse):
    from types import SimpleNamespace

    asked = []
    package = SimpleNamespace(
        load_annotations=lambda: asked.append("annotations"),
        load_lvis_annotations=lambda: asked.append("lvis"),
        _VERSIONED_PATH=str(objaverse),
    )
    monkeypatch.setitem(__import__("sys").modules, "objaverse", package)
    found, _ = rows(open_source("objaverse"))
    assert (asked, len(found)) == (["annotations", "lvis"], 3)


def test_an_unknown_source_is_answered_with_the_known_ones(tmp_path):
    assert sorted(SOURCES) == ["folder", "objaverse", "procedural"]
    with pytest.raises(UnknownNameError, match="procedural"):
        open_source("procedurel")
    with pytest.raises(InvalidInputError, match="the folder does not exist"):
        open_source(str(tmp_path / "none"))
