"""Content of a preflight sheet: the inputs of the policy, and the motion that its first reply commands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from betterbench.evaluation.preflight.check import PreflightCheck, ShownImage
from betterbench.interface.actions import OPENING_SPACES, ActionSpace, action_space
from betterbench.sim.scenes import Renderer, Scene
from betterbench.sim.scenes.cameras import camera_matrices
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks.interventions import resolve_condition

_VIEW = 640
_CAMERA = "front_official"
"""Camera at the position of ``front`` with a wider field of view, so that the gripper is visible after the reset."""


@dataclass(frozen=True, slots=True, eq=False)
class PreflightView:
    """Content of a preflight sheet, which :mod:`betterbench.report.pages.preflight_sheet` draws.

    Attributes:
        title: Title of the sheet.
        trial: Description of the trial.
        prompt: Instruction as it is sent to the policy.
        shown: Images that are sent to the policy. Empty for a policy without images.
        no_images: Text that is shown instead of images if there are none.
        state: State inputs of the policy, as pairs of key and formatted values.
        facts: Facts about the policy's first reply, as pairs of name and value.
        latency: Sentence about the latency.
        scene: Image of the scene after the reset, (height, width, 3) uint8.
        path: Path of the end effector in the image ``scene`` when the complete reply is executed, (n, 2) [pixels].
        aim: Position to which the first action moves the end effector, in the image ``scene``, (2,) [pixels].
        turn: Text that describes the rotation and the gripper command of the first action.
    """

    title: str
    trial: str
    prompt: str
    shown: tuple[ShownImage, ...]
    no_images: str
    state: tuple[tuple[str, str], ...]
    facts: tuple[tuple[str, str], ...]
    latency: str
    scene: np.ndarray
    path: np.ndarray
    aim: np.ndarray
    turn: str


def preflight_view(found: PreflightCheck) -> PreflightView:
    """Return the content of the sheet that shows the result of a preflight check.

    Raises MissingDependencyError if off-screen OpenGL does not work on this machine.
    """
    condition = resolve_condition(found.trial.task, found.trial.condition)
    space, quality = action_space(found.info.action_space), quality_preset(found.quality)
    scene = Scene(
        condition.task,
        condition.condition,
        seed=found.trial.seed,
        action_space=space,
        quality=quality,
        robot_name=found.robot,
    )
    start = np.array(scene.reset().ee_pose.position)
    with Renderer(scene.model, width=_VIEW, height=_VIEW, quality=scene.quality) as renderer:
        view = renderer.render(scene.data, _CAMERA)
    if view.rgb is None:
        raise AssertionError("unreachable: colors were requested")
    camera = camera_matrices(scene.model, scene.data, _CAMERA, width=_VIEW, height=_VIEW)
    aim = _aim(found.actions[0], scene)
    path = [start]
    for action in found.actions:
        scene.step(action)
        path.append(np.array(scene.state().ee_pose.position))
    pixels, _ = camera.project(np.array([aim, *path]))
    return PreflightView(
        title=found.policy,
        trial=f"{found.trial}, at reset",
        prompt=found.prompt,
        shown=found.shown,
        no_images="No images: "
        + ("this run does not render them." if found.info.needs_images else "this policy does not use them."),
        state=tuple((key, numbers_text(values)) for key, values in found.state),
        facts=_facts(found, aim - start, path[-1] - start),
        latency=(
            f"One request takes {1000 * found.p50_s:.1f} ms (median of {len(found.latencies_s)}, longest "
            f"{1000 * found.max_s:.1f} ms; the first took {1000 * found.first_s:.0f} ms). A control step is "
            f"{1000 / scene.control_rate_hz:.0f} ms."
        ),
        scene=view.rgb,
        path=pixels[1:],
        aim=pixels[0],
        turn=f"{_turn_text(found.actions[0], space)}; {_gripper_text(found.actions[0], space)}",
    )


def _facts(found: PreflightCheck, first: np.ndarray, whole: np.ndarray) -> tuple[tuple[str, str], ...]:
    """Return facts about a policy's reply, as pairs of name and value.

    ``first`` and ``whole`` are the displacements (3,) of the end effector by the first action and the whole reply [m].
    """
    space, action, out = action_space(found.info.action_space), found.actions[0], found.clipped
    ends = (("whole answer", f"ends {_listed(100.0 * whole, ('x', 'y', 'z'), digits=1)} cm from the initial position"),)
    return (
        ("answer", f"{_counted(len(found.actions))} of {space.dim} numbers, {space.name}"),
        ("first action", _listed(action, space.components)),
        ("moves", f"{_listed(100.0 * first, ('x', 'y', 'z'), digits=1)} cm"),
        ("turns", _turn_text(action, space)),
        ("gripper", _gripper_text(action, space)),
        *(ends if len(found.actions) > 1 else ()),
        ("out of range", f"{out} of {_counted(len(found.actions))}, clipped" if out else "nothing"),
        ("axes", "x away from the robot (toward this camera), y to its left (right in the image), z up"),
    )


def _aim(action: np.ndarray, scene: Scene) -> np.ndarray:
    """Return the position (3,) that an action commands for the end effector, in the base frame [m]."""
    space, pose = scene.action_space, scene.state().ee_pose
    applied = space.clip(action)[:3]
    if space.name.startswith("ee_delta"):
        aim: np.ndarray = np.array(pose.position) + applied * np.array(space.scale[:3])
        return aim
    if space.name == "ee_pose":
        return applied
    # The effect of a joint action depends on the controller, so the action is executed in the scene.
    scene.step(action)
    aim = np.array(scene.state().commanded_pose.position)
    scene.reset()
    return aim


def _turn_text(action: np.ndarray, space: ActionSpace) -> str:
    """Describe the rotation that an action commands."""
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


def _gripper_text(action: np.ndarray, space: ActionSpace) -> str:
    value = float(action[-1])
    if space.name in OPENING_SPACES:
        return f"gripper to {value / space.high[-1]:.0%} of its opening"
    return "gripper closes" if value > 0.0 else "gripper opens" if value < 0.0 else "gripper keeps its width"


def _counted(actions: int) -> str:
    return f"{actions} action" + "s" * (actions != 1)


def _listed(values: np.ndarray, names: tuple[str, ...], *, digits: int = 3) -> str:
    return ", ".join(f"{name} {_signed(value, digits)}" for name, value in zip(names, values.tolist(), strict=True))


def numbers_text(values: np.ndarray, *, digits: int = 3) -> str:
    """Format numbers as text. Integers are shown as they are, all other numbers with a sign."""
    if values.dtype.kind in "iu":
        return ", ".join(str(value) for value in values.tolist())
    return ", ".join(_signed(value, digits) for value in values.tolist())


def _signed(value: float, digits: int) -> str:
    """Format a number with its sign. Zero is shown as +0."""
    return f"{round(value, digits) + 0.0:+.{digits}f}"
