"""Whatever moment `better vqa` is killed at, the next one finishes to the same bytes."""

from __future__ import annotations

import pytest
from tests.killing import check_kills

pytestmark = [pytest.mark.slow, pytest.mark.physics, pytest.mark.render]


def content(folder):
    files = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.name != ".lock"]
    return {str(p.relative_to(folder)): p.read_bytes() for p in files}


def test_vqa_killed_at_ten_moments_finishes_to_the_same_bytes(run, tmp_path):
    def words(out):
        asked = ["--questions", "120", "--frames", "4", "--size", "160", "--quality", "fast", "--cameras", "front"]
        return ["vqa", str(run.path), "--out", str(out), *asked, "left_shoulder", "--workers", "2"]

    check_kills(words, content, tmp_path, seed=3)
