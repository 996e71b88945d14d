"""Import of an object file. The result is the draft of an asset."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from betterbench.errors import InvalidInputError, one_line
from betterbench.interface.state import Region
from betterbench.sim.assets.asset import CollisionPart
from betterbench.sim.assets.authoring.draft import Draft, zone
from betterbench.sim.assets.authoring.mass import MassProperties
from betterbench.sim.assets.importing.appearance import visual_parts
from betterbench.sim.assets.importing.cavity import Cavity, columns_box, floor_square, highest_level, tops_of
from betterbench.sim.assets.importing.foot import foot_under
from betterbench.sim.assets.importing.grasping import proposals
from betterbench.sim.assets.importing.hulls import Fit, convex_hulls, fit_of, with_thickness
from betterbench.sim.assets.importing.kinds import Kind, kind_of
from betterbench.sim.assets.importing.measures import share_from_behind
from betterbench.sim.assets.importing.mesh_file import FolderResolver
from betterbench.sim.assets.importing.object_file import read_object
from betterbench.sim.assets.importing.physics import Body, stated_body, stated_hulls
from betterbench.sim.assets.importing.raw import RawMesh
from betterbench.sim.assets.importing.solid import Solid, mass_of_cells
from betterbench.sim.assets.importing.upright import LEAST_M, MOST_M, Placed, place
from betterbench.sim.assets.names import file_words, words_of
from betterbench.tasks.words import with_article

DENSITY = 500.0
"""Assumed density of an object of unknown kind [kg/m^3]: between foam and water."""
_MOSTLY = 0.5
"""If back-facing surface covers more than this fraction of an image, the mesh counts as inside out rather than open."""
_DENSEST = 7000.0
"""Maximum density of an object that gets the usual mass of its kind [kg/m^3]. It is lower than that of steel (7,900),
because the cells overestimate the volume of thin walls."""
_LEAST_TOP_M = 0.010
"""Half the minimum side length of a level surface that can carry another object [m]."""
_LIGHTEST_KG, _HEAVIEST_KG = 0.005, 5.0
_FRICTION = (0.6, 0.006, 0.0008)
"""Friction of glazed ceramic, painted metal and hard plastic; see the materials of the library."""


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """An imported object.

    Attributes:
        draft: Description of the object, in the form that procedural generators return.
        fit: Distances between the object's collision shapes and its visible surface.
        kind: Kind of object, determined from its name. None if the name contains no known kind.
        notes: What the importer decided, and why.
    """

    draft: Draft
    fit: Fit
    kind: Kind | None
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Wishes:
    """Options of an import. The importer chooses a value for each option that is None.

    Attributes:
        name: Name or description that determines the kind of object. If None, the name of the file is used.
        size_m: Longest side of the object [m].
        mass_kg: Mass of the object [kg].
        up: Axis of the file's frame that points up: x, y, z, -x, -y or -z.
        license: License of the mesh.
        source: Where the mesh comes from.
        author: Author of the mesh.
        freeze: Whether movable joints of a URDF or MJCF file are fixed in place. If False, a movable joint raises an
            error.
    """

    name: str | None = None
    size_m: float | None = None
    mass_kg: float | None = None
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    license: str = "unknown"
    source: str | None = None
    author: str | None = None
    freeze: bool = False


def import_mesh(path: Path, wishes: Wishes = Wishes(), files: FolderResolver | None = None) -> Imported:
    """Import the object in a file, and return its draft.

    Args:
        path: The mesh, URDF or MJCF file.
        wishes: Options of the import.
        files: Resolver that opens and records the files that the file refers to. If None, a resolver for the file's
            folder is created.

    Raises:
        InvalidInputError: If the file cannot be read, or does not contain an object of tabletop size.
        MissingDependencyError: If a package that reads the file format is not installed.
    """
    where = one_line(path.name, most=120)
    whole = path.absolute()
    raw = read_object(path, files or FolderResolver(path.parent, where), freeze=wishes.freeze)
    stated = raw.stated
    named = wishes.name or " ".join(file_words(whole, Path(whole.anchor)))
    if wishes.name is None and kind_of(named) is None and stated is not None and kind_of(stated.name) is not None:
        named = " ".join(words_of(stated.name))
    kind = kind_of(named)
    placed = _placed(raw, kind, where, wishes)
    seen, turned_out = _facing_outward(placed.mesh)
    size = np.ptp(placed.mesh.bounds(), axis=0)
    longest = float(size.max())
    if not LEAST_M <= longest <= MOST_M:
        problem = f"its longest side is {100.0 * longest:.3g} cm, expected {100 * LEAST_M:g} to {100 * MOST_M:g} cm"
        raise InvalidInputError(where, problem, "Set its longest side with --size-m")
    body, said = _body(placed, kind, longest, wishes)
    hulls, by_file = stated_hulls(placed)
    if hulls:
        fit = fit_of(hulls, placed.solid)
    else:
        hulls, fit = convex_hulls(placed.solid, placed.mesh.surface(), placed.cavity)
    if not hulls:
        raise InvalidInputError(where, "it is flat and has no volume", "Use a mesh editor to give it a thickness")
    foot = foot_under(hulls, body.center)
    description, tags = described(named)
    grasps = tuple(p.grasp for p in proposals(placed.solid, body.center))
    notes = (*placed.notes, *turned_out, *said, *by_file, *(() if stated is None else stated.notes))
    if kind is not None and kind.is_open and placed.cavity is None:
        notes = (*notes, f"no hollow was found, though a {kind.name} is open at the top")
    if foot is not None:
        notes = (*notes, "it would roll: it has a flat foot in its collision shape")
    draft = Draft(
        shape=shape_of(placed.solid, placed.cavity, size),
        description=description,
        tags=tags,
        mass_kg=body.mass_kg,
        parts=(*visual_parts(seen, where), *map(collision_part, [*hulls, *([] if foot is None else [foot])])),
        body=mass_properties(body.mass_kg, body.center, body.inertia),
        grasps=grasps,
        regions=tuple(regions_of(placed.solid, placed.cavity, size)),
        parameters={
            "file": where,
            "name": named,
            "kind": "" if kind is None else kind.name,
            "up": placed.up,
            "unit_m": placed.scale,
            "hulls": len(hulls),
        },
        source=", ".join(part for part in (wishes.source or where, wishes.author and f"by {wishes.author}") if part),
        license=wishes.license,
    )
    return Imported(draft, fit, kind, notes)


def _facing_outward(mesh: RawMesh) -> tuple[RawMesh, tuple[str, ...]]:
    """Reverse the triangles of a mesh if most of them face inward, because renderers do not draw back-facing triangles.

    Returns:
        The mesh, and a note if its triangles were reversed.
    """
    if share_from_behind(*mesh.surface()) < _MOSTLY:
        return mesh, ()
    flipped = tuple(replace(part, faces=np.ascontiguousarray(part.faces[:, ::-1])) for part in mesh.parts)
    return RawMesh(flipped, mesh.up, mesh.unit_m), ("its triangles faced inward, and were turned around",)


def _placed(raw: RawMesh, kind: Kind | None, where: str, wishes: Wishes) -> Placed:
    """Scale a mesh to meters and set it upright.

    For a URDF or MJCF file, use the unit and the up axis stated in the file.
    """
    if raw.stated is None:
        return place(raw, kind, where, up=wishes.up, size_m=wishes.size_m)
    longest = float(np.ptp(raw.bounds(), axis=0).max())
    placed = place(raw, kind, where, up=wishes.up or "z", size_m=wishes.size_m or longest)
    if wishes.size_m is None:
        said = f"longest side {100 * longest:.3g} cm, as the file states"
        placed = replace(placed, notes=(said, *placed.notes[1:]))
    return placed


def _body(placed: Placed, kind: Kind | None, longest: float, wishes: Wishes) -> tuple[Body, tuple[str, ...]]:
    """Return the mass properties of an object, and notes on where the values come from."""
    mass, said = _mass(placed, kind, longest, wishes)
    body, notes = stated_body(placed, wishes.mass_kg)
    if body is not None:
        return body, notes
    return Body(mass, *mass_of_cells(placed.solid, mass)), (said, *notes)


def _mass(placed: Placed, kind: Kind | None, longest: float, wishes: Wishes) -> tuple[float, str]:
    if wishes.mass_kg is not None:
        return wishes.mass_kg, f"mass {1000 * wishes.mass_kg:.3g} g, as given"
    solid = placed.solid
    volume = (float(solid.cells.sum()) - 0.5 * float(solid.surface.sum())) * solid.pitch_m**3
    if kind is None:
        mass, why = DENSITY * volume, f"{DENSITY:g} kg/m^3 of solid, since its kind is not known"
    elif kind.mass_at(longest) > _DENSEST * volume:
        mass, why = _DENSEST * volume, f"{_DENSEST:g} kg/m^3 of solid: it is slimmer than a usual {kind.name}"
    else:
        mass, why = kind.mass_at(longest), f"usual for {with_article(kind.name)} of this size"
    limited = min(max(mass, _LIGHTEST_KG), _HEAVIEST_KG)
    if limited != mass:
        why = f"the {'least' if limited > mass else 'most'} that is assumed, instead of {1000 * mass:.3g} g: {why}"
    mass = round(limited, 4)
    return mass, f"mass {1000 * mass:.3g} g, {why}"


def described(named: str) -> tuple[str, tuple[str, ...]]:
    """Return the description and the tags of an imported object, derived from its name."""
    kind = kind_of(named)
    tags = dict.fromkeys([*([] if kind is None else [kind.name]), *words_of(named)])
    return f"{named} imported from a mesh.".replace("_", " "), tuple(tags)


def mass_properties(mass: float, center: np.ndarray, inertia: np.ndarray) -> MassProperties:
    """Round a mass, a center of mass and an inertia tensor, and return them as mass properties.

    Args:
        mass: Mass [kg].
        center: (3,) center of mass [m].
        inertia: (3, 3) inertia tensor about the center of mass [kg m^2].
    """
    six = (inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2])
    ixx, iyy, izz, ixy, ixz, iyz = (float(f"{v:.6g}") for v in six)
    x, y, z = (float(f"{v:.6g}") for v in center)
    return MassProperties(mass, (x, y, z), (ixx, iyy, izz, ixy, ixz, iyz))


def shape_of(solid: Solid, cavity: Cavity | None, size: np.ndarray) -> Literal["round", "cylinder", "box", "irregular"]:
    """Classify the shape of an object coarsely, using the fraction of the bounding box that the object fills."""
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
    """Return the collision part for a convex hull with the given corners (n, 3) [m]."""
    vertices = np.ascontiguousarray((np.round(with_thickness(corners), 6) + 0.0).astype(np.float32))
    return CollisionPart("hull", (0.0, 0.0, 0.0), vertices=vertices, friction=_FRICTION)


def regions_of(solid: Solid, cavity: Cavity | None, size: np.ndarray) -> list[Region]:
    """Return the named regions of an object, for use in tasks.

    Every object has a base. A hollow object also has an opening, an inside and a rim. If its floor is level, it has a
    floor and, if it is shallow like a plate, a top. An object without a hollow has a top if it has a level surface.
    """
    low = solid.surface & (np.arange(solid.cells.shape[2]) <= 2)[None, None, :]
    x, y, half_x, half_y = columns_box(solid, np.asarray(low.any(axis=2)))
    found = [zone("base", half_x, half_y, x=x, y=y)]
    if cavity is None:
        level = highest_level(solid, tops_of(solid))
        if level is not None and level[3] >= _LEAST_TOP_M:
            height, x, y, half = level
            found.append(zone("top", half, half, height, x=x, y=y))
        return found
    middle_x, middle_y, half_x, half_y = columns_box(solid, cavity.mask)
    found.append(zone("opening", half_x, half_y, cavity.rim_m, x=middle_x, y=middle_y))
    middle = 0.5 * (cavity.rim_m + cavity.floor_m)
    found.append(zone("inside", half_x, half_y, middle, x=middle_x, y=middle_y, half_z=0.5 * cavity.depth_m))
    bottom = floor_square(solid, cavity)
    if bottom is not None and bottom[3] > 0.005:
        height, x, y, half = bottom
        found.append(zone("floor", half, half, height, x=x, y=y))
        if cavity.depth_m < 0.25 * float(min(size[0], size[1])):  # shallow like a plate
            found.append(zone("top", half, half, height, x=x, y=y))
    found.append(zone("rim", half_x, half_y, cavity.rim_m, x=middle_x, y=middle_y))
    return found
