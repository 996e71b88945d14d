"""A copy of the checkout has the files that git tracks, and no file that its author has not added yet."""

from __future__ import annotations

import shutil
import subprocess

import pytest
from tests.docs import copies


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    root = tmp_path / "checkout"
    for name in ("src/tracked.py", "src/mine.py", "src/mine/deep.py", "src/__pycache__/tracked.pyc", "tests/t.py"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("")
    (root / "requirements").mkdir()
    (root / "pyproject.toml").write_text("")
    (root / ".gitignore").write_text("__pycache__/\n")
    monkeypatch.setattr(copies, "ROOT", root)
    return root


def copied(tmp_path) -> set[str]:
    copy = tmp_path / "copy"
    copies.copy_checkout(copy, {"src/new.py": "NEW = 1\n"})
    return {path.relative_to(copy).as_posix() for path in (copy / "src").rglob("*") if path.is_file()}


def test_a_copy_leaves_out_files_that_git_does_not_track(checkout, tmp_path):
    git = shutil.which("git") or pytest.skip("git is not installed")
    for command in (("init", "--quiet"), ("add", "src/tracked.py", "tests")):
        subprocess.run([git, *command], cwd=checkout, check=True)
    assert copied(tmp_path) == {"src/tracked.py", "src/__pycache__/tracked.pyc", "src/new.py"}


@pytest.mark.usefixtures("checkout")
def test_a_copy_of_a_folder_without_git_has_all_files(tmp_path, monkeypatch):
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path))
    everything = {"src/tracked.py", "src/mine.py", "src/mine/deep.py", "src/__pycache__/tracked.pyc", "src/new.py"}
    assert copied(tmp_path) == everything
    monkeypatch.setenv("PATH", "")
    assert copies.untracked() == frozenset()
