"""From a consultation to its sheet: the scene, the action in it, and the words beside it."""

from __future__ import annotations

import numpy as np
from PIL import Image

from betterbench.evaluation.preflight.check import PreflightCheck
from betterbench.evaluation.preflight.sheet import Sheet, draw_action, draw_sheet
from betterbench.interface.actions import ActionSpace, action_space
from betterbench.scenes import Renderer, Scene
from betterbench.scenes.cameras import camera_matrices
from betterbench.scenes.stage import quality_preset

_VIEW = 640
_CAMERA = "front_official"
"""Stands where ``front`` does and sees more: at reset the hand is above what ``front`` shows."""


def draw_preflight(found: PreflightCheck) -> Image.Image:
    """Return a sheet with what the policy was shown and what it does about it.

    Args:
        found: What came of a consultation.

    Raises:
        MissingDependencyError: If no off-screen OpenGL works here.
    """
    task, condition = found.trial.resolve()
    space, quality = action_space(found.info.action_space), quality_preset(found.quality)
    scene = Scene(task, condition, seed=found.trial.seed, action_space=space, quality=quality)
    start = np.array(scene.reset().ee_pose.position)
    with Renderer(scene.model, width=_VIEW, height=_VIEW, quality=scene.quality) as renderer:
        view = renderer.render(scene.data, _CAMERA)
    if view.rgb is None:
        raise AssertionError("colors were asked for")
    camera = camera_matrices(scene.model, scene.data, _CAMERA, width=_VIEW, height=_VIEW)
    aim = _aim(found.actions[0], scene)
    path = [start]
    for action in found.actions:
        scene.step(action)
        path.append(np.array(scene.state().ee_pose.position))
    pixels, _ = camera.project(np.array([aim, *path]))
    turning, gripper = _turning(found.actions[0], space), _gripper_words(found.actions[0])
    image = draw_action(view.rgb, pixels[1:], pixels[0], f"{turning}; {gripper}")
    out = sum(not np.array_equal(space.clip(a), a) for a in found.actions)
    moved = 100.0 * (path[-1] - start)
    facts = [
        ("answer", f"{_counted(len(found.actions))} of {space.dim} numbers, {space.name}"),
        ("first action", _listed(found.actions[0], space.components)),
        ("moves", f"{_listed(100.0 * (aim - start), ('x', 'y', 'z'), digits=1)} cm"),
        ("turns", turning),
        ("gripper", gripper),
        ("whole answer", f"ends {_listed(moved, ('x', 'y', 'z'), digits=1)} cm from here"),
        ("out of range", f"{out} of {_counted(len(found.actions))}, clipped" if out else "nothing"),
        ("axes", "x away from the robot (toward this camera), y to its left (right in the image), z up"),
    ]
    return draw_sheet(
        Sheet(
            title=found.policy,
            trial=f"{found.trial}, at reset",
            prompt=found.prompt,
            shown=found.shown,
            blind=_BLIND if found.info.needs_images else "No images: this policy never looks at one.",
            state=tuple((key, numbers_text(values)) for key, values in found.state),
            facts=tuple(facts),
            latency=(
                f"One request takes {1000 * found.p50_s:.1f} ms (median of {len(found.latencies_s)}, longest "
                f"{1000 * found.max_s:.1f} ms; the first took {1000 * found.first_s:.0f} ms). A control step is "
                f"{1000 / scene.control_rate_hz:.0f} ms."
            ),
        ),
        image,
    )


_BLIND = "No images: the run renders none."


def _aim(action: np.ndarray, scene: Scene) -> np.ndarray:
    """Return where the first action leads the end effector, (3,) in the base frame [m]."""
    space, pose = scene.action_space, scene.state().ee_pose
    applied = space.clip(action)[:3]
    if space.name.startswith("ee_delta"):
        aim: np.ndarray = np.array(pose.position) + applied * np.array(space.scale[:3])
        return aim
    if space.name == "ee_pose":
        return applied
    # The way of joint actions is what the controller makes of them, which is tried and taken back.
    scene.step(action)
    aim = np.array(scene.state().commanded_pose.position)
    scene.reset()
    return aim


def _turning(action: np.ndarray, space: ActionSpace) -> str:
    """Say how an action turns the hand."""
    if space.name.startswith("ee_delta"):
        vector = space.clip(action)[3:6] * np.array(space.scale[3:6])
    elif space.name == "ee_pose":
        return f"to the quaternion {numbers_text(action[3:7])}"
    else:
        return "joint by joint"
    degrees = float(np.degrees(np.linalg.norm(vector)))
    if degrees < 0.05:
        return "no turn"
    axis = vector / np.linalg.norm(vector)
    return f"turn by {degrees:.1f} degrees about ({numbers_text(axis, digits=2)})"


def _gripper_words(action: np.ndarray) -> str:
    value = float(action[-1])
    return "gripper closes" if value > 0.0 else "gripper opens" if value < 0.0 else "gripper keeps its width"


def _counted(actions: int) -> str:
    return f"{actions} action" + "s" * (actions != 1)


def _listed(values: np.ndarray, names: tuple[str, ...], *, digits: int = 3) -> str:
    return ", ".join(f"{name} {_signed(value, digits)}" for name, value in zip(names, values.tolist(), strict=True))


def numbers_text(values: np.ndarray, *, digits: int = 3) -> str:
    """Return numbers as people read them: counts as they are, all others with their sign."""
    if values.dtype.kind in "iu":
        return ", ".join(str(value) for value in values.tolist())
    return ", ".join(_signed(value, digits) for value in values.tolist())


def _signed(value: float, digits: int) -> str:
    """Return a number with its sign; what rounds to zero has none to show."""
    return f"{round(value, digits) + 0.0:+.{digits}f}"
