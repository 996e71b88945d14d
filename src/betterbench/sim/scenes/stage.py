"""Stage: the empty base scene that all tasks share, and the quality presets of its images.

World frame: meters, z up, x away from the robot base, y left. The robot flange and the table top are both at ``z = 0``.
The robot stands on the table at the origin, over a pedestal, and the floor is at ``z = -0.75``.

Cameras of the base scene:

===================  =========================  ==========================================================
name                 position [m]               purpose
===================  =========================  ==========================================================
``front``            (1.45, 0, 0.95)            default view toward the robot; shows the workspace
``front_official``   (1.6, 0, 0.9)              the wider view of the official preset
``left_shoulder``    (-0.3, 0.9, 0.9)           over the robot's left shoulder
``right_shoulder``   (-0.3, -0.9, 0.9)          over the robot's right shoulder
``wrist``            on the gripper             added with the robot (:class:`RobotSpec`)
===================  =========================  ==========================================================

The physical part of the base scene (bodies, collision shapes, solver options) is always the same. A room changes only
the colors and the light, and a quality preset changes only the rendering.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import mujoco
import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.geometry import Vector
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.robots.spec import CameraMount
from betterbench.sim.scenes.rooms import ROOMS, Light, Room
from betterbench.sim.scenes.surfaces import SURFACES

FLOOR_HEIGHT_M = -0.75
"""Height of the floor in the world frame [m]. Desks are 0.72 to 0.76 m high (working heights of ISO 9241-5)."""

TABLE_X_M = (-0.20, 0.95)
"""Smallest and largest x coordinate of the table top [m]."""

TABLE_Y_M = (-0.6, 0.6)
"""Smallest and largest y coordinate of the table top [m]."""

TABLE_THICKNESS_M = 0.04
"""Thickness of the table top [m]."""

CAMERAS = ("front", "front_official", "left_shoulder", "right_shoulder")
"""Cameras of the base scene. The camera ``wrist`` is added with the robot."""

WRIST_CAMERA = "wrist"
"""Name of the camera on the gripper."""

FRONT_CAMERA = CameraMount((1.45, 0.0, 0.95), (0.49, 0.0, 0.095), (0.0, 0.0, 1.0), 27.5)
"""Front camera of the stage. A robot may replace it with its own front camera."""

KEY_LIGHT = "key"
"""Name of the only light that may cast a shadow."""

_PEDESTAL_X_M = (-0.23, 0.13)
_PEDESTAL_HALF_WIDTH_M = 0.16

_TEXTURE_SIZE = 512
_MAX_SAMPLES = 16
_MAX_SHADOW_MAP = 8192


@dataclass(frozen=True, slots=True)
class Quality:
    """Render preset of images. It is part of every record, because pixels differ between presets.

    Depth and masks do not depend on the preset, because they are always sampled at pixel centers.

    Attributes:
        shadow_map_size: Side length of the shadow map [texel], or 0 if there are no shadows.
        samples: Number of samples per pixel in the multisampled buffer, or 0 for no multisampling.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    name: str
    shadows: bool
    shadow_map_size: int
    samples: int

    def __post_init__(self) -> None:
        """Reject values that OpenGL does not support."""
        if not 0 <= self.samples <= _MAX_SAMPLES or self.samples == 1:
            raise InvalidInputError(
                "quality.samples",
                f"{self.samples} samples per pixel is not possible",
                f"Use 0, or a number from 2 to {_MAX_SAMPLES}",
            )
        if self.shadows and not 1 <= self.shadow_map_size <= _MAX_SHADOW_MAP:
            raise InvalidInputError(
                "quality.shadow_map_size",
                f"{self.shadow_map_size} texels is out of range",
                f"Use a number from 1 to {_MAX_SHADOW_MAP}",
            )
        if not self.shadows and self.shadow_map_size != 0:
            raise InvalidInputError(
                "quality.shadow_map_size", "is not 0, although shadows are off", "Use 0 if shadows are off"
            )

    def to_json(self) -> dict[str, Any]:
        """Return the preset in JSON form."""
        return asdict(self)

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Quality:
        """Read a preset from its JSON form. Raises InvalidInputError if a field is missing, unknown or wrong."""
        try:
            return _QUALITY.validate_json(json.dumps(dict(value)))
        except ValidationError as error:
            problem = error.errors()[0]
            field = ".".join(("quality", *map(str, problem["loc"])))
            raise InvalidInputError(
                field, problem["msg"], f"Use exactly the fields {', '.join(cls.__slots__)}"
            ) from None


_QUALITY = TypeAdapter(Quality)

FAST = Quality("fast", shadows=False, shadow_map_size=0, samples=0)
"""Preset without shadows and multisampling, for large sweeps on machines without a GPU."""

