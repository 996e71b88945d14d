"""Columns of a data set: the inputs and outputs of a policy preset, under the names that the trainer expects.

Every column is computed by the adapter of the policy preset, so a policy is trained on exactly the inputs that ``better
eval`` sends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from betterbench.errors import InvalidInputError
from betterbench.interface import CameraSpec, ObservationSpec, observation_spec
from betterbench.interface.actions import ROBOT_ACTION_SPACES, USUAL_ROBOT, action_space
from betterbench.policies.conventions.adapter import Adapter
from betterbench.policies.conventions.answers import AnswerPart, AnswerRule
from betterbench.policies.conventions.image_rule import EVERY_CAMERA, ImageRule
from betterbench.policies.conventions.modality import name_of
from betterbench.policies.conventions.presets import own_preset
from betterbench.policies.conventions.proprioception import StateRule
from betterbench.policies.conventions.rotation import ROTATION_SIZES
from betterbench.records import RunFolder
from betterbench.sim.robots import robot as robot_named
from betterbench.sim.robots import robot_of_space, robot_space

NumberType = Literal["float32", "float64", "int64"]

IMAGES, STATE, ACTION = "observation.images.", "observation.state", "action"

_OBSERVATIONS = ("default", "droid", "official")
"""Observation presets in order of preference. A layout uses the first preset that has all required cameras."""

_REPEATED = {"openpi_droid": {"exterior_image_2_left": "exterior_image_1_left"}}
"""Columns that are required by the configuration of a trainer, but not used by the policy.

Each is a copy of another column.

openpi's ``LeRobotDROIDDataConfig`` expects a second exterior image, which its policy does not use.
"""


@dataclass(frozen=True, slots=True)
class ImageColumn:
    """Image column of a data set: name, key of the image in the policy's request, camera, and image size [pixel]."""

    name: str
    key: tuple[str, ...]
    camera: str
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class VectorPart:
    """Components ``start`` to ``end`` of a vector column, with the key of this part in a policy's request or reply."""

    key: tuple[str, ...]
    start: int
    end: int

    @property
    def name(self) -> str:
        """Name of this part without its prefix, as in GR00T's modality.json."""
        return name_of(self.key).replace("/", "_")


@dataclass(frozen=True, slots=True)
class VectorColumn:
    """Column of vectors, with the names of their components."""

    name: str
    parts: tuple[VectorPart, ...]
    components: tuple[str, ...]
    dtype: NumberType = "float32"

    @property
    def size(self) -> int:
        """Number of components."""
        return len(self.components)


@dataclass(frozen=True, slots=True)
class DatasetLayout:
    """Columns of a data set.

    Attributes:
        adapter: Adapter that computes the columns.
        observation: Observation preset for evaluating the policy (``better eval --observation``).
        copies: Image columns that are copies of another column, as pairs (name of the copy, name of the original).
        robot: Name of the robot.
    """

    adapter: Adapter
    observation: ObservationSpec
    images: tuple[ImageColumn, ...]
    states: tuple[VectorColumn, ...]
    action: VectorColumn
    copies: Mapping[str, str] = field(default_factory=dict)
    robot: str = USUAL_ROBOT

    @property
    def cameras(self) -> tuple[CameraSpec, ...]:
        """Cameras to render."""
        shown = {column.camera for column in self.images}
        return tuple(camera for camera in self.observation.cameras if camera.name in shown)

    @property
    def all_images(self) -> dict[str, ImageColumn]:
        """All image columns by name, including copies of other columns."""
        by_name = {column.name: column for column in self.images}
        return by_name | {name: replace(by_name[other], name=name) for name, other in self.copies.items()}

    def to_json(self) -> dict[str, Any]:
        """Return the adapter and the content of each column as a JSON-serializable dict."""
        return {
            "adapter": self.adapter.to_json(),
            "observation": self.observation.to_json(),
            **({} if self.robot == USUAL_ROBOT else {"robot": self.robot}),
            "images": {c.name: {"key": list(c.key), "camera": c.camera} for c in self.all_images.values()},
            "vectors": {
                c.name: [{"key": list(p.key), "start": p.start, "end": p.end} for p in c.parts]
                for c in (*self.states, self.action)
            },
        }


def layout_of(name: str, observation: str | None = None, *, robot: str | None = None) -> DatasetLayout:
    """Return the columns that a policy preset defines.

    Args:
        name: Name of the policy preset.
        observation: Observation preset for evaluating the policy. The default is the first preset that has all required
            cameras.
        robot: Robot in the records. The default is a robot that supports the actions of the policy preset.

    Raises:
        UnknownNameError: If the policy preset does not exist, or the robot does not support its actions.
        InvalidInputError: If the actions can only be executed in another simulator, or the observation preset lacks a
            required camera.
    """
    adapter = own_preset(name)
    robot = robot or robot_of_space(adapter.answer.space).name
    robot_space(robot, adapter.answer.space)
    spec = _observation(adapter, observation)
    sizes = {camera.name: camera for camera in spec.cameras}
    images = []
    for rule in adapter.views:
        for camera in sizes if rule.camera == EVERY_CAMERA else (rule.camera,):
            key = rule.named(camera)
            width, height = _shown_size(rule, sizes[camera])
            images.append(ImageColumn(_image_name(adapter.name, key), key, camera, width, height))
    states, repeated = _states(adapter, len(robot_named(robot).arm_joints)), _REPEATED.get(adapter.name, {})
    return DatasetLayout(adapter, spec, tuple(images), states, _action(adapter), repeated, robot)


