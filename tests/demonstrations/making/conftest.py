"""What was amplified from the small set of demonstrations, made once for all tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from betterbench.demonstrations.making.production import amplify
from betterbench.records import RunFolder


@pytest.fixture(scope="session")
def amplified(sources, tmp_path_factory) -> RunFolder:
    """One demonstration per training condition, carried over from others."""
    return amplify(sources.path, tmp_path_factory.mktemp("demonstrations") / "amplified", demos=1)


@pytest.fixture(scope="session")
def record_files():
    """The bytes of all records of a run, by their place in it."""

    def read(run: RunFolder) -> dict[Path, bytes]:
        return {p.relative_to(run.path): p.read_bytes() for p in sorted(run.path.glob("records/*/*/*.parquet"))}

    return read
