"""What a policy says about itself travels between processes, whatever it was made of."""

from __future__ import annotations

import multiprocessing
from types import MappingProxyType

import numpy as np
import pytest

from betterbench.errors import InvalidInputError
from betterbench.interface import Execution, PolicyInfo


def test_any_mapping_can_be_sent_to_another_process():
    info = PolicyInfo("mine", metadata=MappingProxyType({"checkpoint": "c1"}))
    assert info == PolicyInfo("mine", metadata={"checkpoint": "c1"})
    ours, theirs = multiprocessing.Pipe()
    with ours, theirs:
        ours.send(info)
        assert theirs.recv() == info


def test_what_is_written_into_the_mapping_later_changes_nothing():
    texts = {"checkpoint": "c1"}
    info = PolicyInfo("mine", metadata=texts)
    texts["checkpoint"] = "c2"
    assert info.metadata == {"checkpoint": "c1"}


@pytest.mark.parametrize("metadata", [["checkpoint"], {"layers": 3}, MappingProxyType({3: "layers"})])
def test_what_is_no_mapping_of_texts_is_refused(metadata):
    with pytest.raises(InvalidInputError, match="PolicyInfo: metadata"):
        PolicyInfo("mine", metadata=metadata)


@pytest.mark.parametrize(
    "values",
    [
        {"horizon": 2.5},
        {"horizon": True},
        {"horizon": "8"},
        {"ahead": 0.5, "horizon": 4},
        {"ahead": None},
        {"ensemble": "0.01"},
        {"ensemble": False},
    ],
)
def test_how_chunks_are_played_is_said_in_numbers_and_not_rounded(values):
    with pytest.raises(InvalidInputError, match=f"Execution: {next(iter(values))}: it is of type"):
        Execution(**values)
    assert Execution(np.int64(8), np.int32(2)) == Execution(8, 2)
    assert Execution(ensemble=np.float32(0.5)).ensemble == 0.5


@pytest.mark.parametrize(
    "values",
    [{"needs_images": "no"}, {"needs_images": 0}, {"heavy": []}, {"cameras": "front"}, {"cameras": 3}],
)
def test_a_text_is_no_truth_and_no_list_of_cameras(values):
    with pytest.raises(InvalidInputError, match=f"PolicyInfo: {next(iter(values))}"):
        PolicyInfo("mine", **values)
