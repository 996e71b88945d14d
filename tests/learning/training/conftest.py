"""Where the extra `train` is not installed, the tests that train are left out."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

TESTS = Path(__file__).parents[2]
sys.path[:0] = [str(TESTS / name) for name in ("learning/training", "policies/learned", "demonstrations/export")]

NEEDED = ("torch", "safetensors")
collect_ignore = (
    []
    if all(map(importlib.util.find_spec, NEEDED))
    else [
        "test_acting.py",
        "test_claims.py",
        "test_loop.py",
        "test_own_answers.py",
        "test_own_learner.py",
        "test_row_in_torch.py",
        "test_seals.py",
    ]
)
