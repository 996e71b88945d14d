"""A chat endpoint that is closed at the end of a test."""

from __future__ import annotations

import pytest
from tests.vlm.published import Server


@pytest.fixture
def serve():
    servers = []

    def start(answer):
        servers.append(Server(answer))
        return servers[-1]

    yield start
    for server in servers:
        server.close()
