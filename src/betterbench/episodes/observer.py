"""Observations of a scene for a policy."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from betterbench.interface import Observation, ObservationSpec
from betterbench.interface.state import WorldState
from betterbench.sim.scenes import Images, Renderer, Scene
from betterbench.sim.worlds import ForeignScene

_KEPT_RENDERERS = 4

Views = Mapping[str, Images]
"""Images by camera."""


def observation_of(
    state: WorldState,
    instruction: str,
    images: Mapping[str, np.ndarray],
    *,
    depth: Mapping[str, np.ndarray] | None = None,
    masks: Mapping[str, np.ndarray] | None = None,
) -> Observation:
    """Return the observation of a state, whether it is simulated now or read from a record."""
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
    """Maker of observations; keeps the renderers of the last models, because making one takes tens of milliseconds."""

    def __init__(self, spec: ObservationSpec, *, renderers: int = _KEPT_RENDERERS) -> None:
        """Prepare; ``renderers`` is the maximum number of kept renderers, one per model."""
        self.spec = spec
        self._kept = max(1, renderers)
        self._names = tuple(c.name for c in spec.cameras)
        self._wanted = tuple((c.name, c.width, c.height) for c in spec.cameras)
        self._renderers: OrderedDict[str, Renderer] = OrderedDict()

    def look(self, scene: Scene | ForeignScene) -> Views:
        """Return the images of the current state, by camera; MissingDependencyError without off-screen OpenGL."""
        if not self.spec.cameras:
            return {}
        if isinstance(scene, ForeignScene):
            depth = scene.depth()
            return {name: Images(image, depth.get(name), None) for name, image in scene.images().items()}
        images = self._renderer(scene).render_views(
            scene.data, self._wanted, depth=self.spec.depth, masks=self.spec.masks
        )
        return dict(zip(self._names, images, strict=True))

    def observe(self, scene: Scene | ForeignScene, state: WorldState, *, views: Views | None = None) -> Observation:
        """Return the observation of a state; ``views`` are its images, if :meth:`look` has rendered them already."""
        if views is None:
            views = self.look(scene)
        seen = observation_of(
            state,
            scene.condition.instruction.text,
            {name: view.rgb for name, view in views.items() if view.rgb is not None},
            depth={name: view.depth for name, view in views.items() if view.depth is not None},
            masks={name: view.masks for name, view in views.items() if view.masks is not None},
        )
        if isinstance(scene, ForeignScene):
            native = scene.native()
            return replace(seen, native=native, ee_position=native["ee_position"])
        return seen

    def close(self) -> None:
        """Free all renderers."""
        while self._renderers:
            self._renderers.popitem()[1].close()

    def _renderer(self, scene: Scene) -> Renderer:
        key = scene.compiled.content_hash
        if key in self._renderers:
            self._renderers.move_to_end(key)
            return self._renderers[key]
        while len(self._renderers) >= self._kept:
            self._renderers.popitem(last=False)[1].close()
        largest = max(self.spec.cameras, key=lambda c: c.width * c.height)
        renderer = Renderer(scene.model, width=largest.width, height=largest.height, quality=scene.quality)
        self._renderers[key] = renderer
        return renderer
