"""Main loop of a simulator process, which answers requests until the run closes the connection.

Like :mod:`betterbench.jobs.frames`, this module is imported in an environment without betterbench.
"""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import traceback
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from betterbench.jobs import frames
from betterbench.jobs.frames import FrameContent

_LONGEST_PROBLEM = 2000


class Simulator(Protocol):
    """Interface of a simulator with one environment, as the main loop of the simulator process requires it."""

    def suite(self, name: str) -> dict[str, Any]:
        """Describe a suite: "versions", and "tasks" as a list of dicts with "name", "instruction" and "states"."""

    def premises(self, request: Mapping[str, Any]) -> FrameContent:
        """Check the premises of a task in every initial state, after the settling steps.

        A premise is a relation between objects that the instruction assumes to hold.

        Return the names of the premises, and whether each premise holds in each state.
        """

    def start(self, request: Mapping[str, Any]) -> FrameContent:
        """Begin an episode and execute the settling steps.

        Return the constant properties of the scene and the first row of numbers.
        """

    def step(self, action: np.ndarray, *, look: bool) -> FrameContent:
        """Execute one control step. Return the row of numbers after the step, with images if ``look`` is True."""

    def draw(self, request: Mapping[str, Any], qpos: np.ndarray) -> FrameContent:
        """Render n states of a task's scene with the front camera, as an array "images" (n, size, size, 3)."""


def answer_requests(simulator: Simulator, descriptor: int) -> None:
    """Answer requests from a socket until the socket is closed.

    Output that the simulator prints goes to standard error. Only frames are sent over the socket.
    """
    sys.stdout.flush()
    os.dup2(2, 1)

    def answer(request: dict[str, Any], arrays: dict[str, np.ndarray]) -> FrameContent:
        try:
            return _answered(simulator, request, arrays)
        except Exception as problem:  # noqa: BLE001 - whatever a simulator raises costs its trial alone
            traceback.print_exc()
            return {"problem": _told(problem)[:_LONGEST_PROBLEM]}, {}

    link = socket.socket(fileno=descriptor)
    with link, contextlib.suppress(frames.FrameError):
        frames.answer_requests(link, answer)


def _told(problem: BaseException) -> str:
    """Describe an error in one line by its original cause. If libraries wrapped the cause, add the last error."""
    first = problem
    while first.__cause__ is not None:
        first = first.__cause__
    told = [" ".join(f"{type(error).__name__}: {error}".split()) for error in (first, problem)]
    return told[0] if first is problem else f"{told[0]} (reported as {told[1]})"


def _answered(simulator: Simulator, request: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> FrameContent:
    if request["do"] == "suite":
        return simulator.suite(request["suite"]), {}
    if request["do"] == "premises":
        return simulator.premises(request)
    if request["do"] == "draw":
        return simulator.draw(request, np.array(arrays["qpos"]))
    if request["do"] == "start":
        return simulator.start(request)
    return simulator.step(np.array(arrays["action"]), look=bool(request["look"]))
