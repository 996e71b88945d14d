"""Interface and registry of text encoders for semantic search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from betterbench.errors import UnknownNameError


class TextEncoder(Protocol):
    """Encoder that maps texts to vectors. Texts with similar meanings have similar vectors."""

    @property
    def name(self) -> str:
        """Name of the encoder and its weights. A catalogue must be searched with the same encoder that indexed it."""

    @property
    def dimension(self) -> int:
        """Number of components of a vector."""

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """Return a unit vector for each text, as an (n, dimension) float32 array."""


@runtime_checkable
class KnowsWords(Protocol):
    """Text encoder that has a vocabulary. The vocabulary is used to recognize misspelled words in queries."""

    def has_word(self, word: str) -> bool:
        """Return whether the vocabulary contains a word, given in lower case."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderKind:
    """Kind of encoder.

    Attributes:
        scheme: Name of the encoder. If the name contains a model, as in "sentence-transformers:MODEL", the scheme is
            the part before the colon.
        summary: One sentence that describes the encoder.
        open: Function that loads the encoder. It takes the part of the name after the colon, which may be empty. It
            raises MissingDependencyError if a required package is not installed.
    """

    scheme: str
    summary: str
    open: Callable[[str], TextEncoder]


ENCODERS: dict[str, EncoderKind] = {}
"""All kinds of encoders by scheme."""

DEFAULT = "minilm"
"""Default encoder."""


def register(kind: EncoderKind) -> EncoderKind:
    """Register a kind of encoder and return it.

    Raises:
        ValueError: If a different kind of encoder already has this scheme.
    """
    if ENCODERS.setdefault(kind.scheme, kind) is not kind:
        raise ValueError(f"an encoder named {kind.scheme!r} is already registered; choose a different name")
    return kind


def open_encoder(name: str = DEFAULT) -> TextEncoder:
    """Load an encoder by its name, such as "minilm" or "sentence-transformers:MODEL".

    Raises:
        UnknownNameError: If there is no encoder with this name.
        MissingDependencyError: If the encoder's package is not installed. The message ends with the install command.
        InvalidInputError: If the weights do not have the expected hash.
    """
    scheme, _, target = name.partition(":")
    if scheme not in ENCODERS:
        raise UnknownNameError("encoder", scheme, ENCODERS)
    return ENCODERS[scheme].open(target)
