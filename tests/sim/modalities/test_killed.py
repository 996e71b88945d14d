"""Whatever moment `better materialize` is killed at, the next one finishes to the same bytes."""

from __future__ import annotations

import hashlib

import pytest
from tests.killing import check_kills

pytestmark = [pytest.mark.slow, pytest.mark.physics, pytest.mark.render]


def content(folder):
    files = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.name != ".lock"]
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def test_materialize_killed_at_ten_moments_finishes_to_the_same_bytes(recorded, tmp_path):
    def words(out):
        cameras = ["--camera", "front:448", "--camera", "wrist:448"]
        return ["materialize", str(recorded.run.path), *cameras, "--out", str(out)]

    check_kills(words, content, tmp_path, seed=0)
