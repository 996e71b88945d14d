"""Audits for tests that look at findings alone."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import pytest

from betterbench.demonstrations.shortcuts import examine


@contextlib.contextmanager
def findings_alone() -> Iterator[None]:
    """Leaves the smallest detectable rules out of audits: up to half of their time.

    They have a random generator of their own, so no finding depends on them. ``test_smallest.py`` tests them.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(examine, "_smallest_of", lambda _group, _counts: ())
        yield


@pytest.fixture
def only_findings() -> Iterator[None]:
    """Does so for one test."""
    with findings_alone():
        yield
