"""Kinds of models: the address decides, and a kind refuses options with which it cannot answer."""

from __future__ import annotations

from pathlib import Path

import pytest

from betterbench.errors import InvalidInputError
from betterbench.learning.training.model_kind import LEARNER_MODEL
from betterbench.vlm.models.endpoint import ENDPOINT
from betterbench.vlm.models.eyes import Eyes
from betterbench.vlm.models.hugging_face import HUGGING_FACE
from betterbench.vlm.models.kind import ModelKind, ModelOptions, kind_of

KINDS = (HUGGING_FACE, LEARNER_MODEL, ENDPOINT)


@pytest.mark.parametrize(
    ("address", "kind"),
    [
        ("hf:models/internvl", HUGGING_FACE), ("learned:learners/coffee", LEARNER_MODEL),
        ("http://localhost:8000/v1#mine", ENDPOINT), ("gpt", ENDPOINT), ("", ENDPOINT),
    ],
)  # fmt: skip
def test_the_scheme_decides_the_kind(address, kind):
    assert kind_of(address, KINDS) is kind


def test_a_further_kind_is_one_value():
    kind = ModelKind(scheme="mine", make=lambda options, _: options.target)
    options = ModelOptions(address="mine:there", own_set=True)
    assert kind_of("mine:there", (kind, *KINDS)).make(options, None) == "there"


@pytest.mark.parametrize("kind", [HUGGING_FACE, ENDPOINT])
def test_only_a_learner_gets_records(kind):
    with pytest.raises(InvalidInputError, match="--records"):
        kind.require(ModelOptions(address="x", own_set=True, records=Path("run")))


@pytest.mark.parametrize(
    ("changed", "option"),
    [
        ({"own_set": False}, "--model"), ({"data": None}, "--data"), ({"records": None}, "--records"),
        ({"eyes": Eyes.TILE_1}, "--eyes"), ({"coordinates": "pixels"}, "--coordinates"),
    ],
)  # fmt: skip
def test_a_learner_needs_recorded_states_and_sees_nothing(changed, option):
    given = {"address": "learned:x", "own_set": True, "data": Path("set"), "records": Path("run")}
    LEARNER_MODEL.require(ModelOptions(**given))
    with pytest.raises(InvalidInputError, match=option):
        LEARNER_MODEL.require(ModelOptions(**{**given, **changed}))


def test_an_endpoint_without_a_model_is_refused():
    with pytest.raises(InvalidInputError, match="hf:FOLDER, or URL#MODEL"):
        ENDPOINT.make(ModelOptions(address="http://localhost:8000/v1", own_set=True), None)
