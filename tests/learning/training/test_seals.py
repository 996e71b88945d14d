"""Checkpoints and states of training: a bit that changes is refused, in what they say about themselves too."""

from __future__ import annotations

import json
import os
import shutil

import numpy as np
import pytest
import torch
from made_up import made_up
from small_recipes import tiny

from betterbench.errors import InvalidInputError, RecordError
from betterbench.json_form import file_digest
from betterbench.learning.study.learning import TrainedPolicy, TrainingJob, require_weights, train_learners
from betterbench.policies.learned.checkpoint import (
    Trained,
    read_checkpoint,
    read_tensors,
    write_checkpoint,
    write_tensors,
)
from betterbench.policies.learned.network import ObjectsNetwork

COUNT = int(os.environ.get("BETTERBENCH_MUTATIONS", "120"))


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    path = tmp_path_factory.mktemp("learner") / "checkpoint.safetensors"
    recipe, known = tiny(), made_up().vocabulary
    torch.manual_seed(0)
    write_checkpoint(path, ObjectsNetwork(recipe, known).state_dict(), Trained(recipe, known, 12, "ab" * 32))
    return path


def header_of(data):
    length = int.from_bytes(data[:8], "little")
    return json.loads(data[8 : 8 + length]), data[8 + length :]


def with_header(header, rest):
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + rest


def test_every_bit_of_a_header_counts(checkpoint, tmp_path):
    data = checkpoint.read_bytes()
    length = int.from_bytes(data[:8], "little")
    _, trained = read_checkpoint(checkpoint)
    copy, draw, refused = tmp_path / "copy.safetensors", np.random.default_rng(0), 0
    for place in [*draw.integers(8 + length, size=4 * COUNT), *draw.integers(len(data), size=COUNT)]:
        changed = bytearray(data)
        changed[place] ^= 1 << int(draw.integers(8))
        copy.write_bytes(changed)
        try:
            _, found = read_checkpoint(copy)
        except InvalidInputError:
            refused += 1
        else:
            assert found == trained  # a space for another one
    assert refused > 4.8 * COUNT


@pytest.mark.parametrize(
    "change",
    [
        lambda about: about.update(step=13),
        lambda about: about.update(data="cd" * 32),
        lambda about: about["recipe"].update(seed=987),
        lambda about: about["vocabulary"]["words"].reverse(),
        lambda about: about.update(code="mine.py"),
    ],
)
def test_what_a_checkpoint_says_about_itself_is_under_its_digest(checkpoint, tmp_path, change):
    header, rest = header_of(checkpoint.read_bytes())
    about = json.loads(header["__metadata__"]["betterbench"])
    change(about)
    header["__metadata__"]["betterbench"] = json.dumps(about, sort_keys=True)
    copy = tmp_path / "copy.safetensors"
    copy.write_bytes(with_header(header, rest))
    with pytest.raises(InvalidInputError, match="weights or metadata have changed"):
        read_checkpoint(copy)


def test_a_state_of_training_is_sealed_as_a_checkpoint_is(tmp_path):
    path = tmp_path / "state.safetensors"
    write_tensors(path, {"mean/a": torch.arange(4.0)}, {"step": 40, "rows": [[0.5, 1.0]], "training": "ab" * 32})
    for old, new in ((b'\\"step\\": 40', b'\\"step\\": 80'), (b"0.5", b"0.4"), (b"abab", b"abac")):
        data = path.read_bytes()
        assert old in data
        (tmp_path / "copy").write_bytes(data.replace(old, new, 1))
        with pytest.raises(InvalidInputError, match="weights or metadata have changed"):
            read_tensors(tmp_path / "copy")


def test_checkpoints_of_earlier_versions_are_read_and_that_is_said(checkpoint, tmp_path, caplog, monkeypatch):
    from betterbench.policies.learned import checkpoint as module

    network, trained = read_checkpoint(checkpoint)
    monkeypatch.setattr(module, "_seal", lambda _about, weights: weights)
    old = tmp_path / "checkpoint.safetensors"
    write_checkpoint(old, network.state_dict(), trained)
    monkeypatch.undo()
    caplog.clear()
    assert read_checkpoint(old)[1] == trained
    assert "without a seal" in caplog.text


def test_weights_that_were_exchanged_are_not_those_of_the_learner(checkpoint, tmp_path):
    folder = tmp_path / "learner"
    shutil.copytree(checkpoint.parent, folder)
    policy = TrainedPolicy(f"learned:{folder}", file_digest(folder / checkpoint.name))
    policy.require()
    recipe, known = tiny(), made_up().vocabulary
    write_checkpoint(
        folder / checkpoint.name, ObjectsNetwork(recipe, known).state_dict(), Trained(recipe, known, 12, "")
    )
    with pytest.raises(RecordError, match=r"other weights than those trained by this study.*nothing was deleted"):
        policy.require()
    lever = TrainingJob(tiny(start=str(folder)), tmp_path / "lever", policy.digest)
    with pytest.raises(RecordError, match="other weights"):
        train_learners([lever], "cpu", lambda *_: None)
    (folder / checkpoint.name).unlink()
    with pytest.raises(RecordError, match="is missing"):
        require_weights(folder, policy.digest)
