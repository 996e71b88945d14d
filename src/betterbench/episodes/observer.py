"""Creation of a policy's observations from the state of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from betterbench.errors import InvalidInputError, place_of
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


def _require_images(views: object, spec: ObservationSpec, scene: TrialScene) -> None:
    """Check that there is one image of each camera. Wrong images are a mistake of the world, not of the policy."""
    for camera in spec.cameras:
        shape = (camera.height, camera.width, 3)
        problem = _problem_of(views, camera.name, shape)
        if problem:
            name = camera.name
            cure = f"Return a dict with a value Images(rgb, None, None) for {name!r}, where rgb has shape {shape} and "
            cure += "dtype uint8"
            if not views:
                without = {"default": "state_only", "state_only": "state_only"}
                cure += f", or set observations of the world to {without} for policies without images"
            raise InvalidInputError(place_of(scene, "views"), problem, cure)


def _problem_of(views: object, name: str, shape: tuple[int, ...]) -> str | None:
    """Return the difference of a camera's image from the expected form, or None if there is none."""
    if not isinstance(views, Mapping):
        return f"it returned {views!r:.60}"
    if name not in views:
        found = ", ".join(map(repr, views))
        return f"it returned no image of camera {name!r}" + (f", but of {found:.120}" if found else "")
    view = views[name]
    if not isinstance(view, Images):
        return f"its value for {name!r} is a {type(view).__name__}"
    rgb: object = view.rgb
    if not isinstance(rgb, np.ndarray):
        return f"its image for {name!r} has the rgb {rgb!r:.60}"
    if rgb.shape != shape:
        return f"its image for {name!r} has shape {rgb.shape}"
    return None if rgb.dtype == np.uint8 else f"its image for {name!r} has dtype {rgb.dtype}"


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

        Raises:
            InvalidInputError: If the images of the scene have another form than the observation preset.
            MissingDependencyError: If off-screen OpenGL does not work.
        """
        if not self.spec.cameras:
            return {}
        views = scene.views(self.spec, self._renderers)
        _require_images(views, self.spec, scene)
        return views

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
