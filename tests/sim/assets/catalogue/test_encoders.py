"""Encoders: the default one against published figures, its pinned weights, and those of the user."""

from __future__ import annotations

import math
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from betterbench.errors import InvalidInputError, MissingDependencyError, UnknownNameError
from betterbench.sim.assets.catalogue.encoders import minilm, open_encoder
from betterbench.sim.assets.catalogue.encoders.wordpiece import WordPieces

PIECES = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "mug", "cup", "##s", "un", "##open", "##ed", ",", "!", "cafe", "中"]


@pytest.mark.parametrize(
    ("text", "pieces"),
    [
        ("Mugs, UNOPENED!", ["mug", "##s", ",", "un", "##open", "##ed", "!"]),
        ("café\tcup\u0000s", ["cafe", "cup", "##s"]),
        ("x中", ["[UNK]", "中"]),
        ("m" * 200, ["[UNK]"]),
        ("", []),
    ],
)
def test_texts_are_split_into_the_longest_known_pieces(text, pieces):
    numbers = WordPieces(PIECES).numbers(text, limit=128)
    assert [PIECES[number] for number in numbers] == ["[CLS]", *pieces, "[SEP]"]


def test_a_word_of_the_vocabulary_is_one_piece():
    pieces = WordPieces(PIECES)
    assert pieces.has_word("mug")
    assert not pieces.has_word("mugs")
    assert not pieces.has_word("open")


def test_gelu_is_computed_for_every_row():
    x = np.random.default_rng(5).normal(scale=3.0, size=(70, 9)).astype(np.float32)
    expected = [[v * 0.5 * (1.0 + math.erf(v / math.sqrt(2.0))) for v in row] for row in x.tolist()]
    assert np.allclose(minilm._gelu(x), expected, atol=2e-6)


def test_a_long_text_is_cut():
    assert len(WordPieces(PIECES).numbers("mug " * 500, limit=128)) == 128


def test_without_its_weights_the_command_is_named(monkeypatch):
    monkeypatch.setattr(minilm, "find_files", lambda: None)
    with pytest.raises(MissingDependencyError, match=r"needs the optional extra `assets`.*Run: .*assets"):
        open_encoder()


def test_other_weights_are_refused(tmp_path):
    (tmp_path / "model.safetensors").write_bytes(b"other")
    with pytest.raises(InvalidInputError, match="is not the expected file of all-MiniLM-L6-v2"):
        minilm.MiniLm(tmp_path / "model.safetensors", tmp_path / "vocab.txt")


def test_an_unknown_encoder_is_answered_with_the_known_ones():
    with pytest.raises(UnknownNameError, match="minilm, sentence-transformers"):
        open_encoder("bert")
    with pytest.raises(InvalidInputError, match="the model name is missing"):
        open_encoder("sentence-transformers")


def test_a_model_of_the_user_is_loaded_by_name(monkeypatch):
    class Model:
        def __init__(self, name):
            self.name = name

        def encode(self, texts, **_):
            return [[3.0, 4.0] for _ in texts]

    monkeypatch.setitem(sys.modules, "sentence_transformers", SimpleNamespace(SentenceTransformer=Model))
    encoder = open_encoder("sentence-transformers:clip-ViT-B-32")
    assert (encoder.name, encoder.dimension) == ("sentence-transformers:clip-ViT-B-32", 2)
    np.testing.assert_allclose(encoder.encode(["a"]), [[0.6, 0.8]])
    monkeypatch.setitem(sys.modules, "sentence_transformers", None)
    with pytest.raises(MissingDependencyError, match="sentence-transformers"):
        open_encoder("sentence-transformers:x")


@pytest.mark.slow
def test_the_default_encoder_gives_the_published_similarities():
    """The example on the model's page of sentence-transformers, to the digits that are printed there."""
    try:
        encoder = open_encoder()
    except MissingDependencyError as error:
        pytest.skip(str(error))
    texts = ["The weather is lovely today.", "It's so sunny outside!", "He drove to the stadium."]
    vectors = encoder.encode(texts)
    expected = [[1.0, 0.6660, 0.1046], [0.6660, 1.0, 0.1411], [0.1046, 0.1411, 1.0]]
    np.testing.assert_allclose(vectors @ vectors.T, expected, atol=6e-5)
    np.testing.assert_allclose(encoder.encode(texts[1:2]), vectors[1:2], atol=2e-6)
