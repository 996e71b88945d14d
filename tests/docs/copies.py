"""A copy of code and tests into which files of a page are put where the page says, and commands that run there."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from tests.prepared_process import OTHERS, prepared

ROOT = Path(__file__).parents[2]


def untracked() -> frozenset[str]:
    """Returns the paths of files that are neither tracked nor ignored by git; none if git or its data is missing."""
    git = shutil.which("git")
    if git is None:
        return frozenset()
    command = [git, "ls-files", "--others", "--exclude-standard", "-z"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return frozenset(str(ROOT / name) for name in done.stdout.split("\0") if name)


def copy_checkout(root: Path, files: dict[str, str]) -> Path:
    """Copies code and tests into a folder and writes files there, by their path in the checkout.

    Files that git does not track are left out, so that an unfinished file of an author does not fail these tests.
    """
    others = untracked()

    def left_out(folder: str, names: list[str]) -> list[str]:
        return [name for name in names if os.path.join(folder, name) in others]  # noqa: PTH118 - as copytree has it

    for folder in ("src", "tests", "requirements"):
        # with times and bytecode, so that little is compiled again
        shutil.copytree(ROOT / folder, root / folder, ignore=left_out)
    shutil.copy(ROOT / "pyproject.toml", root)
    for path, text in files.items():
        assert not (root / path).exists(), "the page describes a new file"
        (root / path).parent.mkdir(exist_ok=True)
        (root / path).write_text(text, encoding="utf-8")
    return root


def attempt(checkout: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """Returns a command of Python that has ended in the copy."""
    # Task files that other tests have loaded into this process are named to its children by such variables.
    kept = {name: value for name, value in os.environ.items() if not name.startswith("BETTERBENCH")}
    return prepared(*OTHERS).run(*command, cwd=checkout, env={**kept, "PYTHONPATH": str(checkout / "src")})


def run(checkout: Path, *command: str) -> str:
    """Returns what a command prints in the copy; it has to end well."""
    done = attempt(checkout, *command)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
