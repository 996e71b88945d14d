"""A small set of demonstrations, made once for all tests."""

from __future__ import annotations

import pytest

from betterbench.demonstrations.making.production import collect
from betterbench.records import RunFolder

TASK = "morning_coffee"


@pytest.fixture(scope="session")
def sources(tmp_path_factory) -> RunFolder:
    """One demonstration per training condition of the shortest task."""
    return collect([TASK], tmp_path_factory.mktemp("demonstrations") / "sources", demos=1)
