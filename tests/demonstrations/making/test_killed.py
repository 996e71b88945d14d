"""Whatever moment `collect` or `amplify` is killed at, the next one finishes to the same bytes."""

from __future__ import annotations

import json

import pytest
from tests.killing import check_kills

pytestmark = [pytest.mark.slow, pytest.mark.physics]
TASK = "morning_coffee"


def lines_of(journal, *left_out):
    """Return the lines of a journal, without some fields and in an order that does not depend on the workers."""
    forms = [json.loads(line) for line in journal.read_text().splitlines()]
    return sorted(json.dumps({k: v for k, v in form.items() if k not in left_out}, sort_keys=True) for form in forms)


def content(run):
    """Return the bytes of records, scenes and report, the plan, and the journals without times and links.

    A link depends on the order of the lines, which depends on the worker that finishes first. Attempts may be listed
    twice.
    """
    places = ("records", "scenes", "acceptance")
    files = {str(p.relative_to(run)): p.read_bytes() for at in places for p in (run / at).rglob("*") if p.is_file()}
    plan = json.loads((run / "run.json").read_text())["plan"]
    attempts = set(lines_of(run / "attempts" / "journal.jsonl", "link"))
    return files, lines_of(run / "journal.jsonl", "link", "wall"), attempts, plan


def test_collect_killed_at_ten_moments_finishes_to_the_same_bytes(tmp_path):
    def words(out):
        return ["collect", "--tasks", TASK, "--demos", "1", "--workers", "2", "--out", str(out)]

    check_kills(words, content, tmp_path, seed=1)


def test_amplify_killed_at_ten_moments_finishes_to_the_same_bytes(sources, tmp_path):
    def words(out):
        return ["amplify", str(sources.path), "--demos", "1", "--workers", "2", "--out", str(out)]

    check_kills(words, content, tmp_path, seed=2)
