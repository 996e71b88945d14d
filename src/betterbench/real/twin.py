"""Simulated twin of a trial's scene, which provides the object positions and the image of the front camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from betterbench.interface.observation import CameraSpec, ObservationSpec
from betterbench.real.plan import PlannedTrial, RealPlan
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.cameras import camera_matrices
from betterbench.sim.scenes.rendering import Renderers
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks.interventions.resolve import resolve_condition

FRONT = "front"


@dataclass(frozen=True, slots=True)
class SetupStep:
    """Instruction to the operator for setting up one object.

    Attributes:
        name: Name of the object.
        title: Displayed name ("red block").
        place: "table", the name of the container with the object, or "absent".
        position_m: Point on the table below the object's center, in the arm's base frame (x ahead, y left) [m]; None if
            the object is absent.
        text: Instruction as a sentence.
    """

    name: str
    title: str
    place: str
    position_m: tuple[float, float] | None
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class TwinView:
    """Image of the front camera in the simulated twin.

    Attributes:
        image: (height, width, 3) uint8 RGB image.
        masks: (height, width) bool mask of the visible part of each object, by object name.
        pixels_per_m: (2, 2) displacement in the image [pixels] per meter along x and y of the table, by object name.
        cloth: Color of the tablecloth; empty if there is none.
    """

    image: np.ndarray
    masks: dict[str, np.ndarray]
    pixels_per_m: dict[str, np.ndarray]
    cloth: str = ""


class Twin:
    """Builds the simulated scenes of trials and their images. Only the rendering thread may use it."""

    def __init__(self, plan: RealPlan, *, size: tuple[int, int], quality: str = "standard") -> None:
        """Store the plan and the size (width, height) of the images [pixels]."""
        self._plan, self.size, self._quality = plan, size, quality_preset(quality)
        self._renderers = Renderers(1)
        self._key: tuple[str, int] | None = None
        self._scene: Scene | None = None
        self._view: TwinView | None = None

    def scene(self, trial: PlannedTrial) -> Scene:
        """Build the simulated scene of a trial in its initial state, or return it if it is already built."""
        key = (trial.condition, trial.scene_seed)
        if self._scene is None or self._key != key:
            setting = resolve_condition(self._plan.task, trial.condition)
            self._scene = Scene(
                setting.task,
                setting.condition,
                seed=trial.scene_seed,
                action_space=self._plan.action_space,
                quality=self._quality,
                steady_views=True,
            )
            self._key, self._view = key, None
        return self._scene

    def cloth(self, trial: PlannedTrial) -> str:
        """Return the color of the tablecloth in a trial; empty if there is none."""
        return resolve_condition(self._plan.task, trial.condition).condition.cloth or ""

    def steps(self, trial: PlannedTrial) -> tuple[SetupStep, ...]:
        """Return the setup instruction for each object of the task. Absent objects come last."""
        scene = self.scene(trial)
        condition, state = scene.condition, scene.reset(check_premise=False)
        known = {o.name: o for c in scene.task.training for o in c.objects}
        known |= {o.name: o for o in condition.objects}
        found, absent = [], []
        for name, spec in known.items():
            title = spec.kind
            if name not in {o.name for o in condition.objects}:
                absent.append(SetupStep(name, title, "absent", None, f"{title}: take it away"))
                continue
            x, y, _ = state.positions[scene.info.index(name)]
            at = (round(float(x), 3), round(float(y), 3))
            if name in condition.preplaced:
                container = condition.preplaced[name].target
                text = f"{title}: into the {known[container].kind}"
                found.append(SetupStep(name, title, container, at, text))
            else:
                side = f"{100 * abs(y):.1f} cm to the arm's {'left' if y >= 0.0 else 'right'}"
                text = f"{title}: {100 * x:.1f} cm ahead of the base, {side}"
                found.append(SetupStep(name, title, "table", at, text))
        return (*found, *absent)

    def view(self, trial: PlannedTrial) -> TwinView:
        """Render the initial scene of a trial as the front camera sees it."""
        scene = self.scene(trial)
        if self._view is None:
            scene.reset(check_premise=False)
            looks = ObservationSpec("twin", (CameraSpec(FRONT, *self.size),), masks=True)
            images = scene.views(looks, self._renderers)[FRONT]
            if images.rgb is None or images.masks is None:
                raise AssertionError("both were requested")
            names = [placement.spec.name for placement in scene.placements]
            masks = {n: images.masks == b for n, b in zip(names, scene.compiled.bodies.tolist(), strict=True)}
            self._view = TwinView(images.rgb, masks, self._motions(scene), self.cloth(trial))
        return self._view

    def _motions(self, scene: Scene) -> dict[str, np.ndarray]:
        """Return the displacement of each object in the image per meter along x and y of the table [pixels/m]."""
        camera = camera_matrices(scene.model, scene.data, FRONT, width=self.size[0], height=self.size[1])
        state = scene.state()
        found = {}
        for placement in scene.placements:
            point = np.array(state.positions[scene.info.index(placement.spec.name)])
            near = point + 0.01 * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
            pixels, _ = camera.project(near)
            found[placement.spec.name] = ((pixels[1:] - pixels[0]) / 0.01).T
        return found

    def close(self) -> None:
        """Free the renderer."""
        self._renderers.close()
