"""A world that needs no LIBERO."""

import sys
from pathlib import Path

import pytest

from betterbench.evaluation.running import runner
from betterbench.policies.factory import PolicyFactory
from betterbench.sim.worlds.installation import start_code


@pytest.fixture(scope="module")
def fake_command() -> tuple[str, ...]:
    folder = str(Path(__file__).parent)
    return (sys.executable, "-c", f"import sys; sys.path.append({folder!r})\n{start_code('fake_world')}")


@pytest.fixture
def policies_here(monkeypatch):
    """Let a user's policy run in this process: a process of its own takes 0.3 s of CPU."""

    def factory(address, *, apart=False, **given):
        del apart
        return PolicyFactory(address, **given)

    monkeypatch.setattr(runner, "PolicyFactory", factory)
