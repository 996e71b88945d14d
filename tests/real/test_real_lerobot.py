"""The tests in ``with_lerobot.py``, in an environment with lerobot that is made for them.

``BETTER_LEROBOT_PYTHON`` names another Python that has lerobot with its Feetech motors, and the packages of this
project: so other versions of lerobot are tested.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.locked_environment import ROOT, locked_python

sys.path.insert(0, str(ROOT / "tests" / "policies"))
from torch_environment import DECLARE_OPERATOR

HERE = Path(__file__).parent
MODULES = {"torchvision_for_processors": DECLARE_OPERATOR.lstrip()}
CHECK = f"import sys; sys.path.insert(0, {str(HERE)!r}); import lerobot_driving, lerobot.robots, scservo_sdk"


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.physics
def test_lerobots_own_classes_on_emulated_servos():
    named = os.environ.get("BETTER_LEROBOT_PYTHON")
    python = named or locked_python(
        "lerobot-feetech", shared=True, check=CHECK, modules=MODULES, built=("feetech-servo-sdk",)
    )
    env = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "OMP_NUM_THREADS": "1"}
    words = ["-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", str(HERE / "with_lerobot.py")]
    done = subprocess.run(
        [python, *words], check=False, capture_output=True, text=True, timeout=1800.0, cwd=ROOT, env=env
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    assert re.search(r"\d\d passed", done.stdout)
    assert "skipped" not in done.stdout
