"""Whatever moment `collect` or `amplify` is killed at, the next one finishes to the same bytes."""

from __future__ import annotations

import json

import pytest
from tests.killing import check_kills

pytestmark = [pytest.mark.slow, pytest.mark.physics]
TASK = "morning_coffee"


def content(run):
    """The bytes of records, scenes and report, and what the journals say but for times and order."""
    places = ("records", "scenes", "acceptance")
    files = {str(p.relative_to(run)): p.read_bytes() for at in places for p in (run / at).rglob("*") if p.is_file()}
    entries = [json.loads(line) for line in (run / "journal.jsonl").read_text().splitlines()]
    told = [{k: v for k, v in e.items() if k not in ("wall", "link", "time", "ended")} for e in entries]
    lines = (run / "attempts" / "journal.jsonl").read_text().splitlines()
    plan = json.loads((run / "run.json").read_text())["plan"]
    return files, sorted(json.dumps(e, sort_keys=True) for e in told), sorted(set(lines)), plan


def test_collect_killed_at_ten_moments_finishes_to_the_same_bytes(tmp_path):
    def words(out):
        return ["collect", "--tasks", TASK, "--demos", "1", "--workers", "2", "--out", str(out)]

    check_kills(words, content, tmp_path, seed=1)


def test_amplify_killed_at_ten_moments_finishes_to_the_same_bytes(sources, tmp_path):
    def words(out):
        return ["amplify", str(sources.path), "--demos", "1", "--workers", "2", "--out", str(out)]

    check_kills(words, content, tmp_path, seed=2)