def robot_of_runs(runs: Sequence[RunFolder]) -> str:
    """Return the name of the robot in the given runs. Raises InvalidInputError if the runs have different robots."""
    names = sorted({str(run.plan.get("robot", USUAL_ROBOT)) for run in runs})
    if len(names) > 1:
        raise InvalidInputError(
            "runs", f"they have different robots: {', '.join(names)}", "Export the runs of each robot separately"
        )
    return names[0]


def _observation(adapter: Adapter, name: str | None) -> ObservationSpec:
    wanted = [camera for camera in adapter.cameras if camera != EVERY_CAMERA]
    for known in (name,) if name is not None else _OBSERVATIONS:
        spec = observation_spec(known)
        if spec.cameras and set(wanted) <= {camera.name for camera in spec.cameras}:
            return spec
    problem = f"{name or 'every observation preset'} lacks one of the cameras ({', '.join(wanted) or 'at least one'})"
    raise InvalidInputError(
        "--observation",
        f"{problem} that the preset {adapter.name} needs",
        "Leave out --observation, or use another preset",
    )


def _shown_size(rule: ImageRule, camera: CameraSpec) -> tuple[int, int]:
    """Return the width and height of an image in the policy's request."""
    turned = rule.turn in (90, 270)
    width, height = (camera.height, camera.width) if turned else (camera.width, camera.height)
    return rule.width or width, rule.height or height


def _is_openpi(name: str) -> bool:
    return name.startswith("openpi_")


def _image_name(adapter: str, key: tuple[str, ...]) -> str:
    """Return the name of an image column, as openpi or LeRobot would name it."""
    bare = name_of(key).removeprefix(IMAGES).rpartition("/")[2]
    return bare if _is_openpi(adapter) else IMAGES + bare


def _states(adapter: Adapter, joints: int) -> tuple[VectorColumn, ...]:
    """Return the state columns.

    There is one column for all parts of the state, or one column per part if the trainer requires this.
    """
    columns: list[VectorColumn] = []
    parts: list[VectorPart] = []
    names: list[str] = []
    for rule in adapter.states:
        components = _components(rule, joints)
        size = len(components)
        if adapter.name == "native" or _is_openpi(adapter.name):
            bare = rule.key[-1].rpartition("/")[2] if _is_openpi(adapter.name) else rule.key[-1].replace("/", ".")
            columns.append(VectorColumn(bare, (VectorPart(rule.key, 0, size),), components, rule.dtype))
        else:
            parts.append(VectorPart(rule.key, len(names), len(names) + size))
            names += components
    return (*columns, *((VectorColumn(STATE, tuple(parts), tuple(names)),) if parts else ()))


def _components(rule: StateRule, joints: int) -> tuple[str, ...]:
    """Return the names of a state's components, for a robot with the given number of arm joints."""
    sizes = [(part, columns.stop - columns.start) for part, columns in rule.columns(joints)]
    return tuple(name for part, size in sizes for name in _part_names(part, size))


def _part_names(part: str, size: int) -> tuple[str, ...]:
    """Return the names of the components in one part of a state.

    Components in motor units have the names of the motors.
    """
    if part in ROBOT_ACTION_SPACES:
        return ROBOT_ACTION_SPACES[part].components
    return (part,) if size == 1 else tuple(f"{part}.{i}" for i in range(size))


def _answer_names(answer: AnswerRule, part: AnswerPart) -> tuple[str, ...]:
    """Return the names of the components in one part of the policy's answer."""
    axes = {"axis_angle": ("rx", "ry", "rz"), "rpy": ("roll", "pitch", "yaw")}
    turns = axes.get(answer.rotation) or tuple(f"rotation.{i}" for i in range(ROTATION_SIZES[answer.rotation]))
    kind, _, axis = part.kind.partition("_")
    match kind:
        case "action":
            return action_space(answer.space).components
        case "translation":
            return (axis,) if axis else ("x", "y", "z")
        case "rotation":
            return (turns["xyz".index(axis)],) if axis else turns
        case "joints":
            return action_space(answer.space).components[:-1]
        case "unused":
            return tuple(f"unused.{i}" for i in range(part.size or 0))
    return (kind,)


def _action(adapter: Adapter) -> VectorColumn:
    """Return the action column, which contains the actions that the policy should return."""
    parts, names = [], list[str]()
    for key, size in adapter.answer.columns.items():
        parts.append(VectorPart(key, len(names), len(names) + size))
        for part in adapter.answer.parts:
            names += _answer_names(adapter.answer, part) if part.key == key else ()
    name = "actions" if _is_openpi(adapter.name) else ACTION
    return VectorColumn(name, tuple(parts), tuple(names), "float64" if adapter.name == "native" else "float32")
