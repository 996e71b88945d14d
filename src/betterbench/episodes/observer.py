"""Creation of a policy's observations from the state of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from betterbench.interface import Observation, ObservationSpec
from betterbench.interface.state import WorldState
from betterbench.sim.scenes.rendering import Images, Renderers
from betterbench.sim.worlds import TrialScene

_KEPT_RENDERERS = 4

Views = Mapping[str, Images]
"""Images by camera name."""


def observation_of(
    state: WorldState,
    instruction: str,
    images: Mapping[str, np.ndarray],
    *,
    depth: Mapping[str, np.ndarray] | None = None,
    masks: Mapping[str, np.ndarray] | None = None,
) -> Observation:
    """Create an observation from a simulated or recorded state and its images."""
    return Observation(
        instruction=instruction,
        step=state.step,
        images=images,
        joint_positions=np.array(state.joint_positions),
        joint_velocities=np.array(state.joint_velocities),
        ee_position=np.array(state.ee_pose.position),
        ee_quaternion=np.array(state.ee_pose.quaternion),
        gripper_width=state.finger_width_m,
        depth=depth or {},
        masks=masks or {},
    )


class Observer:
    """Creator of observations, which renders images and combines them with the robot state.

    Renderers are cached by model, because creating a renderer takes tens of milliseconds.
    """

    def __init__(self, spec: ObservationSpec, *, renderers: int = _KEPT_RENDERERS) -> None:
        """Create an observer that caches up to ``renderers`` renderers, one per model."""
        self.spec = spec
        self._renderers = Renderers(renderers)

    def look(self, scene: TrialScene) -> Views:
        """Render the current state, and return the images by camera name.

        Raises MissingDependencyError if off-screen OpenGL does not work.
        """
        return scene.views(self.spec, self._renderers) if self.spec.cameras else {}

    def observe(self, scene: TrialScene, state: WorldState, *, views: Views | None = None) -> Observation:
        """Return the observation of a scene in a state.

        If ``views`` is None, render the images. Otherwise, it must contain the images returned by :meth:`look`.
        """
        if views is None:
            views = self.look(scene)
        seen = observation_of(
            state,
            scene.condition.instruction.text,
            {name: view.rgb for name, view in views.items() if view.rgb is not None},
            depth={name: view.depth for name, view in views.items() if view.depth is not None},
            masks={name: view.masks for name, view in views.items() if view.masks is not None},
        )
        native = scene.native()
        return replace(seen, native=native, ee_position=native["ee_position"]) if native else seen

    def close(self) -> None:
        """Close all renderers."""
        self._renderers.close()
