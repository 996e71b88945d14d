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

KILLS = 10
SESSIONS = 60
"""So many starts are enough for all kills; more would be a command that makes no progress."""


def finish(words: Sequence[str]) -> None:
    """Runs a command of ours to its end, in a process of its own."""
    said = subprocess.run(
        [sys.executable, "-m", "betterbench.cli", *words], capture_output=True, text=True, check=False
    )
    assert said.returncode == 0, said.stderr


def check_kills(words: Callable[[Path], Sequence[str]], content: Callable[[Path], Any], place: Path, seed: int) -> int:
    """Kills a command ten times, each time it is finished in a new folder, and compares what it then holds.

    Args:
        words: Returns the words of the command for an output folder.
        content: Returns what of a folder must not depend on kills.
        place: A folder for all of it.
        seed: Seed of the moments.

    Returns:
        How many folders were finished after a kill.
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
            kills, killed_here = kills + 1, killed_here + 1
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
                return finished
        else:
            assert process.returncode == -signal.SIGKILL
    raise AssertionError(f"not finished after {SESSIONS} starts and {kills} kills")
