"""The register of generators: a category is one decorated function; everything else is derived from it."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from betterbench.assets.asset import Asset, CollisionPart, Grasp, Texture, VisualPart
from betterbench.assets.procedural.body import MassProperties
from betterbench.assets.procedural.mesh import Mesh
from betterbench.assets.procedural.paint import Color
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.geometry import Vector
from betterbench.state import Region
from betterbench.tasks.user_files import load_declared, registered

Generator = Callable[[np.random.Generator, str], "Draft"]


@dataclass(frozen=True, slots=True, eq=False)
class Draft:
    """What a generator makes; the register adds category, look and color and measures the size.

    Attributes:
        shape: Coarse shape word ("round", "cylinder", "box", "irregular").
        description: One sentence of free text.
        tags: Search words.
        body: Mass properties.
        visual: Colored meshes.
        collision: Convex geometries.
        grasps: Ways to take it.
        regions: Named places on it.
        parameters: The numbers that the generator chose.
    """

    shape: str
    description: str
    tags: tuple[str, ...]
    body: MassProperties
    visual: tuple[VisualPart, ...]
    collision: tuple[CollisionPart, ...]
    grasps: tuple[Grasp, ...]
    regions: tuple[Region, ...]
    parameters: dict[str, float | str]


@dataclass(frozen=True, slots=True)
class _Entry:
    """A registered generator."""

    make: Generator
    colors: tuple[str, ...]
    looks: int
    family: str


_REGISTER: dict[str, _Entry] = {}


def generator(
    category: str, *, colors: Sequence[str], looks: int = 8, family: str | None = None
) -> Callable[[Generator], Generator]:
    """Register a function as the generator of a category.

    Args:
        category: Name of the category ("mug").
        colors: Color words it can be made in; the first is the default.
        looks: Number of looks; each is the same function with another random generator.
        family: Categories of one family draw the same random numbers for a look, so that what belongs together
            (a cabinet and its drawers, the plates of a set) matches; the category alone if not given.

    Returns:
        The decorator.
    """

    def register(make: Generator) -> Generator:
        named = registered("asset", category, make, _REGISTER)
        _REGISTER[category] = _Entry(named, tuple(colors), looks, family or category)
        return make

    return register


def categories() -> tuple[str, ...]:
    """Return the names of all categories, sorted."""
    load_declared()
    return tuple(sorted(_REGISTER))


def _entry(category: str) -> _Entry:
    """Look a category up."""
    load_declared()
    try:
        return _REGISTER[category]
    except KeyError:
        raise UnknownNameError("asset category", category, _REGISTER) from None


def colors(category: str) -> tuple[str, ...]:
    """Return the colors a category can be made in, the default first.

    Raises:
        UnknownNameError: If there is no such category.
    """
    return _entry(category).colors


def looks(category: str) -> range:
    """Return the numbers of a category's looks.

    Raises:
        UnknownNameError: If there is no such category.
    """
    return range(_entry(category).looks)


def build(category: str, *, look: int = 0, color: str | None = None) -> Asset:
    """Make an asset. The same arguments give the same bits in every process; the color never changes the shape.

    Args:
        category: Name of the category.
        look: Number of the look, see :func:`looks`.
        color: Color word, see :func:`colors`; the category's first color if not given.

    Returns:
        The asset.

    Raises:
        UnknownNameError: If the category or the color is not known.
        InvalidInputError: If there is no such look.
    """
    entry = _entry(category)
    chosen = entry.colors[0] if color is None else color
    if chosen not in entry.colors:
        raise UnknownNameError(f"color of {category}", chosen, entry.colors)
    if look not in range(entry.looks):
        raise InvalidInputError(
            f"look of {category}", f"{look!r} does not exist", f"Use a number from 0 to {entry.looks - 1}"
        )
    return _build(category, look, chosen)


@functools.lru_cache(maxsize=512)
def _build(category: str, look: int, color: str) -> Asset:
    """Make an asset from arguments that are known to be good."""
    entry = _REGISTER[category]
    seed = int.from_bytes(hashlib.sha256(f"betterbench asset {entry.family} {look}".encode()).digest()[:8], "big")
    draft = entry.make(np.random.default_rng(seed), color)
    points = np.concatenate([part.vertices for part in draft.visual]).astype(float)
    low, high = points.min(axis=0), points.max(axis=0)
    x, y, z = (round(float(e), 6) for e in high - low)
    return Asset(
        category=category,
        look=look,
        color=color,
        shape=draft.shape,
        description=draft.description,
        tags=draft.tags,
        size_m=(x, y, z),
        mass_kg=draft.body.mass_kg,
        center_of_mass=draft.body.center_of_mass,
        inertia=draft.body.inertia,
        visual=draft.visual,
        collision=draft.collision,
        grasps=draft.grasps,
        regions=draft.regions,
        parameters=draft.parameters,
    )


def part(
    name: str,
    mesh: Mesh,
    color: Color,
    *,
    picture: np.ndarray | None = None,
    specular: float = 0.2,
    shininess: float = 0.3,
    alpha: float = 1.0,
) -> VisualPart:
    """Return a visual part from a mesh.

    Args:
        name: Name within the asset.
        mesh: The mesh.
        color: Color, each in [0, 1]; ignored (white) when there is a picture.
        picture: (height, width, 3) uint8 picture for the texture coordinates of the mesh.
        specular: Strength of highlights in [0, 1].
        shininess: Sharpness of highlights in [0, 1].
        alpha: Opacity in [0, 1].

    Returns:
        The part in the number formats that renderers take.
    """
    r, g, b = (round(min(max(float(c), 0.0), 1.0), 4) for c in (color if picture is None else (1.0, 1.0, 1.0)))
    texture = None if picture is None else Texture(_frozen(picture), _frozen(np.round(mesh.uv, 6).astype(np.float32)))
    return VisualPart(
        name=name,
        vertices=_frozen((np.round(mesh.vertices, 7) + 0.0).astype(np.float32)),
        faces=_frozen(mesh.faces.astype(np.int32)),
        rgba=(r, g, b, alpha),
        specular=specular,
        shininess=shininess,
        texture=texture,
    )


def _frozen(array: np.ndarray) -> np.ndarray:
    """Return a contiguous array that nobody can write to: assets are cached and shared."""
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array


def centered(meshes: Sequence[Mesh]) -> Vector:
    """Return the shift [m] that moves the center of the bottom face of the bounding box to the origin."""
    points = np.concatenate([m.vertices for m in meshes])
    low, high = points.min(axis=0), points.max(axis=0)
    return (-0.5 * float(low[0] + high[0]), -0.5 * float(low[1] + high[1]), -float(low[2]))
