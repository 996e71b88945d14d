"""Real meshes for the slow tests of imported assets, which the repository does not have; imports without a process."""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path

import pytest

VARIABLE = "BETTERBENCH_MESHES"
PLACE = Path("shared") / "meshes"
WHY = (
    f"no real meshes: set {VARIABLE} to a folder with GLB files and NAME/*.obj, or put them into {PLACE} beside or "
    "above the checkout"
)


def _found() -> Path | None:
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    return next((above / PLACE for above in Path(__file__).resolve().parents if (above / PLACE).is_dir()), None)


@pytest.fixture(scope="session")
def meshes() -> Path:
    """Folder of real meshes; the test is skipped without one."""
    found = _found()
    if found is None:
        pytest.skip(WHY)
    assert found.is_dir(), f"{VARIABLE}: {found} is not a folder"
    return found


@pytest.fixture(scope="session")
def meshes_if_here() -> Path | None:
    """Folder of real meshes, or None."""
    return _found()


@pytest.fixture(scope="session")
def import_once():
    """Import a file in this process without trying grasps; the same content, name and options are imported once."""
    from betterbench.sim.assets.importing import child

    made: dict[tuple[object, ...], child.Made] = {}

    def imported(path, wishes):
        key = path.name, path.read_bytes(), wishes
        if key in made:
            return made[key]
        files, data = child._answers({"path": str(path.absolute()), "wishes": asdict(wishes)}, b"")
        found = child.Made(data, json.loads(files))
        # The folders above a file can name its kind, and a file that it refers to can change.
        if wishes.name is not None and not found.files:
            made[key] = found
        return found

    return imported


@pytest.fixture
def imports_here(monkeypatch, import_once):
    """Let assets be imported by ``import_once``: the process of an import takes 1 s of CPU, trials as much."""
    from betterbench.sim.assets.importing import child

    monkeypatch.setattr(child, "_in_child", lambda path, wishes, _where: import_once(path, wishes))
