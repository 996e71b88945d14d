"""Commands that are killed at random moments and started again until they finish."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from betterbench.jobs.line_journal import LOCK_NAME

KILLS = 10
SESSIONS = 60
"""So many starts are enough for all kills; more would be a command that makes no progress."""


def finish(words: Sequence[str]) -> None:
    """Runs a command of ours to its end, in a process of its own."""
    said = subprocess.run(
        [sys.executable, "-m", "betterbench.cli", *words], capture_output=True, text=True, check=False
    )
    assert said.returncode == 0, said.stderr


def check_kills(words: Callable[[Path], Sequence[str]], content: Callable[[Path], Any], place: Path, seed: int) -> None:
    """Kills a command ten times at its work, and compares what it holds wherever it is finished.

    A kill counts where the command had written something. A folder is finished by the same command, killed again on
    the way or not; the next kill then strikes in a new one.

    Args:
        words: Returns the words of the command for an output folder.
        content: Returns what of a folder must not depend on kills.
        place: A folder for all of it.
        seed: Seed of the moments.
    """
    began = time.monotonic()
    finish(words(place / "whole"))
    lasted_s, known = time.monotonic() - began, content(place / "whole")
    assert known
    draw, kills, finished, killed_here = np.random.default_rng(seed), 0, 0, 0
    for _ in range(SESSIONS):
        out = place / f"killed{finished}"
        fresh, began = not out.exists(), time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-m", "betterbench.cli", *words(out)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            process.wait(float(draw.uniform(0.25, 0.9)) * lasted_s if kills < KILLS else None)
        except subprocess.TimeoutExpired:
            if any(p.is_file() and p.name != LOCK_NAME for p in out.rglob("*")):
                kills, killed_here = kills + 1, killed_here + 1
            else:  # the machine has become slower since the time was taken
                lasted_s *= 1.25
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process.pid, signal.SIGKILL)
            process.wait()
        if process.returncode == 0:
            assert content(out) == known, f"differs after {killed_here} kills"
            if fresh:  # the first time may have been measured on a busy machine
                lasted_s = min(lasted_s, time.monotonic() - began)
            finished, killed_here = finished + 1, 0
            if kills == KILLS:
                return
        else:
            assert process.returncode == -signal.SIGKILL
    raise AssertionError(f"not finished after {SESSIONS} starts and {kills} kills")
