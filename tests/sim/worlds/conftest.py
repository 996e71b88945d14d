"""A world that needs no LIBERO."""

import sys
from pathlib import Path

import pytest

from betterbench.sim.worlds.installation import start_code


@pytest.fixture(scope="module")
def fake_command() -> tuple[str, ...]:
    folder = str(Path(__file__).parent)
    return (sys.executable, "-c", f"import sys; sys.path.append({folder!r})\n{start_code('fake_world')}")
