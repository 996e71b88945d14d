"""Interface and registry of text encoders for semantic search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from betterbench.errors import UnknownNameError


class TextEncoder(Protocol):
    """Encoder that maps texts to vectors; texts of similar meaning have nearby vectors."""

    @property
    def name(self) -> str:
        """Name of the encoder and its weights; a catalogue must be searched with the encoder that indexed it."""

    @property
    def dimension(self) -> int:
        """Length of the vectors."""

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """Return unit vectors, (n, dimension) float32."""


@runtime_checkable
class KnowsWords(Protocol):
    """Encoder with a vocabulary, by which misspelled words of a query are recognized."""

    def has_word(self, word: str) -> bool:
        """Return whether a word in lower case is in the vocabulary."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderKind:
    """Kind of encoder.

    Attributes:
        scheme: Name, or the word before the colon of a name.
        summary: One sentence about the kind.
        open: Loads the encoder for a target (may be empty); raises MissingDependencyError without its package.
    """

    scheme: str
    summary: str
    open: Callable[[str], TextEncoder]


ENCODERS: dict[str, EncoderKind] = {}
"""All kinds of encoders by scheme."""

DEFAULT = "minilm"
"""Default encoder."""


def register(kind: EncoderKind) -> EncoderKind:
    """Register a kind of encoder, and return it.

    Raises:
        ValueError: If another kind already has this scheme.
    """
    if ENCODERS.setdefault(kind.scheme, kind) is not kind:
        raise ValueError(f"another encoder is called {kind.scheme!r}; give this one another name")
    return kind


def open_encoder(name: str = DEFAULT) -> TextEncoder:
    """Load an encoder by name ("minilm", "sentence-transformers:MODEL").

    Raises:
        UnknownNameError: If no such encoder exists.
        MissingDependencyError: If the encoder's package is not installed; the message ends with the install command.
        InvalidInputError: If the weights are not the expected weights.
    """
    scheme, _, target = name.partition(":")
    if scheme not in ENCODERS:
        raise UnknownNameError("encoder", scheme, ENCODERS)
    return ENCODERS[scheme].open(target)