STANDARD = Quality("standard", shadows=True, shadow_map_size=512, samples=4)
"""Preset for reported scores: one shadow (4 mm texels, about one pixel of the front view), four samples per pixel."""

HIGH = Quality("high", shadows=True, shadow_map_size=2048, samples=8)
"""Preset for figures and videos: fine shadow edges, eight samples per pixel."""

QUALITIES: Mapping[str, Quality] = {quality.name: quality for quality in (FAST, STANDARD, HIGH)}
"""All presets, keyed by name."""


def require_cameras(names: Iterable[str]) -> None:
    """Raise UnknownNameError if any of the given names is not the name of a camera in the scenes."""
    known = (*CAMERAS, WRIST_CAMERA)
    unknown = next((name for name in names if name not in known), None)
    if unknown is not None:
        raise UnknownNameError("camera", unknown, known)


def quality_preset(name: str) -> Quality:
    """Return the preset with the given name. Raises UnknownNameError if there is none."""
    try:
        return QUALITIES[name]
    except KeyError:
        raise UnknownNameError("quality", name, QUALITIES) from None


def stage_spec(quality: Quality, *, room: Room = ROOMS[0], front: CameraMount | None = None) -> mujoco.MjSpec:
    """Return a new description of the empty world: options, table, pedestal, floor, lights and fixed cameras.

    The caller attaches the robot, adds the objects and compiles the model. ``front`` replaces the front camera. Two
    calls with equal arguments describe the same model, but do not share any data. The quality preset is also written to
    the model's visual settings, so that other viewers show the same image as the renderer of betterbench.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "betterbench"
    PHYSICS.set_scene(spec)
    _set_visuals(spec, quality, room.light)
    _add_materials(spec, room)
    _add_furniture(spec)
    _add_lights(spec, room.light)
    _add_cameras(spec, front or FRONT_CAMERA)
    return spec


def add_mounted_camera(body: mujoco.MjsBody, name: str, mount: CameraMount) -> mujoco.MjsCamera:
    """Add one of the robot's cameras to the body that carries it."""
    return add_camera(body, name, mount.position, mount.target, up=mount.up, fovy_deg=mount.fovy_deg)


def _set_visuals(spec: mujoco.MjSpec, quality: Quality, light: Light) -> None:
    """Set the quality, and all visual settings that MuJoCo would otherwise derive from the content of the scene."""
    # With a fixed extent, clipping planes and shadow bounds do not depend on the objects on the table.
    spec.stat.extent = 1.0
    spec.stat.center = [0.5, 0.0, 0.0]
    visual = spec.visual
    visual.map.znear = 0.01
    visual.map.zfar = 20.0
    # The key light's shadow map spans +-1.1 m about its target point: the table and the arm above it. With 0.8 m, the
    # table corner would be at the edge of the map, with speckles of false shadow.
    visual.map.shadowclip = 1.1
    visual.quality.shadowsize = quality.shadow_map_size
    visual.quality.offsamples = quality.samples
    # Flat surfaces are evenly lit under directional light, so subdividing them into quads gains nothing and costs about
    # 10 % of an image's render time.
    visual.quality.numquads = 1
    visual.global_.offwidth = 448
    visual.global_.offheight = 448
    visual.headlight.active = 1
    visual.headlight.ambient = list(light.ambient)
    visual.headlight.diffuse = [0.08, 0.08, 0.08]
    visual.headlight.specular = [0.0, 0.0, 0.0]


@functools.lru_cache(maxsize=16)
def _table_top(surface: str, color: Vector) -> bytes:
    """Return the pixels of a table top.

    The pixels are cached, since painting them takes 40 ms, which is a quarter of the time for building a scene.
    """
    return SURFACES[surface](np.asarray(color), _TEXTURE_SIZE).tobytes()


def _add_materials(spec: mujoco.MjSpec, room: Room) -> None:
    """Add the sky, the textures and the materials to the model."""
    texture2d, rgb_role = mujoco.mjtTexture.mjTEXTURE_2D, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[min(1.0, 1.12 * c) for c in room.wall],
        rgb2=[0.86 * c for c in room.wall],
        width=64,
        height=384,
    )
    texture = spec.add_texture(name="table_top", type=texture2d, width=_TEXTURE_SIZE, height=_TEXTURE_SIZE, nchannel=3)
    texture.data = _table_top(room.surface, room.table)
    top = spec.add_material(name="table_top", specular=0.08, shininess=0.2, rgba=[1.0, 1.0, 1.0, 1.0])
    textures = list(top.textures)
    textures[rgb_role] = "table_top"
    top.textures = textures
    for name, color, specular in (
        ("floor", room.floor, 0.0),
        ("metal", (0.30, 0.31, 0.33), 0.3),
        ("pedestal", (0.36, 0.37, 0.39), 0.15),
    ):
        spec.add_material(name=name, rgba=[*color, 1.0], specular=specular, shininess=0.3)


