"""Folders of imported assets: what is written, resumed and refused, and how commands use their assets."""

from __future__ import annotations

import io
import json
import struct
import zipfile

import numpy as np
import pytest
import trimesh
from tests.kept_registry import kept_registry

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError
from betterbench.sim.assets import build
from betterbench.sim.assets.folders import job
from betterbench.sim.assets.folders.job import ImportRequest, import_assets
from betterbench.sim.assets.folders.manifest import manifest_of, read_manifest
from betterbench.sim.assets.importing.importer import Wishes
from betterbench.sim.assets.importing.stored import from_bytes
from betterbench.tasks import user_files

FREE = {"license": "CC0-1.0"}


@pytest.fixture
def clean(tmp_path, monkeypatch):
    """Leave the registry, the loaded files and the user's cache as they were."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "80")
    with kept_registry():
        yield tmp_path


@pytest.fixture
def quick(clean, imports_here):
    return clean


def block(path, side=0.05):
    """Write a slim block, whose few cells are measured quickly."""
    trimesh.creation.box((side, 0.016, 0.012)).export(path)
    return path


def request(path, **said):
    wishes = {"size_m": 0.05, "name": "block", **FREE}
    wishes |= {key: said.pop(key) for key in tuple(said) if key in ("license", "author", "up", "mass_kg")}
    return ImportRequest(path=path, wishes=Wishes(**wishes), **said)


def test_a_folder_lists_what_was_imported_and_from_what(quick):
    report = import_assets([request(block(quick / "toyBlock.stl"), author="Ada L.", up="z")], quick / "mine")
    assert (report.made, report.kept, report.failed) == (["toy_block"], [], [])
    asset = manifest_of(quick / "mine").assets["toy_block"]
    assert (asset.license, asset.author, asset.kind) == ("CC0-1.0", "Ada L.", "block")
    assert asset.source_files.keys() == {"toyBlock.stl"}
    assert asset.size_m == pytest.approx((0.05, 0.016, 0.012), abs=1e-4)
    assert asset.options == {"name": "block", "size_m": 0.05, "up": "z", "license": "CC0-1.0", "author": "Ada L."}
    assert any("as given" in note for note in asset.notes)
    user_files.load_asset_folders([quick / "mine"])
    built = build("toy_block")
    assert built.mass_kg == asset.mass_kg
    assert built.license == "CC0-1.0"
    assert "Ada L." in built.source


def test_a_job_goes_on_where_it_stopped_and_imports_again_only_what_changed(quick, monkeypatch):
    requests = [request(block(quick / f"block{k}.stl")) for k in "abc"]
    out, done = quick / "mine", []
    original = job.import_bytes

    def stops_at_the_third(path, wishes):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(path.name)
        return original(path, wishes)

    monkeypatch.setattr(job, "import_bytes", stops_at_the_third)
    with pytest.raises(KeyboardInterrupt):
        import_assets(requests, out)
    assert len(manifest_of(out).assets) == 2
    monkeypatch.setattr(job, "import_bytes", original)
    report = import_assets(requests, out)
    assert (len(report.made), len(report.kept)) == (1, 2)
    # The same names for the same files, whatever their order.
    names = {asset.source_files.popitem()[0]: name for name, asset in manifest_of(out).assets.items()}
    assert import_assets(requests[::-1], out).made == []
    block(quick / "blockb.stl", side=0.045)
    assert import_assets(requests, out).made != []
    assert import_assets([request(quick / "blocka.stl", mass_kg=0.2)], out).made == [names["blocka.stl"]]


def test_a_file_that_fails_is_named_and_leaves_nothing(quick):
    broken = quick / "broken.glb"
    broken.write_bytes(b"glTF")
    report = import_assets([request(broken), request(block(quick / "toy.stl"))], quick / "mine")
    assert report.made == ["toy"]
    assert [file for file, _ in report.failed] == ["broken.glb"]
    assert sorted(path.name for path in (quick / "mine").glob("*.npz")) == ["toy.npz"]
    assert list(manifest_of(quick / "mine").assets) == ["toy"]


def test_a_license_that_is_not_free_is_refused_unless_it_is_allowed(quick):
    toy = block(quick / "toy.stl")
    for license_said, text in (("unknown", "its license is not known"), ("CC BY-NC 4.0", "forbids commercial use")):
        report = import_assets([request(toy, license=license_said)], quick / "mine")
        assert report.made == []
        assert text in report.failed[0][1]
        assert "--any-license" in report.failed[0][1]
    assert import_assets([request(toy, license="unknown", any_license=True)], quick / "mine").made == ["toy"]


def test_names_are_those_of_tasks(quick):
    mug = quick / "mug.stl"
    block(mug)
    assert import_assets([request(mug)], quick / "mine").made == ["my_mug"]  # the library has a mug
    for name, text in (("My Mug", "not a valid asset name"), ("mug", "already exists"), ("../x", "not a valid")):
        with pytest.raises(InvalidInputError, match=text):
            import_assets([request(mug, name=name)], quick / "other")
    assert not list((quick / "other").glob("*.npz")) if (quick / "other").exists() else True
    assert import_assets([request(mug, name="tall_mug", color="red")], quick / "mine").made == ["tall_mug"]


def test_the_color_is_that_of_most_of_the_surface(quick):
    box = trimesh.creation.box((0.05, 0.012, 0.016))
    box.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[10, 60, 180, 255])
    )
    box.export(quick / "toy.glb")
    import_assets([request(quick / "toy.glb")], quick / "mine")
    assert manifest_of(quick / "mine").assets["toy"].color == "blue"


# ---------------------------------------------------------------------------------------------------- hostile folders


def stored(clean):
    import_assets([request(block(clean / "toy.stl"))], clean / "mine")
    return clean / "mine"


def test_a_changed_file_and_a_damaged_manifest_are_one_line(quick):
    folder = stored(quick)
    text = (folder / user_files.ASSET_MANIFEST).read_text()
    for changed, said in (
        (text.replace('"toy.npz"', '"../toy.npz"'), "expected toy.npz"),
        (text.replace('"toy":', '"../toy":'), "is not a valid asset name"),
        (text.replace('"format": 1', '"format": 9'), "has the format 9"),
        (text[:-20], "manifest"),
        ("[" * 100_000, "manifest"),
    ):
        with pytest.raises(InvalidInputError, match=said) as caught:
            read_manifest(changed, "manifest")
        assert "\n" not in str(caught.value)
    (folder / "toy.npz").write_bytes(b"PK")
    user_files.load_asset_folders([folder])
    with pytest.raises(InvalidInputError, match="is not the file that the manifest lists"):
        build("toy")


def rewritten(data, name, change):
    """Return an archive of arrays with one member changed."""
    written = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as archive, zipfile.ZipFile(written, "w") as other:
        for member in archive.namelist():
            content = archive.read(member)
            other.writestr(member, change(content) if member == name else content)
    return written.getvalue()


def array_bytes(array):
    written = io.BytesIO()
    np.lib.format.write_array(written, array, allow_pickle=False)
    return written.getvalue()


def test_a_forged_asset_is_refused_before_the_simulator_sees_it(quick):
    data = (stored(quick) / "toy.npz").read_bytes()
    assert from_bytes(data, "toy").draft.mass_kg > 0.0

    def of(change):
        def changed(content):
            stream = io.BytesIO(content)
            return array_bytes(change(np.lib.format.read_array(stream)))

        return changed

    def head(change):
        def changed(content):
            form = json.loads(np.lib.format.read_array(io.BytesIO(content)).tobytes())
            change(form)
            return array_bytes(np.frombuffer(json.dumps(form).encode(), np.uint8))

        return changed

    huge = b"\x93NUMPY\x01\x00\x76\x00" + b"{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999, 3), }"
    forged = {
        "NaN": ("0_vertices.npy", of(lambda a: np.where(np.arange(a.size).reshape(a.shape) == 0, np.nan, a))),
        "far": ("0_vertices.npy", of(lambda a: 1e6 * a)),
        "index": ("0_faces.npy", of(lambda a: a + 10_000)),
        "negative index": ("0_faces.npy", of(lambda a: a - 5)),
        "other type": ("0_faces.npy", of(lambda a: a.astype(np.float64))),
        "huge shape": ("0_vertices.npy", lambda _: huge.ljust(128) + b"\n"),
        "no mass": ("head.npy", head(lambda form: form["body"].update(mass_kg=-1.0))),
        "no inertia": ("head.npy", head(lambda form: form["body"].update(inertia=[0.0] * 6))),
        "no part": ("head.npy", head(lambda form: form.update(visual=[]))),
        "unknown kind": ("head.npy", head(lambda form: form.update(kind=7))),
        "deep": ("head.npy", lambda _: array_bytes(np.frombuffer(b"[" * 100_000, np.uint8))),
    }
    for what, (name, change) in forged.items():
        with pytest.raises(InvalidInputError, match="is not an imported object"):
            from_bytes(rewritten(data, name, change), what)


def test_an_archive_that_unpacks_to_gigabytes_is_not_unpacked(clean):
    written, size = io.BytesIO(), 54_321
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("0_pixels.npy", bytes(size))
    declared = written.getvalue().replace(struct.pack("<I", size), struct.pack("<I", 300 << 20))
    with pytest.raises(InvalidInputError, match="is not an imported object") as caught:
        from_bytes(declared, "bomb")
    assert "too large when unpacked" in str(caught.value.__cause__)


# ----------------------------------------------------------------------------------------------------------- commands


def run(capsys, *words):
    capsys.readouterr()
    status = main([*words])
    shown = capsys.readouterr()
    return status, shown.out, " ".join(shown.err.split())


def test_what_is_typed_and_read(quick, capsys, monkeypatch):
    monkeypatch.chdir(quick)
    block("toy.stl")
    (quick / "broken.obj").write_text("v 0 0 0\n")
    words = ("--out", "mine", "--license", "cc0")
    status, out, err = run(capsys, "assets", "import", "toy.stl", "broken.obj", *words)
    assert status == 0, err
    assert "1 imported, 0 kept, 1 skipped" in out
    assert "--asset-dir mine" in out
    assert max(map(len, out.splitlines())) <= 80
    assert "skipped broken.obj: " in err
    status, out, _ = run(capsys, "assets", "import", "toy.stl", "broken.obj", *words, "--json")
    assert [asset["kept"] for asset in json.loads(out)["assets"]] == [True]
    _, out, _ = run(capsys, "assets", "import", "toy.stl", "--out", "my own", "--license", "cc0")
    assert "--asset-dir 'my own'" in out, "a printed option can be copied into a shell"
    status, _, err = run(capsys, "assets", "import", "broken.obj", "--out", "bad", "--license", "cc0")
    assert status == 2
    assert "no file could be imported" in err
    for given, text in (
        ((), "no file was given"),
        (("gone.glb",), "gone.glb"),
        (("toy.stl", "broken.obj", "--size-m", "0.1"), " --size-m: 2 files were given. Import one file at a time"),
        (("toy.stl", "--size-m", "-1"), "out of range"),
        (("toy.stl", "--size-m", "100"), "--size-m: expected a number above 0 and below 100, got 100"),
    ):
        status, _, err = run(capsys, "assets", "import", *given, "--out", "bad")
        assert status == 2, given
        assert text in err
    status, _, err = run(capsys, "list", "assets", "--asset-dir", "nowhere")
    assert status == 2
    assert "the folder does not exist" in err
    status, _, err = run(capsys, "list", "assets", "--asset-dir", ".")
    assert "has no asset-manifest.json" in err
    status, out, err = run(capsys, "list", "assets", "--asset-dir", "mine")
    assert status == 0, err
    assert "toy" in out


def test_a_row_of_the_catalogue_brings_its_name_license_and_author(quick, capsys):
    kitchen = quick / "kitchen"
    kitchen.mkdir()
    block(kitchen / "x7.stl")
    (kitchen / "assets.json").write_text(
        json.dumps(
            [{"file": "x7.stl", "name": "toy block", "license": "CC BY 4.0", "author": "Ada L.", "color": "red"}]
        )
    )
    where = ("--catalogue", str(quick / "catalogue"))
    assert run(capsys, "assets", "index", str(kitchen), "--encoder", "none", *where)[0] == 0
    status, _, err = run(capsys, "assets", "import", "kitchen/x7.stl", "--out", str(quick / "mine"), *where)
    assert status == 0, err
    (asset,) = manifest_of(quick / "mine").assets.values()
    assert (asset.license, asset.author, asset.color, asset.kind) == ("CC-BY-4.0", "Ada L.", "red", "block")
    status, _, err = run(capsys, "assets", "import", "procedural/mug-red", "--out", str(quick / "mine"), *where)
    assert status == 2
