"""Meshes of a user's catalogue in a build: found by words, certified, imported and cast."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import trimesh
from tests.generation.test_building import failing, packing, proven
from tests.kept_registry import kept_registry

from betterbench.generation.building import attempts as attempts_module
from betterbench.generation.building.casting import cast_of
from betterbench.generation.building.importing import IMPORTED, ImportedMeshes
from betterbench.generation.building.job import CATALOGUE, build_suite
from betterbench.generation.scenario import DescribedObject
from betterbench.sim.asset_checks.tried_grasps import with_tried_grasps
from betterbench.sim.assets.catalogue.indexing import index_sources
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.sim.assets.catalogue.sources import open_source
from betterbench.sim.assets.catalogue.sources.source import SourceOptions
from betterbench.sim.assets.importing import child

pytestmark = pytest.mark.usefixtures("indexed_once")

ERASER = DescribedObject("a white eraser", "eraser", "eraser", (0.01, 0.2), (0.03, 0.09))


@pytest.fixture(autouse=True)
def imports_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Imports the files of these tests in this process; the start of a process for each would take 1 s."""

    def import_here(path: Path, wishes: child.Wishes, _where: str) -> child.Made:
        asked = {"path": str(path), "wishes": dataclasses.asdict(wishes)}
        files, data = child._answers(asked, b"", finish=with_tried_grasps)
        return child.Made(data, json.loads(files))

    monkeypatch.setattr(child, "_in_child", import_here)


@pytest.fixture
def meshes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Two erasers with a free license, one without, and a broken file, in a catalogue of the user."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for folder, names in (("free", ("eraser", "old_eraser")), ("restricted", ("new_eraser",))):
        (tmp_path / folder).mkdir()
        for number, name in enumerate(names):
            trimesh.creation.box((0.055 + 0.005 * number, 0.025, 0.03)).export(tmp_path / folder / f"{name}.glb")
    (tmp_path / "free" / "bad_eraser.glb").write_bytes(b"glTF")
    sources = [
        open_source(str(tmp_path / folder), SourceOptions(name=folder, license=license_name))
        for folder, license_name in (("free", "CC0 1.0"), ("restricted", "CC BY-NC 4.0"))
    ]
    index_sources(tmp_path / "mine", sources, on_progress=lambda *_: None)
    with kept_registry():
        yield tmp_path / "mine"


def test_an_object_that_the_library_lacks_is_imported_from_the_catalogue_of_the_user(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(attempts_module, "prove", proven(failing(), []))
    monkeypatch.setattr(attempts_module, "badly_framed", lambda *_, **__: ())
    _, *others = packing().groups["items"]
    scenario = dataclasses.replace(packing(), groups={**packing().groups, "items": (ERASER, *others)})
    told: list[ImportedMeshes] = []

    def build(out: str, catalogue: Path | None):
        return build_suite([scenario], tmp_path / out, name="mine", meshes=catalogue, on_import=told.append).results[0]

    without = build("without", None)
    assert not without.certified
    assert "no asset suits 'eraser'" in without.attempts[0].reason

    result = build("with", meshes)
    assert result.certified, result.attempts
    (imported,) = told
    assert sorted(imported.names) == ["eraser", "old_eraser"]
    assert not any("new_eraser" in row for row, _ in imported.refused), "its license is not free"
    chosen = next(c.asset for c in result.chosen if c.query == "eraser")
    assert "eraser" in chosen

    # another attempt takes the other mesh
    with Catalogue(tmp_path / "with" / CATALOGUE) as library:
        casts = [cast_of(scenario, library, attempt=attempt)[0] for attempt in (0, 1)]
    assert {cast.groups["items"][0].category for cast in casts} == {"eraser", "old_eraser"}

    # the same call keeps what is there
    files = {p: p.stat().st_mtime_ns for p in (tmp_path / "with" / IMPORTED).rglob("*.zip")}
    assert build("with", meshes) == result
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "with" / IMPORTED).rglob("*.zip")} == files


def test_a_mesh_that_fails_its_certificate_is_named_with_the_check(meshes: Path, tmp_path: Path) -> None:
    big = DescribedObject("a pole", "pole", "pole", (0.1, 2.0), (0.1, 0.2))
    (tmp_path / "poles").mkdir()
    trimesh.creation.box((0.005, 0.005, 0.9)).export(tmp_path / "poles" / "pole.glb")
    options = SourceOptions(name="poles", license="CC0 1.0")
    index_sources(meshes, [open_source(str(tmp_path / "poles"), options)], on_progress=lambda *_: None)
    _, *others = packing().groups["items"]
    scenario = dataclasses.replace(packing(), groups={**packing().groups, "items": (big, *others)})
    told: list[ImportedMeshes] = []
    result = build_suite([scenario], tmp_path / "out", name="mine", meshes=meshes, on_import=told.append).results[0]
    assert not result.certified
    assert told[0].names == ()
    ((row, problem),) = told[0].refused
    assert row == "poles/pole.glb"
    assert problem