def _add_furniture(spec: mujoco.MjSpec) -> None:
    """Add the floor, the pedestal and the table, which are all static."""
    # MuJoCo uses the larger friction of two touching surfaces. With these low values, the object's friction applies.
    friction = [0.5, 0.005, 0.0001]

    def add_box(body: mujoco.MjsBody, name: str, center: Vector, half_size: Vector, material: str) -> None:
        box = mujoco.mjtGeom.mjGEOM_BOX
        body.add_geom(name=name, type=box, pos=center, size=half_size, material=material, friction=friction)

    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0.0, 0.0, FLOOR_HEIGHT_M],
        size=[6.0, 6.0, 0.5],
        material="floor",
        friction=friction,
    )
    x_low, x_high = _PEDESTAL_X_M
    half_height = -0.5 * (FLOOR_HEIGHT_M + TABLE_THICKNESS_M)
    center, half_size = (
        (0.5 * (x_low + x_high), 0.0, FLOOR_HEIGHT_M + half_height),
        (0.5 * (x_high - x_low), _PEDESTAL_HALF_WIDTH_M),
    )
    add_box(spec.worldbody.add_body(name="pedestal"), "pedestal", center, (*half_size, half_height), "pedestal")

    (x_low, x_high), (y_low, y_high) = TABLE_X_M, TABLE_Y_M
    x, y, half_x, half_y = (
        0.5 * (x_low + x_high),
        0.5 * (y_low + y_high),
        0.5 * (x_high - x_low),
        0.5 * (y_high - y_low),
    )
    table = spec.worldbody.add_body(name="table")
    half_thickness = 0.5 * TABLE_THICKNESS_M
    add_box(table, "table", (x, y, -half_thickness), (half_x, half_y, half_thickness), "table_top")
    leg, inset = 0.025, 0.05
    half_leg = 0.5 * (-FLOOR_HEIGHT_M - TABLE_THICKNESS_M)
    for number, (side_x, side_y) in enumerate(((-1, -1), (-1, 1), (1, -1), (1, 1))):
        foot = (x + side_x * (half_x - inset), y + side_y * (half_y - inset), FLOOR_HEIGHT_M + half_leg)
        add_box(table, f"table_leg_{number}", foot, (leg, leg, half_leg), "metal")


def _add_lights(spec: mujoco.MjSpec, light: Light) -> None:
    """Add a key light, which may cast a shadow, and a fill light from the other side, which casts none."""
    aim = np.array([0.45, 0.0, 0.1])
    for name, direction, diffuse, specular in (
        (KEY_LIGHT, light.key_direction, list(light.key), 0.3),
        ("fill", (-light.key_direction[0], -2.0 * light.key_direction[1], -0.8), [light.fill] * 3, 0.0),
    ):
        along = np.array(direction) / np.linalg.norm(direction)
        spec.worldbody.add_light(
            name=name,
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=(aim - 1.6 * along).tolist(),
            dir=along.tolist(),
            castshadow=name == KEY_LIGHT,
            ambient=[0.0] * 3,
            diffuse=diffuse,
            specular=[specular] * 3,
        )


def _add_cameras(spec: mujoco.MjSpec, front: CameraMount) -> None:
    world = spec.worldbody
    add_mounted_camera(world, "front", front)
    # Positions and lens are those of the paper's own release. All three cameras look at the center of the table.
    add_camera(world, "front_official", (1.6, 0.0, 0.9), (0.45, 0.0, 0.05), fovy_deg=47.0)
    add_camera(world, "left_shoulder", (-0.3, 0.9, 0.9), (0.45, 0.0, 0.0), fovy_deg=47.0)
    add_camera(world, "right_shoulder", (-0.3, -0.9, 0.9), (0.45, 0.0, 0.0), fovy_deg=47.0)


def add_camera(
    body: mujoco.MjsBody, name: str, position: Vector, target: Vector, *, up: Vector = (0.0, 0.0, 1.0), fovy_deg: float
) -> mujoco.MjsCamera:
    """Add a fixed camera that looks from a position [m] at a target [m]. ``up`` points upward in the image."""
    backward = np.asarray(position) - np.asarray(target)
    backward = backward / np.linalg.norm(backward)
    right = np.cross(np.asarray(up), backward)
    right = right / np.linalg.norm(right)
    upward = np.cross(backward, right)
    camera = body.add_camera(name=name, pos=list(position), fovy=fovy_deg)
    camera.alt.type = mujoco.mjtOrientation.mjORIENTATION_XYAXES
    camera.alt.xyaxes = [*right.tolist(), *upward.tolist()]
    return camera
