"""The real LeRobot evaluates a checkpoint on our tasks; in the environment that the tests of its client have made."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "policies"))
from torch_environment import NoTorchError, run_in_torch

pytestmark = [pytest.mark.slow, pytest.mark.render, pytest.mark.physics]

DRIVE = str(Path(__file__).with_name("lerobot_drive.py"))


def drive(mode: str, folder: Path) -> None:
    try:
        done = run_in_torch(DRIVE, mode, str(folder), timeout_s=900.0)
    except NoTorchError as error:
        pytest.skip(str(error))
    assert done.returncode == 0, done.stderr[-4000:]


def test_the_command_evaluates_one_condition(tmp_path):
    drive("command", tmp_path)
    info = json.loads((tmp_path / "out" / "eval_info.json").read_text())
    # The policy never moves, which is right here: the mug stands under the machine already.
    assert info["overall"]["pc_success"] == 100.0
    assert info["overall"]["n_episodes"] == 1
    assert [Path(p).stat().st_size > 1000 for p in info["overall"]["video_paths"]] == [True]


def test_a_hub_package_evaluates_several_conditions(tmp_path):
    drive("hub", tmp_path)
    groups = json.loads((tmp_path / "hub.json").read_text())["per_group"]
    assert {name: (g["pc_success"], g["n_episodes"]) for name, g in groups.items()} == {
        "morning_coffee-T1": (100.0, 1),
        "morning_coffee-train1": (0.0, 1),
    }
