"""``better assets``: what is typed and read."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest

from betterbench.cli.main import main
from betterbench.sim.assets.catalogue.encoders import minilm

OBJ = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0.1\nf 1 2 3\n"


def run(capsys, *words):
    capsys.readouterr()
    status = main(["assets", *words])
    shown = capsys.readouterr()
    return status, shown.out, " ".join(shown.err.split())


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    meshes = tmp_path / "kitchen"
    meshes.mkdir()
    for name in ("redMug", "blueMug", "dinnerPlate", "longNameOfAnObjectThatSomebodyHasMadeOnce"):
        (meshes / f"{name}.obj").write_text(OBJ)
    (meshes / "broken.glb").write_bytes(b"glTF")
    return meshes, ("--catalogue", str(tmp_path / "catalogue"))


@pytest.fixture
def indexed(place, capsys):
    meshes, where = place
    words = ("--license", "cc0", "--author", "Ada", "--encoder", "none")
    status, out, err = run(capsys, "index", str(meshes), *words, *where)
    assert status == 0
    assert "4 assets: 4 new, 0 changed, 0 kept, 0 removed, 1 skipped" in out
    assert "skipped kitchen/broken.glb: " in err
    return where


def test_a_search_is_a_table_of_80_columns(indexed, capsys):
    status, out, err = run(capsys, "search", "a", "red", "mug", *indexed)
    assert status == 0
    assert max(map(len, out.splitlines())) <= 80
    lines = out.splitlines()
    assert lines[0].split() == ["asset", "score", "license"]
    assert lines[1].split() == ["kitchen/redMug.obj", "1.00", "CC0-1.0"]
    assert "red mug, 0.1 x 0.1 x 0.1 m, 1 triangles, by Ada" in lines[2]
    assert "Searched by words only. To search by meaning too, run: " in err


def test_json_has_what_an_import_needs(indexed, capsys):
    _, out, _ = run(capsys, "search", "plate", "--json", *indexed)
    (plate,) = json.loads(out)["assets"]
    assert plate["id"] == "kitchen/dinnerPlate.obj"
    assert plate["source"] == "kitchen"
    assert plate["path"].endswith("kitchen/dinnerPlate.obj")
    assert len(plate["content_hash"]) == 64
    _, out, _ = run(capsys, "search", "a mug", "--num", "2", "--json", *indexed)
    assert {row["id"] for row in json.loads(out)["assets"]} == {"kitchen/redMug.obj", "kitchen/blueMug.obj"}


def test_licenses_and_one_asset_are_shown(indexed, place, capsys):
    (place[0] / "blueMug.obj").write_text(OBJ + "# changed\n")
    run(capsys, "index", str(place[0]), "--encoder", "none", *indexed)  # now without a license
    _, out, _ = run(capsys, "licenses", *indexed)
    assert "4 assets are found only with --license any." in out
    assert run(capsys, "search", "mug", *indexed)[1] == ""
    assert "kitchen/redMug.obj" in run(capsys, "search", "mug", "--license", "any", *indexed)[1]
    _, out, _ = run(capsys, "show", "kitchen/redMug.obj", *indexed)
    assert "red mug" in out


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("search", "mug", "--license", "cc0"), "expected 'free' or 'any', got 'cc0'. Use --license any to"),
        (("search", "mug", "--source", "kitchn"), "Did you mean 'kitchen'"),
        (("search",), "query: it has 0 characters"),
        (("show", "kitchen/red"), "Unknown asset 'kitchen/red'"),
        (("show",), "0 ids are given"),
        (("search", "mug", "--out", "sheet.gif"), "ends with '.gif'"),
        (("search", "mug", "--num", "50"), "2 assets of the catalogue fit 'mug', but 50 are requested"),
        (("search", "zebra", "--num", "2"), "query: no asset in the catalogue fits 'zebra'. Use other words"),
        (("index", "nowhere"), "Unknown source of assets 'nowhere'"),
        (("index", "procedural", "--license", "mit"), "it does not take a target, license, author or name"),
    ],
)
def test_what_is_wrong_is_one_line_with_a_cure(indexed, capsys, words, text):
    status, out, err = run(capsys, *words, *indexed)
    assert (status, out) == (2, "")
    assert text in err


def test_without_a_catalogue_or_an_encoder_the_command_is_named(place, capsys, monkeypatch):
    meshes, where = place
    assert re.search(
        r"it has no asset catalogue\. Run `\S*better assets index`\.", run(capsys, "search", "mug", *where)[2]
    )
    monkeypatch.setattr(minilm, "find_files", lambda: None)
    status, _, err = run(capsys, "index", str(meshes), *where)
    assert status == 0
    assert "The catalogue can be searched by words only. The encoder minilm needs the optional extra `assets`" in err


@pytest.mark.render
def test_a_sheet_has_a_picture_of_each_asset(indexed, capsys, tmp_path):
    from PIL import Image

    out = tmp_path / "sheet.png"
    assert run(capsys, "search", "mug", "--out", str(out), *indexed)[0] == 0
    with Image.open(out) as image:
        pixels = image.convert("RGB")
    tile = pixels.crop((10, 48, 202, 240))
    ground = max(count for count, _ in tile.getcolors(1 << 16))
    assert 192 * 192 - ground > 2000  # something is drawn on the ground
    (tmp_path / "kitchen" / "redMug.obj").write_text("v x\n")
    assert run(capsys, "show", "kitchen/redMug.obj", "--out", str(out), *indexed)[0] == 0


def test_a_search_starts_no_simulator(indexed):
    code = "import sys; from betterbench.cli.main import main; main(sys.argv[1:]); assert 'mujoco' not in sys.modules"
    words = [sys.executable, "-c", code, "assets", "search", "mug", *indexed]
    assert subprocess.run(words, check=False, capture_output=True, timeout=120).returncode == 0
