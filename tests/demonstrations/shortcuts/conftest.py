"""Audits for tests that look at findings alone."""

from __future__ import annotations

import pytest

from betterbench.demonstrations.shortcuts import examine


@pytest.fixture
def only_findings(monkeypatch) -> None:
    """Leaves the smallest detectable rules out of an audit: up to half of its time.

    They have a random generator of their own, so no finding depends on them. ``test_smallest.py`` tests them.
    """
    monkeypatch.setattr(examine, "_smallest_of", lambda _group, _counts: ())
