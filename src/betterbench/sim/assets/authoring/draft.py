"""Drafts of assets (the results of generators), and helpers for making their parts, grasps and regions."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from betterbench.geometry import Pose, Vector, multiply, normalize
from betterbench.interface.state import Region
from betterbench.sim.assets.asset import LIBRARY_LICENSE, LIBRARY_SOURCE, CollisionPart, Grasp, Texture, VisualPart
from betterbench.sim.assets.authoring.mass import MassProperties
from betterbench.sim.assets.authoring.mesh import Mesh, box, mapped
from betterbench.sim.assets.authoring.paint import Canvas, Rgb
from betterbench.sim.assets.authoring.solids import solid_box

JAW_OPENS_ALONG_Y = normalize((0.0, 1.0, 0.0, 0.0))
"""Orientation of a gripper that approaches from above: z points down, and y is the direction in which the fingers
open."""

JAW_OPENS_ALONG_X = normalize(multiply((math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)), JAW_OPENS_ALONG_Y))
"""The same orientation, rotated so that the fingers open along the x axis of the object."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Draft:
    """Description of one object. The registry makes an asset from it.

    The registry adds the category, the variant number and the color word, which also becomes the last tag. It
    distributes the mass over the collision parts and measures the size. The fields that are not listed here are
    explained in :class:`~betterbench.sim.assets.asset.Asset`.

    Attributes:
        tags: Search words. The color word is not among them, since the registry adds it.
        traits: Tags that describe the material, place or use of the object but are not names for it: "glass" for a jar,
            "desk" for a mouse.
        parts: Visual and collision parts, in any order.
        densities: Relative density of each collision part, in order. If there are fewer densities than parts, the
            remaining parts have no mass. If None, all parts have the same density.
        material: Name of the surface material (see :mod:`~betterbench.sim.assets.authoring.materials`). It sets the
            friction of all collision parts, except parts with a friction of their own (:func:`surfaced`). If None, all
            parts keep their friction.
        body: Mass, center of mass and inertia, if they come from another source. If None, the mass is distributed over
            the collision parts, which then must not be hulls.
        source: Where the shape comes from.
        license: License of the shape.
    """

    shape: Literal["round", "cylinder", "box", "irregular"]
    description: str
    tags: tuple[str, ...]
    traits: tuple[str, ...] = ()
    mass_kg: float
    parts: Sequence[VisualPart | CollisionPart]
    densities: Sequence[float] | None = None
    material: str | None = None
    grasps: tuple[Grasp, ...] = ()
    regions: tuple[Region, ...] = ()
    parameters: Mapping[str, float | str] = field(default_factory=dict)
    body: MassProperties | None = None
    source: str = LIBRARY_SOURCE
    license: str = LIBRARY_LICENSE


def part(
    name: str,
    mesh: Mesh,
    paint: Rgb | Canvas,
    *,
    view: tuple[Vector, Vector] | None = None,
    specular: float = 0.2,
    shininess: float = 0.3,
    opacity: float = 1.0,
) -> VisualPart:
    """Return a visual part, i.e. a mesh in one color or with a texture.

    A texture is mapped by the texture coordinates of the mesh. If ``view`` is given (such as :data:`FRONT` or
    :data:`ABOVE`), the texture is projected onto the mesh instead. A view consists of the directions of the texture's
    columns and rows. Colors, ``specular``, ``shininess`` and ``opacity`` are in [0, 1].
    """
    mesh = mesh if view is None else mapped(mesh, *view)
    color, texture = (1.0, 1.0, 1.0), None
    if isinstance(paint, Canvas):
        texture = Texture(frozen(paint.pixels()), frozen(np.round(mesh.uv, 6).astype(np.float32)))
    else:
        color = paint
    r, g, b = (round(min(max(float(c), 0.0), 1.0), 4) for c in color)
    vertices = frozen((np.round(mesh.vertices, 7) + 0.0).astype(np.float32))
    faces = frozen(mesh.faces.astype(np.int32))
    return VisualPart(name, vertices, faces, (r, g, b, opacity), specular, shininess, texture)


def frozen(array: np.ndarray) -> np.ndarray:
    """Return a contiguous, read-only copy of an array.

    Arrays of assets are read-only because assets are cached and shared.
    """
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array


def block(
    name: str,
    low: Vector,
    high: Vector,
    paint: Rgb | Canvas,
    *,
    bevel: float = 0.0,
    corner: float = 0.0,
    steps: int = 1,
    view: tuple[Vector, Vector] | None = None,
    specular: float = 0.2,
    shininess: float = 0.3,
) -> tuple[VisualPart, CollisionPart]:
    """Return the visual and the collision part of a box that extends from corner ``low`` to corner ``high`` [m].

    Only the visual part has beveled top and bottom edges and rounded vertical edges. The remaining arguments are
    explained in :func:`box` and :func:`part`.
    """
    solid = solid_box(low, high)
    x, y, z = solid.size
    mesh = box((2.0 * x, 2.0 * y, 2.0 * z), solid.position, bevel=bevel, corner=corner, steps=steps)
    return part(name, mesh, paint, view=view, specular=specular, shininess=shininess), solid


def grip(
    name: str,
    height: float,
    width: float,
    *,
    x: float = 0.0,
    y: float = 0.0,
    across: Literal["x", "y"] = "y",
    clearance: float = 0.012,
    symmetric_yaw: bool = False,
    preference: int = 0,
) -> Grasp:
    """Return a grasp from straight above at (x, y), with the center of the finger pads at ``height`` [m].

    The fingers open along the object's axis ``across``. The part between them has the thickness ``width`` [m]. The
    remaining arguments are explained in :class:`Grasp`.
    """
    pose = Pose((x, y, height), JAW_OPENS_ALONG_X if across == "x" else JAW_OPENS_ALONG_Y)
    return Grasp(name, pose, width, clearance, symmetric_yaw, preference)


def grip_across(height: float, radius: float, *, clearance: float | None = None) -> Grasp:
    """Return a grasp from above across a round body with the given radius at ``height`` [m].

    The gripper may have any yaw. The default clearance is 12 mm on each side, or less if the jaw would otherwise have
    to open wider than 79 mm.
    """
    free = min(0.012, 0.0395 - radius) if clearance is None else clearance
    return grip("body", height, 2.0 * radius, clearance=free, symmetric_yaw=True)


def zone(
    name: str, half_x: float, half_y: float, z: float = 0.0, *, x: float = 0.0, y: float = 0.0, half_z: float = 0.001
) -> Region:
    """Return a rectangular region, given by its half extents and its center [m].

    The region is flat unless its half height ``half_z`` is given.
    """
    return Region(name, (x, y, z), (half_x, half_y, half_z))


def disc(name: str, radius: float, z: float = 0.0, *, x: float = 0.0) -> Region:
    """Return a flat round region with the given radius [m] at height ``z`` [m]."""
    return zone(name, radius, radius, z, x=x)


def centered(*meshes: Mesh) -> Vector:
    """Return the translation [m] that moves the center of the bounding box's bottom face to the origin."""
    points = np.concatenate([m.vertices for m in meshes])
    low, high = points.min(axis=0), points.max(axis=0)
    return (-0.5 * float(low[0] + high[0]), -0.5 * float(low[1] + high[1]), -float(low[2]))
