"""From a scene to what a policy is allowed to see of it."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np

from betterbench.interface import Observation, ObservationSpec
from betterbench.scenes import Renderer, Scene
from betterbench.state import WorldState

_KEPT_RENDERERS = 4


class Observer:
    """Makes observations and keeps the renderers of the last few models: making one costs tens of milliseconds."""

    def __init__(self, spec: ObservationSpec) -> None:
        """Prepare for one observation preset."""
        self.spec = spec
        self._renderers: OrderedDict[str, Renderer] = OrderedDict()

    def observe(self, scene: Scene, state: WorldState) -> Observation:
        """Return what a policy sees now.

        Args:
            scene: The scene.
            state: Its state now.

        Raises:
            MissingDependencyError: If pictures are asked for and no off-screen OpenGL works here.
        """
        images: dict[str, np.ndarray] = {}
        depth: dict[str, np.ndarray] = {}
        masks: dict[str, np.ndarray] = {}
        if self.spec.cameras:
            renderer = self._renderer(scene)
            for camera in self.spec.cameras:
                view = renderer.render(
                    scene.data,
                    camera.name,
                    depth=self.spec.depth,
                    masks=self.spec.masks,
                    width=camera.width,
                    height=camera.height,
                )
                if view.rgb is not None:
                    images[camera.name] = view.rgb
                if view.depth is not None:
                    depth[camera.name] = view.depth
                if view.masks is not None:
                    masks[camera.name] = view.masks
        return Observation(
            instruction=scene.condition.instruction.text,
            step=state.step,
            images=images,
            joint_positions=np.array(state.joint_positions),
            joint_velocities=np.array(state.joint_velocities),
            ee_position=np.array(state.ee_pose.position),
            ee_quaternion=np.array(state.ee_pose.quaternion),
            gripper_width=state.finger_width_m,
            depth=depth,
            masks=masks,
        )

    def close(self) -> None:
        """Free all renderers."""
        while self._renderers:
            self._renderers.popitem()[1].close()

    def _renderer(self, scene: Scene) -> Renderer:
        key = scene.compiled.content_hash
        if key in self._renderers:
            self._renderers.move_to_end(key)
            return self._renderers[key]
        while len(self._renderers) >= _KEPT_RENDERERS:
            self._renderers.popitem(last=False)[1].close()
        largest = max(self.spec.cameras, key=lambda c: c.width * c.height)
        renderer = Renderer(scene.model, width=largest.width, height=largest.height, quality=scene.quality)
        self._renderers[key] = renderer
        return renderer
