"""Rendering processes for tests of commands that draw, but are not about the process."""

from __future__ import annotations

import pytest
from tests.kept_views import KeptViews, used_by_commands


@pytest.fixture(scope="session")
def kept_processes():
    views = KeptViews()
    yield views
    views.end()


@pytest.fixture
def kept_views(kept_processes):
    """Lets one test draw in processes that other tests have started."""
    with used_by_commands(kept_processes):
        yield


@pytest.fixture(scope="module")
def kept_views_of_module(kept_processes):
    """Lets all tests of a module, and its fixtures, draw in such processes."""
    with used_by_commands(kept_processes):
        yield
