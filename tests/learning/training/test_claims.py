"""A checkpoint that claims what its weights do not have is refused before the claim costs time or memory."""

from __future__ import annotations

import json
import time
import tracemalloc

import pytest
import torch
from small_recipes import PIXELS, tiny

from betterbench.errors import BetterError, InvalidInputError
from betterbench.policies.learned.checkpoint import (
    Trained,
    read_checkpoint,
    read_tensors,
    write_checkpoint,
    write_tensors,
)
from betterbench.policies.learned.networks import new_network
from betterbench.policies.learned.vocabulary import Vocabulary

VOCABULARY = Vocabulary.of(["put the mug on the tray"], ["mug", "tray"], ["red", "blue"])


@pytest.mark.parametrize("size", ["small", "base", "large", {"width": 8, "layers": 1, "heads": 1}])
@pytest.mark.parametrize("family", [{}, PIXELS], ids=["objects", "pixels"])
def test_every_honest_size_is_read(tmp_path, size, family):
    recipe = tiny(**family, capacity=size)
    network = new_network(recipe, VOCABULARY)
    write_checkpoint(tmp_path / "c.safetensors", network.state_dict(), Trained(recipe, VOCABULARY, 12, "0" * 64))
    assert read_checkpoint(tmp_path / "c.safetensors")[1].recipe == recipe


@pytest.fixture(params=[{}, PIXELS], ids=["objects", "pixels"])
def checkpoint(request, tmp_path):
    recipe = tiny(**request.param)
    network = new_network(recipe, VOCABULARY)
    write_checkpoint(tmp_path / "c.safetensors", network.state_dict(), Trained(recipe, VOCABULARY, 12, "0" * 64))
    return tmp_path / "c.safetensors"


def claimed(path, change):
    """Writes the header again with a change of what it says."""
    data = path.read_bytes()
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    about = json.loads(header["__metadata__"]["betterbench"])
    header["__metadata__"]["betterbench"] = json.dumps(change(about))
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    path.write_bytes(len(text).to_bytes(8, "little") + text + data[8 + length :])


def claimed_under_a_seal(path, change):
    """Writes a checkpoint again with a change of what it says, under a seal that holds: anybody can compute it."""
    tensors, about = read_tensors(path)
    write_tensors(path, tensors, change(about))


def test_an_honest_one_is_read(checkpoint):
    network, trained = read_checkpoint(checkpoint)
    assert trained.vocabulary == VOCABULARY
    assert all(bool(parameter.isfinite().all()) for parameter in network.parameters())


@pytest.mark.parametrize(
    "change",
    [
        {"capacity": {"width": 1024, "layers": 12, "heads": 16}},
        {"capacity": "large"},
        {"capacity": {"width": 1024, "layers": 1, "heads": 1}},
    ],
    ids=["widest", "large", "wide"],
)
def test_a_claim_of_a_large_network_costs_nothing(checkpoint, change, monkeypatch):
    claimed_under_a_seal(checkpoint, lambda about: {**about, "recipe": {**about["recipe"], **change}})
    made = []
    monkeypatch.setattr(torch.nn, "Linear", lambda *sizes, **_: made.append(sizes))
    began = time.perf_counter()
    tracemalloc.start()
    with pytest.raises(InvalidInputError, match="do not match its recipe"):
        read_checkpoint(checkpoint)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert time.perf_counter() - began < 2.0
    assert most < 64 << 20
    assert not made


def test_a_vocabulary_of_a_million_words_costs_nothing(checkpoint):
    words = [f"w{i:06}" for i in range(300_000)]
    claimed_under_a_seal(checkpoint, lambda about: {**about, "vocabulary": {**about["vocabulary"], "words": words}})
    began = time.perf_counter()
    with pytest.raises(InvalidInputError):
        read_checkpoint(checkpoint)
    assert time.perf_counter() - began < 5.0


FOREIGN = (None, True, -1, 1.5, 10**400, "x", [], [[]], {}, {"a": {}}, json.loads("[" * 150 + "]" * 150))


def refusal(path):
    """Returns in what words a checkpoint is refused; empty if it is read."""
    try:
        read_checkpoint(path)
    except BetterError as error:
        return str(error)
    return ""


def test_headers_of_other_shapes_are_refused_in_one_line(checkpoint):
    whole = checkpoint.read_bytes()
    changes = [lambda _, v=value: v for value in FOREIGN]
    for field in ("recipe", "vocabulary", "step", "data", "action_space", "sha256"):
        changes += [lambda about, f=field, v=value: {**about, f: v} for value in FOREIGN]
        changes += [lambda about, f=field: {k: v for k, v in about.items() if k != f}]
    for number, change in enumerate(changes):
        checkpoint.write_bytes(whole)
        claimed(checkpoint, change)
        said = refusal(checkpoint)
        assert "\n" not in said, number
        assert len(said) < 2000, number
