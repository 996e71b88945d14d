"""What needs torch and the real LeRobot, run in an environment that is made for it; see ``torch_environment.py``."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from betterbench.errors import MissingDependencyError
from betterbench.policies.kinds import make_policy

sys.path.insert(0, str(Path(__file__).parent))
from torch_environment import NoTorchError, run_in_torch

HERE = Path(__file__).parent
without_torch = pytest.mark.skipif(importlib.util.find_spec("torch") is not None, reason="torch is installed here")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["torch_being_h.py", "torch_lerobot.py"])
def test_in_torch(name):
    try:
        done = run_in_torch("-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", str(HERE / name), timeout_s=1800.0)
    except NoTorchError as error:
        pytest.skip(str(error))
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert "skipped" not in done.stdout


@without_torch
@pytest.mark.parametrize(
    ("address", "extra"), [("being-h://127.0.0.1:9", "being-h"), ("lerobot:some/checkpoint", "lerobot")]
)
def test_without_the_extra_its_name_is_told(address, extra):
    with pytest.raises(MissingDependencyError, match=rf"make .*setup EXTRAS={extra}") as caught:
        make_policy(address)
    assert "\n" not in str(caught.value)
