"""The command that ``better train`` prints: it names the learner's action space where the robot's usual one differs."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from betterbench.cli.verbs.train import evaluation_of
from betterbench.errors import MissingDependencyError
from betterbench.installation import extra_command
from betterbench.tasks import user_files
from betterbench.tasks.user_files import load_task_files

PAGE = Path(__file__).parents[2] / "docs" / "adding-a-learner.md"


@pytest.mark.parametrize(
    ("tasks", "words"),
    [
        (["fast_food", "fruit_lunch"], "--tasks fast_food fruit_lunch --trials 3"),
        (["fruit_basket"], "--tasks fruit_basket --action-space ee_delta --trials 3"),
    ],
)
def test_the_printed_evaluation_is_in_the_learners_space(tasks, words):
    assert evaluation_of(Path("out"), tasks) == f"better eval --policy learned:out {words}"


def test_a_learner_s_file_without_torch_is_told_how_to_install_it(monkeypatch, tmp_path):
    (learner,) = re.findall(r"```py\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    line = learner.splitlines().index("import torch") + 1
    file = tmp_path / "my_learner.py"
    file.write_text(learner, encoding="utf-8")
    monkeypatch.setattr(user_files, "_files", {})
    monkeypatch.setenv(user_files.VARIABLE, "")
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(MissingDependencyError) as caught:
        load_task_files([file])
    place = f"{file}, line {line}"
    assert str(caught.value) == f"{place}: it imports torch, which is not installed. Run: {extra_command('train')}"
    assert not user_files._files
