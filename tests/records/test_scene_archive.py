"""Archives of scenes: the same bytes whether a scene is compressed or copied from an archive of this process."""

from __future__ import annotations

from pathlib import Path

import pytest

from betterbench.records import scene_archive
from betterbench.records.scene_archive import read_scene, write_scene

FILES = {"model.mjb": bytes(range(256)) * 40, "scene.json": b"{}"}


@pytest.fixture
def made(monkeypatch):
    """The digests of the archives that were compressed, and none remembered from other tests."""
    digests = []
    ordinary = scene_archive._archive

    def archive(files, digest):
        digests.append(digest)
        return ordinary(files, digest)

    monkeypatch.setattr(scene_archive, "_archive", archive)
    monkeypatch.setattr(scene_archive, "_WRITTEN", {})
    return digests


def test_a_scene_of_several_runs_is_compressed_once(made, tmp_path):
    for run in ("one", "two", "three"):
        (tmp_path / run).mkdir()
        write_scene(tmp_path / run / "ab12.zip", FILES)
    assert len(made) == 1
    assert len({(tmp_path / run / "ab12.zip").read_bytes() for run in ("one", "two", "three")}) == 1
    assert read_scene(tmp_path / "three" / "ab12.zip") == FILES


def test_another_name_or_content_is_another_archive(made, tmp_path):
    write_scene(tmp_path / "ab12.zip", FILES)
    write_scene(tmp_path / "cd34.zip", FILES)
    write_scene(tmp_path / "ef56.zip", {**FILES, "scene.json": b"[]"})
    assert len(set(made)) == 3
    assert read_scene(tmp_path / "cd34.zip") == FILES


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def _turn(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[50] ^= 1
    path.write_bytes(data)


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize("spoil", [Path.unlink, _cut, _turn, _folder])
def test_an_archive_that_is_gone_or_changed_is_not_copied(made, tmp_path, spoil):
    first, second = tmp_path / "one" / "ab12.zip", tmp_path / "two" / "ab12.zip"
    for path in (first, second):
        path.parent.mkdir()
    write_scene(first, FILES)
    whole = first.read_bytes()
    spoil(first)
    write_scene(second, FILES)
    assert len(made) == 2
    assert second.read_bytes() == whole
