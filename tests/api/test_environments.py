"""One task as an environment, and the tasks of a user's file."""

from __future__ import annotations

import copy
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import betterbench
from betterbench.errors import InvalidInputError, UnknownNameError

pytestmark = pytest.mark.physics

PAGE = Path(__file__).parents[2] / "docs" / "own-tasks.md"


def test_the_environment_is_that_of_gymnasium():
    env = betterbench.make_env("morning_coffee", "L1", observation="state_only", quality="fast")
    seen, info = env.reset(seed=3)
    assert info["condition"] == "morning_coffee/L1"
    assert info["seed"] == 3
    assert env.instruction == info["instruction"]
    assert set(seen) == set(env.observation_space.spaces)
    *_, info = env.step(np.zeros(7))
    assert info["step"] == 1
    env.close()


@pytest.mark.parametrize(
    ("arguments", "closest"),
    [
        ({"task": "fast_fod"}, "fast_food"),
        ({"task": "fast_food", "variation": "L9"}, "L1"),
        ({"task": "fast_food", "observation": "state"}, "state_only"),
    ],
)
def test_unknown_names_are_answered_with_the_closest_ones(arguments, closest):
    with pytest.raises(UnknownNameError) as caught:
        betterbench.make_env(**arguments)
    assert closest in caught.value.closest


def test_tasks_of_a_file_are_made_and_registered(tmp_path):
    (mine,) = re.findall(r"```py\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    (tmp_path / "my_tasks.py").write_text(mine)
    code = (
        "import gymnasium, betterbench; betterbench.load_task_files('my_tasks.py');"
        "print(betterbench.make_env('my_coffee').step_limit, gymnasium.spec('BeTTER/MyCoffee-v0').id)"
    )
    environment = {key: value for key, value in os.environ.items() if key != "BETTERBENCH_TASK_FILES"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, cwd=tmp_path)
    assert done.stdout.split() == ["540", "BeTTER/MyCoffee-v0"], done.stderr


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy])
def test_an_environment_that_is_copied_says_to_make_another(copied):
    with pytest.raises(InvalidInputError, match="TaskEnv: an environment cannot be pickled or copied"):
        copied(betterbench.make_env("fast_food", observation="state_only"))


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InvalidInputError, match="nowhere"):
        betterbench.load_task_files(tmp_path / "nowhere.py")
