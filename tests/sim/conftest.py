"""Real meshes for the slow tests of imported assets; they are not part of the repository."""

from __future__ import annotations

import os
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
