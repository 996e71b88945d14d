"""The row of the speed table about training, on a training set that was never recorded."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
import torch
from made_up import made_up, pictured
from small_recipes import PIXELS, tiny

BENCHMARKS = Path(__file__).resolve().parents[3] / "benchmarks"


@pytest.fixture
def row(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("training_speed")


def test_both_families_are_measured(row, tmp_path):
    threads = torch.get_num_threads()
    data = pictured(tmp_path / "frames", 4)
    figures = [
        row.training_figure(tiny(), made_up(), blocks=3),
        row.training_figure(tiny(**PIXELS), data, blocks=3),
    ]
    torch.set_num_threads(threads)
    for figure in figures:
        assert len(figure.values) == 2
        assert min(figure.values) > 0.0
        assert (figure.row, figure.bound) == ("train", 0.9)


def test_copies_are_whole_demonstrations(row, tmp_path):
    data = pictured(tmp_path / "frames", 1)
    data = row.replace(data, shown=np.ones(len(data.actions), bool))
    many = row.copied(data, tmp_path / "frames", 3)
    assert np.array_equal(many.actions, np.concatenate([data.actions] * 3))
    assert [(a, b) for a, b in zip(many.first, many.last, strict=True)] == [(0, 19), (20, 39), (40, 59)]
    assert many.episodes[[0, 20, 59]].tolist() == [0, 1, 2]
    assert np.array_equal(many.frames_of.read(np.array([45])), data.frames_of.read(np.array([5])))
