"""robosuite's PickPlace as its authors ship it; :mod:`peer` runs this file with the Python of the peer's environment.

A Panda with the default composite controller at 20 Hz, the cameras ``frontview`` and ``robot0_eye_in_hand`` at
256 x 256, and small random actions. Requests and answers are those of :mod:`peer_loop`.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import robosuite

from peer_loop import ACTION_SIZE, CONTROL_RATE_HZ, SIZE, Images, serve

CAMERAS = ("frontview", "robot0_eye_in_hand")

OWN_RENDERER = "mujoco"
"""With this option a reset frees the graphics resources of the simulation that it replaces. With the default, Python's
garbage collector frees them at an arbitrary time, together with those of the simulation in use."""


class PickPlace:
    """The environment and the names of its images."""

    def __init__(self) -> None:
        self._environment: Any = None
        self._names: tuple[str, ...] = ()

    def make(self, *, everything: bool) -> None:
        """Build the environment."""
        kinds = ("image", "depth") if everything else ("image",)
        self._names = tuple(f"{camera}_{kind}" for camera in CAMERAS for kind in kinds)
        modalities = {"camera_depths": True, "camera_segmentations": "instance"} if everything else {}
        self._environment = robosuite.make(
            "PickPlace",
            robots="Panda",
            controller_configs=robosuite.load_composite_controller_config(controller="BASIC"),
            has_renderer=False,
            has_offscreen_renderer=True,
            use_camera_obs=True,
            camera_names=list(CAMERAS),
            camera_heights=SIZE,
            camera_widths=SIZE,
            control_freq=CONTROL_RATE_HZ,
            ignore_done=True,
            renderer=OWN_RENDERER,
            **modalities,
        )

    def reset(self) -> Images:
        """Go to a new random layout."""
        return self._images(self._environment.reset())

    def step(self, draw: np.random.Generator) -> Images:
        """Take one control step."""
        action = draw.uniform(-ACTION_SIZE, ACTION_SIZE, self._environment.action_dim)
        return self._images(self._environment.step(action)[0])

    def versions(self) -> dict[str, str]:
        """Return the versions of the packages that run."""
        return {"robosuite": robosuite.__version__, "mujoco": mujoco.__version__, "numpy": np.__version__}

    def _images(self, observation: dict[str, np.ndarray]) -> Images:
        return {name: observation[name] for name in self._names}


if __name__ == "__main__":
    serve(PickPlace())
