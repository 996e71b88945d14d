"""Killed at ten random moments, an export finishes to the same bytes."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytestmark = [pytest.mark.slow, pytest.mark.render, pytest.mark.physics]

# The real command in a process of its own, with pictures that cost nothing.
COMMAND = """
import sys
sys.path.insert(0, {folder!r})
from demonstrating import PaintedPictures
from betterbench.cli.main import main
from betterbench.demonstrations.export import job

job.Pictures = PaintedPictures
sys.exit(main(sys.argv[1:]))
"""


def started(run: Path, out: Path) -> subprocess.Popen:
    code = COMMAND.format(folder=str(Path(__file__).parent))
    words = ["export", str(run), "--to", "lerobot", "--out", str(out), "--workers", "2"]
    return subprocess.Popen([sys.executable, "-c", code, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_killed_at_ten_moments_it_finishes_to_the_same_bytes(demonstrations, tmp_path):
    began = time.monotonic()
    assert started(demonstrations.run.path, tmp_path / "whole").wait() == 0
    lasted, kills = time.monotonic() - began, 0
    draw = np.random.default_rng(3)
    while kills < 10:
        process = started(demonstrations.run.path, tmp_path / "set")
        try:
            process.wait(timeout=draw.uniform(0.3, 1.0) * lasted)
        except subprocess.TimeoutExpired:
            process.kill()
        else:
            assert process.returncode == 0
        process.wait()
        kills += 1
        if (tmp_path / "set").exists() and kills < 10:
            (tmp_path / "set").rename(tmp_path / f"early{kills}")
            assert content(tmp_path / f"early{kills}") == content(tmp_path / "whole")
    assert started(demonstrations.run.path, tmp_path / "set").wait() == 0
    assert content(tmp_path / "set") == content(tmp_path / "whole")
    assert not list(tmp_path.glob(".*.parts"))
