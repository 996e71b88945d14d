"""Steps robosuite's PickPlace on request; :mod:`peer` runs this file with the Python of the peer's own environment.

One JSON object per line comes in on standard input, one goes out on standard output:

====================================================  =============================================================
request                                               answer
====================================================  =============================================================
``{"do": "make", "all": false}``                      ``{"seconds": …, "robosuite": …, "mujoco": …, "numpy": …}``
``{"do": "step", "all": false, "count": 3}``          ``{"seconds": …}`` for all three control steps together
``{"do": "reset", "all": false}``                     ``{"seconds": …}``
====================================================  =============================================================

``all`` asks for depth and instance masks besides colors. The clock stands here, beside the work, so that the pipe is
not part of what is measured. The task is what its authors ship: a Panda with their default composite controller at
20 Hz, the cameras ``frontview`` and ``robot0_eye_in_hand`` at 256 x 256, and small random actions.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

import mujoco
import numpy as np
import robosuite

CAMERAS = ["frontview", "robot0_eye_in_hand"]
SIZE = 256
CONTROL_RATE_HZ = 20
ACTION_SIZE = 0.1
"""Largest component of an action, of a range of 1: the arm stays near its start, as in the facts of the design."""

WARM_UP_STEPS = 2
"""Steps after which shaders are compiled and buffers exist."""


class Peer:
    """The environments that were asked for, by whether they give depth and masks."""

    def __init__(self) -> None:
        self._environments: dict[bool, Any] = {}
        self._draw = np.random.default_rng(0)

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """Do what a request asks for and return the seconds it took.

        Args:
            request: One line of standard input.

        Raises:
            KeyError: If the request is none of the three.
        """
        everything = bool(request["all"])
        began = time.perf_counter()
        work = {"make": self._make, "step": self._step, "reset": self._reset}[request["do"]]
        work(everything, int(request.get("count", 1)))
        seconds = time.perf_counter() - began
        versions = {"robosuite": robosuite.__version__, "mujoco": mujoco.__version__, "numpy": np.__version__}
        return {"seconds": seconds, **(versions if request["do"] == "make" else {})}

    def _make(self, everything: bool, _count: int) -> None:
        modalities = {"camera_depths": True, "camera_segmentations": "instance"} if everything else {}
        controller = robosuite.load_composite_controller_config(controller="BASIC")
        self._environments[everything] = robosuite.make(
            "PickPlace",
            robots="Panda",
            controller_configs=controller,
            has_renderer=False,
            has_offscreen_renderer=True,
            use_camera_obs=True,
            camera_names=CAMERAS,
            camera_heights=SIZE,
            camera_widths=SIZE,
            control_freq=CONTROL_RATE_HZ,
            ignore_done=True,
            **modalities,
        )
        self._environments[everything].reset()
        self._step(everything, WARM_UP_STEPS)

    def _step(self, everything: bool, count: int) -> None:
        environment = self._environments[everything]
        for _ in range(count):
            observation = environment.step(self._draw.uniform(-ACTION_SIZE, ACTION_SIZE, environment.action_dim))[0]
            if observation["frontview_image"].shape != (SIZE, SIZE, 3):
                raise ValueError(f"robosuite answers images of shape {observation['frontview_image'].shape}")

    def _reset(self, everything: bool, _count: int) -> None:
        self._environments[everything].reset()


def main() -> None:
    """Answer requests until standard input ends."""
    # robosuite talks on standard output; its words go to standard error and the pipe stays clean.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    peer = Peer()
    for line in sys.stdin:
        answers.write(json.dumps(peer.answer(json.loads(line))) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
