"""From a mesh file to the draft of an asset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from betterbench.errors import InvalidInputError, one_line
from betterbench.interface.state import Region
from betterbench.sim.assets.asset import CollisionPart
from betterbench.sim.assets.authoring.draft import Draft, zone
from betterbench.sim.assets.authoring.mass import MassProperties
from betterbench.sim.assets.importing.appearance import visual_parts
from betterbench.sim.assets.importing.cavity import Cavity, columns_box, highest_level, level_square, tops_of
from betterbench.sim.assets.importing.grasping import proposals
from betterbench.sim.assets.importing.hulls import Fit, convex_hulls, fit_of
from betterbench.sim.assets.importing.kinds import Kind, kind_of, words_of
from betterbench.sim.assets.importing.mesh_file import read_mesh_file
from betterbench.sim.assets.importing.solid import Solid, mass_of_cells
from betterbench.sim.assets.importing.upright import LEAST_M, MOST_M, Placed, place

DENSITY = 500.0
"""Mass of an object of unknown kind per volume of its solid [kg/m^3]: between foam and water."""
GENERIC_STEMS = ("textured", "model", "mesh", "scene")
"""Names of mesh files that do not tell what they hold; the name of their folder does."""
_LIGHTEST_KG, _HEAVIEST_KG = 0.005, 5.0
_FRICTION = (0.6, 0.006, 0.0008)
"""Of glazed ceramic, painted metal and hard plastic alike; see the materials of the library."""


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """An imported object.

    Attributes:
        draft: Its description, as a generator would return it.
        fit: Distances between its collision shapes and its visible surface.
        kind: Kind that its name tells, None if it is not known.
        notes: What was decided for it, and by what.
    """

    draft: Draft
    fit: Fit
    kind: Kind | None
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Wishes:
    """What a person says about an object; what is None is found out.

    Attributes:
        name: Name or description, from which its kind is told; the name of the file otherwise.
        size_m: Longest side [m].
        mass_kg: Mass.
        up: Axis of the file that points up: x, y, z, -x, -y or -z.
        license: License of the mesh.
        source: Where it comes from.
    """

    name: str | None = None
    size_m: float | None = None
    mass_kg: float | None = None
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    license: str = "unknown"
    source: str | None = None


def import_mesh(path: Path, wishes: Wishes = Wishes()) -> Imported:
    """Make an asset of a mesh file.

    Raises:
        InvalidInputError: If the file cannot be read, or no object of a table can be made of it.
        MissingDependencyError: If a package that its format needs is not installed.
    """
    where = one_line(path.name, most=120)
    named = wishes.name or (path.parent.name if path.stem.lower() in GENERIC_STEMS else path.stem)
    kind = kind_of(named)
    raw = read_mesh_file(path)
    placed = place(raw, kind, where, up=wishes.up, size_m=wishes.size_m)
    size = np.ptp(placed.mesh.bounds(), axis=0)
    longest = float(size.max())
    if not LEAST_M <= longest <= MOST_M:
        problem = f"its longest side is {100.0 * longest:.3g} cm, expected {100 * LEAST_M:g} to {100 * MOST_M:g} cm"
        raise InvalidInputError(where, problem, "Give its longest side with --size, in meters")
    mass, said = _mass(placed, kind, longest, wishes)
    center, inertia = mass_of_cells(placed.solid, mass)
    surface = placed.mesh.surface()
    hulls = convex_hulls(placed.solid, surface, placed.cavity)
    if not hulls:
        raise InvalidInputError(where, "it is flat: it spans no volume", "Give it a thickness in a mesh editor")
    grasps = tuple(p.grasp for p in proposals(placed.solid, center))
    description, tags = described(named)
    notes = (*placed.notes, said)
    if kind is not None and kind.is_open and placed.cavity is None:
        notes = (*notes, f"no hollow was found, though a {kind.name} is open at the top")
    draft = Draft(
        shape=shape_of(placed.solid, placed.cavity, size),
        description=description,
        tags=tags,
        mass_kg=mass,
        parts=(*visual_parts(placed.mesh), *(collision_part(corners) for corners in hulls)),
        body=mass_properties(mass, center, inertia),
        grasps=grasps,
        regions=tuple(regions_of(placed.solid, placed.cavity, size)),
        parameters={"file": where, "name": named, "up": placed.up, "unit_m": placed.scale, "hulls": len(hulls)},
        source=wishes.source or where,
        license=wishes.license,
    )
    return Imported(draft, fit_of(hulls, placed.solid.points), kind, notes)


def _mass(placed: Placed, kind: Kind | None, longest: float, wishes: Wishes) -> tuple[float, str]:
    if wishes.mass_kg is not None:
        return wishes.mass_kg, f"mass {1000 * wishes.mass_kg:.3g} g, as given"
    if kind is not None:
        mass, why = kind.mass_at(longest), f"usual for a {kind.name} of this size"
    else:
        solid = placed.solid
        cells = float(solid.cells.sum()) - 0.5 * float(solid.surface.sum())
        mass, why = DENSITY * cells * solid.pitch_m**3, f"{DENSITY:g} kg/m^3 of solid, since its kind is not known"
    mass = round(min(max(mass, _LIGHTEST_KG), _HEAVIEST_KG), 4)
    return mass, f"mass {1000 * mass:.3g} g, {why}"


def described(named: str) -> tuple[str, tuple[str, ...]]:
    """Return the description and the tags of an imported object, from its name."""
    kind = kind_of(named)
    tags = dict.fromkeys([*([] if kind is None else [kind.name]), *words_of(named)])
    return f"{named} imported from a mesh.".replace("_", " "), tuple(tags)


def mass_properties(mass: float, center: np.ndarray, inertia: np.ndarray) -> MassProperties:
    """Return the mass properties, rounded, from mass [kg], center (3,) [m] and inertia (3, 3) about it [kg m^2]."""
    six = (inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2])
    ixx, iyy, izz, ixy, ixz, iyz = (float(f"{v:.6g}") for v in six)
    x, y, z = (float(f"{v:.6g}") for v in center)
    return MassProperties(mass, (x, y, z), (ixx, iyy, izz, ixy, ixz, iyz))


def shape_of(solid: Solid, cavity: Cavity | None, size: np.ndarray) -> Literal["round", "cylinder", "box", "irregular"]:
    """Return a coarse word for the shape, from how much of its bounding box the object fills."""
    footprint = solid.cells.any(axis=2)
    found = np.argwhere(footprint)
    full = float(footprint.sum() / np.prod(np.ptp(found, axis=0) + 1))
    even = 0.85 < size[0] / max(size[1], 1e-9) < 1.18
    if full > 0.93:
        return "box"
    if even and 0.70 < full < 0.86:
        share = solid.cells.sum() * solid.pitch_m**3 / float(np.prod(size))
        return "round" if share < 0.62 and cavity is None and size[2] > 0.7 * size[0] else "cylinder"
    return "irregular"


def collision_part(corners: np.ndarray) -> CollisionPart:
    """Return the collision part of a convex hull with corners (n, 3) [m]."""
    vertices = np.ascontiguousarray((np.round(corners, 6) + 0.0).astype(np.float32))
    return CollisionPart("hull", (0.0, 0.0, 0.0), vertices=vertices, friction=_FRICTION)


def regions_of(solid: Solid, cavity: Cavity | None, size: np.ndarray) -> list[Region]:
    """Return the places on an object that tasks use: base, and opening, inside, floor and rim or top."""
    low = solid.surface & (np.arange(solid.cells.shape[2]) <= 2)[None, None, :]
    x, y, half_x, half_y = columns_box(solid, np.asarray(low.any(axis=2)))
    found = [zone("base", half_x, half_y, x=x, y=y)]
    if cavity is None:
        level = highest_level(solid, tops_of(solid))
        if level is not None:
            height, x, y, half = level
            found.append(zone("top", half, half, height, x=x, y=y))
        return found
    x, y, half_x, half_y = columns_box(solid, cavity.mask)
    found.append(zone("opening", half_x, half_y, cavity.rim_m, x=x, y=y))
    middle = 0.5 * (cavity.rim_m + cavity.floor_m)
    found.append(zone("inside", half_x, half_y, middle, x=x, y=y, half_z=0.5 * cavity.depth_m))
    tops = np.where(cavity.mask, cavity.tops, -np.inf)
    bottom = level_square(solid, tops, cavity.floor_m)
    if bottom is not None and bottom[2] > 0.005:
        found.append(zone("floor", bottom[2], bottom[2], cavity.floor_m, x=bottom[0], y=bottom[1]))
        if cavity.depth_m < 0.25 * float(min(size[0], size[1])):  # a plate: things are put onto it
            found.append(zone("top", bottom[2], bottom[2], cavity.floor_m, x=bottom[0], y=bottom[1]))
    found.append(zone("rim", half_x, half_y, cavity.rim_m, x=x, y=y))
    return found
