"""What a policy says about itself travels between processes, whatever it was made of."""

from __future__ import annotations

import multiprocessing
from types import MappingProxyType

import pytest

from betterbench.errors import InvalidInputError
from betterbench.interface import PolicyInfo


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
