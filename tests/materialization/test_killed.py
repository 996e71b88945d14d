"""Whatever moment a command is killed at, the next one finishes to the same bytes."""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytestmark = [pytest.mark.slow, pytest.mark.physics, pytest.mark.render]


def contents(folder):
    files = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.name != ".lock"]
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def test_killed_at_ten_moments_it_finishes_to_the_same_bytes(recorded, tmp_path):
    def command(out):
        words = ["materialize", str(recorded.run.path), "--camera", "front:448", "--camera", "wrist:448"]
        return [sys.executable, "-m", "betterbench.cli", *words, "--out", str(out)]

    began = time.monotonic()
    subprocess.run(command(tmp_path / "whole"), check=True, capture_output=True)
    lasting_s = time.monotonic() - began
    whole, draw = contents(tmp_path / "whole"), np.random.default_rng(0)
    left_behind = 0
    for _ in range(10):
        process = subprocess.Popen(command(tmp_path / "out"), stderr=subprocess.DEVNULL, start_new_session=True)
        time.sleep(float(draw.uniform(0.3, 1.0)) * lasting_s)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        left_behind += any((tmp_path / "out").rglob("*.part"))
    subprocess.run(command(tmp_path / "out"), check=True, capture_output=True)
    assert left_behind > 0  # or no kill came while a file was written
    assert contents(tmp_path / "out") == whole
