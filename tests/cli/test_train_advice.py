"""The command that ``better train`` prints: it names the learner's action space where the robot's usual one differs."""

from __future__ import annotations

from pathlib import Path

import pytest

from betterbench.cli.verbs.train import evaluation_of


@pytest.mark.parametrize(
    ("tasks", "words"),
    [
        (["fast_food", "fruit_lunch"], "--tasks fast_food fruit_lunch --trials 3"),
        (["fruit_basket"], "--tasks fruit_basket --action-space ee_delta --trials 3"),
    ],
)
def test_the_printed_evaluation_is_in_the_learners_space(tasks, words):
    assert evaluation_of(Path("out"), tasks) == f"better eval --policy learned:out {words}"
