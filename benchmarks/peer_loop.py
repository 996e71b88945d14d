"""Code shared by the scripts of all peers, for requests on standard input, time measurement, and a check of the images.

:mod:`peer` runs ``robosuite_peer.py`` or ``libero_peer.py`` with the Python of that peer's own environment. This module
runs there too, so it needs only numpy and no part of betterbench. It reads one JSON object per line from standard input
and writes one per line to standard output:

===========================================  ==================================================================
request                                      answer
===========================================  ==================================================================
``{"do": "make", "all": false}``             ``{"seconds": [s], "images": [{…}], "versions": {package: version}}``
``{"do": "step", "count": 3}``               ``{"seconds": [s, s, s], "images": [{…}, {…}, {…}]}``
``{"do": "reset"}``                          ``{"seconds": [s], "images": [{…}]}``
===========================================  ==================================================================

``all`` requests depth and instance masks besides colors. Time is measured here, so that it does not include the pipe.
The answer to each step and each reset contains a digest of every image, computed after the time was taken:
``{"frontview": "0b5e…", "robot0_eye_in_hand": "77c1…"}``. The digests show whether the images change. The digest is
replaced by ``"flat"`` if all pixels are equal, and by ``"noise"`` if neighboring pixels are unrelated, as in memory
into which nothing was drawn.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np

SIZE = 256
"""Width and height of an image [pixel]."""

CONTROL_RATE_HZ = 20

ACTION_SIZE = 0.1
"""Largest component of an action, in a range of ±1, so that the arm stays near its start."""

WARM_UP_STEPS = 2
"""Number of steps after a build or a reset that are not timed, because shaders are compiled during these steps, and
robosuite returns the images of the reset again after the first step."""

LEAST_LIKENESS = 0.5
"""Least correlation of horizontal neighbors in an image: 0.95 and 0.97 in robosuite's, 0.04 in uninitialized memory."""

Images = Mapping[str, np.ndarray]
"""Images of one step by name: (256, 256, 3) colors, or (256, 256, 1) depth."""


class PeerEnvironment(Protocol):
    """Interface of a peer's script."""

    def make(self, *, everything: bool) -> None:
        """Build the environment, with depth and instance masks if ``everything`` is true."""

    def reset(self) -> Images:
        """Go to a new layout and return its images."""

    def step(self, draw: np.random.Generator) -> Images:
        """Take one control step with a small random action and return its images."""

    def versions(self) -> dict[str, str]:
        """Return the versions of the packages that influence the speed."""


class _Session:
    """One environment and the requests that it answers."""

    def __init__(self, environment: PeerEnvironment) -> None:
        self._environment = environment
        self._draw = np.random.default_rng(0)

    def answer(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Do what a request asks for.

        Raises:
            KeyError: If the request is unknown.
        """
        work: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
            "make": self._make,
            "step": self._step,
            "reset": self._reset,
        }
        return work[request["do"]](request)

    def _make(self, request: Mapping[str, Any]) -> dict[str, Any]:
        began = time.perf_counter()
        self._environment.make(everything=bool(request["all"]))
        images = self._environment.reset()
        seconds = time.perf_counter() - began
        self._warm_up()
        return {"seconds": [seconds], "images": [_digests(images)], "versions": self._environment.versions()}

    def _step(self, request: Mapping[str, Any]) -> dict[str, Any]:
        answer: dict[str, Any] = {"seconds": [], "images": []}
        for _ in range(int(request["count"])):
            began = time.perf_counter()
            images = self._environment.step(self._draw)
            answer["seconds"].append(time.perf_counter() - began)
            answer["images"].append(_digests(images))
        return answer

    def _reset(self, _request: Mapping[str, Any]) -> dict[str, Any]:
        began = time.perf_counter()
        images = self._environment.reset()
        seconds = time.perf_counter() - began
        self._warm_up()
        return {"seconds": [seconds], "images": [_digests(images)]}

    def _warm_up(self) -> None:
        for _ in range(WARM_UP_STEPS):
            self._environment.step(self._draw)


def _digests(images: Images) -> dict[str, str]:
    """Return a digest of each image, or what is wrong with it.

    Raises:
        ValueError: If an image does not have the requested size.
    """
    for name, image in images.items():
        if image.shape[:2] != (SIZE, SIZE):
            raise ValueError(f"{name} has the shape {image.shape}")
    return {
        name: _fault(image) or hashlib.blake2b(image.tobytes(), digest_size=8).hexdigest()
        for name, image in images.items()
    }


def _fault(image: np.ndarray) -> str:
    """Return "flat", "noise", or an empty text for an image that shows something."""
    pixels = image.astype(np.float64)
    if pixels.min() == pixels.max():
        return "flat"
    left, right = pixels[:, :-1].ravel(), pixels[:, 1:].ravel()
    with np.errstate(invalid="ignore"):
        likeness = np.corrcoef(left, right)[0, 1]
    return "" if likeness >= LEAST_LIKENESS else "noise"


def serve(environment: PeerEnvironment) -> None:
    """Answer requests until standard input ends.

    Args:
        environment: The peer.
    """
    # Peer packages print to standard output. This is redirected to standard error, so the pipe only has answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    session = _Session(environment)
    for line in sys.stdin:
        answers.write(json.dumps(session.answer(json.loads(line))) + "\n")
        answers.flush()
