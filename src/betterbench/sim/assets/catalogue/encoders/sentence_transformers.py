"""Encoders that use the package sentence-transformers, if it is installed: SBERT models and CLIP's text model."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from betterbench.errors import InvalidInputError, described
from betterbench.installation import missing_packages
from betterbench.sim.assets.catalogue.encoders.encoder import EncoderKind, register

NAME = "sentence-transformers"


class SentenceEncoder:
    """A sentence-transformers model, given by its name or its folder. The package may download the model."""

    def __init__(self, model: str, loaded: Any) -> None:  # noqa: ANN401 - a class of the package
        self.name = f"{NAME}:{model}"
        self._model = loaded
        self.dimension = self.encode(["size"]).shape[1]

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """Return a unit vector for each text, as an (n, dimension) float32 array."""
        found = np.asarray(self._model.encode(list(texts), convert_to_numpy=True, show_progress_bar=False), np.float32)
        if found.ndim != 2 or len(found) != len(texts) or not np.isfinite(found).all():
            problem = (
                f"it returned an array of shape {found.shape} for {len(texts)} texts, or values that are not finite"
            )
            raise InvalidInputError(self.name, problem, "Use a text embedding model")
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), np.float32(1e-12)))


def _open(target: str) -> SentenceEncoder:
    if not target:
        raise InvalidInputError(
            "encoder",
            "the model name is missing",
            f"Write, for example, {NAME}:all-mpnet-base-v2 or {NAME}:clip-ViT-B-32",
        )
    try:
        package = importlib.import_module("sentence_transformers")
    except ImportError as error:
        raise missing_packages(f"The encoder {NAME} needs its package, which is not installed", NAME) from error
    try:
        return SentenceEncoder(target, package.SentenceTransformer(target))
    except (OSError, ValueError, RuntimeError) as error:
        problem = f"it could not be loaded ({described(error)})"
        raise InvalidInputError(
            f"{NAME}:{target}", problem, "Check the name of the model and the network connection"
        ) from error


register(
    EncoderKind(
        scheme=NAME,
        summary="An SBERT or CLIP model of the package sentence-transformers, which you install yourself.",
        open=_open,
    )
)
