"""What torch's launcher says in the environment."""

from __future__ import annotations

import pytest

from betterbench.errors import InvalidInputError
from betterbench.learning.training.processes import TrainingProcesses


@pytest.mark.parametrize(
    ("rank", "size"), [("1", None), ("abc", "2"), ("-1", "2"), ("2", "2"), ("0", "0"), ("0", "many")]
)
def test_an_environment_without_sense_is_one_line(monkeypatch, rank, size):
    monkeypatch.setenv("RANK", rank)
    if size is not None:
        monkeypatch.setenv("WORLD_SIZE", size)
    with pytest.raises(InvalidInputError, match=f"RANK={rank}, WORLD_SIZE={size or 1}, LOCAL_RANK=0.*torchrun"):
        TrainingProcesses.here()


def test_without_a_launcher_there_is_one_process_that_takes_the_named_device():
    alone = TrainingProcesses.here()
    assert alone == TrainingProcesses(0, 1, 0)
    assert [alone.device(name) for name in ("cpu", "cuda", "cuda:3")] == ["cpu", "cuda", "cuda:3"]


def test_each_process_takes_the_card_of_its_own_number(monkeypatch):
    for name, text in {"RANK": "5", "WORLD_SIZE": "8", "LOCAL_RANK": "1"}.items():
        monkeypatch.setenv(name, text)
    here = TrainingProcesses.here()
    assert here == TrainingProcesses(5, 8, 1)
    assert [here.device(name) for name in ("cpu", "cuda")] == ["cpu", "cuda:1"]
    with pytest.raises(InvalidInputError, match=r"--device cuda:0.*8 processes.*Use --device cuda"):
        here.device("cuda:0")
