"""What the scripts of all peers share: requests on standard input, the clock, and a look at the images.

:mod:`peer` runs ``robosuite_peer.py`` or ``libero_peer.py`` with the Python of that peer's own environment. This module
runs there too, so it needs numpy and nothing of betterbench. One JSON object per line comes in on standard input, one
goes out on standard output:

===========================================  ==================================================================
request                                      answer
===========================================  ==================================================================
``{"do": "make", "all": false}``             ``{"seconds": [s], "images": [{…}], "versions": {package: version}}``
``{"do": "step", "count": 3}``               ``{"seconds": [s, s, s], "images": [{…}, {…}, {…}]}``
``{"do": "reset"}``                          ``{"seconds": [s], "images": [{…}]}``
===========================================  ==================================================================

``all`` asks for depth and instance masks besides colors. The clock stands here, beside the work, so that the pipe is
not part of what is measured. Each step and each reset comes with a digest of every image it gave, taken after the clock
was stopped: ``{"frontview": "0b5e…", "robot0_eye_in_hand": "77c1…"}``. Whoever reads them knows whether images change.
In place of a digest stands ``"flat"`` if all pixels are equal, and ``"noise"`` if neighbors have nothing to do with
each other, which is what memory looks like that nothing was drawn into.
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
"""Largest component of an action, of a range of 1: the arm stays near its start, as in the facts of the design."""

WARM_UP_STEPS = 2
"""Steps that are not timed after a build or a reset. Shaders are compiled then, and robosuite shows the images of the
reset once more after the first step."""

LEAST_LIKENESS = 0.5
"""Least correlation of horizontal neighbors in an image: 0.95 and 0.97 in robosuite's, 0.04 in uninitialized memory."""

Images = Mapping[str, np.ndarray]
"""Images of one step by name: (256, 256, 3) colors, or (256, 256, 1) depth."""


class PeerEnvironment(Protocol):
    """What a peer's script provides."""

    def make(self, *, everything: bool) -> None:
        """Build the environment, with depth and instance masks if everything is asked for."""

    def reset(self) -> Images:
        """Go to a new layout and return its images."""

    def step(self, draw: np.random.Generator) -> Images:
        """Take one control step with a small random action and return its images."""

    def versions(self) -> dict[str, str]:
        """Return the versions of the packages that decide about speed."""


class _Session:
    """One environment and the requests that it answers."""

    def __init__(self, environment: PeerEnvironment) -> None:
        self._environment = environment
        self._draw = np.random.default_rng(0)

    def answer(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Do what a request asks for.

        Raises:
            KeyError: If the request is none of the three.
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
        ValueError: If an image has another size than was asked for.
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
    # The packages of peers talk on standard output; their words go to standard error and the pipe stays clean.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    session = _Session(environment)
    for line in sys.stdin:
        answers.write(json.dumps(session.answer(json.loads(line))) + "\n")
        answers.flush()
