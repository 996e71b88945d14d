"""A chat endpoint that is closed at the end of a test, and a cache folder of its own for each test."""

from __future__ import annotations

import functools

import platformdirs
import pytest
from tests.vlm.published import Server

from betterbench.vlm import running
from betterbench.vlm.models.eyes import contact_sheet

ROBOTS = platformdirs.user_cache_path("betterbench") / "robots"
"""Prepared meshes of the robot, which take seconds to prepare."""


@pytest.fixture(autouse=True)
def cache_home(tmp_path_factory, monkeypatch):
    """Keeps replies out of the user's cache folder, also in processes that a test starts."""
    home = tmp_path_factory.mktemp("cache")
    (home / "betterbench").mkdir()
    ROBOTS.mkdir(parents=True, exist_ok=True)
    (home / "betterbench" / "robots").symlink_to(ROBOTS)
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    return home


drawn_once = functools.cache(contact_sheet)


@pytest.fixture(scope="module", autouse=True)
def sheets_drawn_once():
    """Keeps the sheet of each image: most runs show the same image, and a sheet takes 0.1 s."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(running, "contact_sheet", drawn_once)
        yield


@pytest.fixture
def serve():
    servers = []

    def start(answer):
        servers.append(Server(answer))
        return servers[-1]

    yield start
    for server in servers:
        server.close()
