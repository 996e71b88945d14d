"""Size and orientation of an imported mesh: which way is up, how long a unit is, where its origin lies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.sim.assets.importing.cavity import Cavity, cavity_of
from betterbench.sim.assets.importing.kinds import Kind
from betterbench.sim.assets.importing.raw import RawMesh
from betterbench.sim.assets.importing.solid import Solid, solid_of

# Units that mesh files are written in [m]: meters, decimeters, centimeters, millimeters, inches, feet.
UNITS_M = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "foot": 0.3048}
LEAST_M, MOST_M = 0.01, 0.6
"""Longest side of an object that a table holds and a camera sees [m]."""

_TURNS = {
    "z": np.eye(3),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "y": np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]),
    "-y": np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]),
    "x": np.array([[0, 0, -1.0], [0, 1.0, 0], [1.0, 0, 0]]),
    "-x": np.array([[0, 0, 1.0], [0, 1.0, 0], [-1.0, 0, 0]]),
}
"""Rotations that bring an axis of the file to +z."""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A mesh in meters, upright, its origin in the middle of the bottom of its bounding box.

    Attributes:
        mesh: The mesh.
        solid: Its cells.
        cavity: Its hollow, None if it has none.
        up: Axis of the file that points up now ("y", "-z").
        scale: Length of a unit of the file [m].
        notes: What was decided, and by what.
    """

    mesh: RawMesh
    solid: Solid
    cavity: Cavity | None
    up: str
    scale: float
    notes: tuple[str, ...]


def place(
    mesh: RawMesh, kind: Kind | None, where: str, *, up: str | None = None, size_m: float | None = None
) -> Placed:
    """Bring a mesh to meters and upright.

    Args:
        mesh: The mesh in the frame of its file.
        kind: Kind of the object, None if it is not known.
        where: Name of the file for messages.
        up: Axis of the file that points up; otherwise by the rule of the format, by the hollow that an open object
            shows, or the way it stands best.
        size_m: Longest side [m]; otherwise by the unit of the format if the kind can have this size, by another usual
            unit, or the middle size of the kind.

    Raises:
        InvalidInputError: If the size cannot be told, or is not one of an object on a table.
    """
    scale, said = _scale(mesh, kind, where, size_m)
    sized = mesh.moved(np.diag([scale, scale, scale, 1.0]))
    axes = [up] if up is not None else [mesh.up] if mesh.up is not None else ["z", "y"]
    tried = [(axis, *_standing(sized, axis)) for axis in axes]
    if up is None and kind is not None and kind.is_open and all(cavity is None for *_, cavity in tried):
        tried += [(axis, *_standing(sized, axis)) for axis in _TURNS if axis not in axes]
    best = max(range(len(tried)), key=lambda k: _rank(tried[k][2], tried[k][3], kind, -k))
    axis, moved, solid, cavity = tried[best]
    notes = [said]
    if up is None and mesh.up is not None and axis != mesh.up:
        notes.append(f"turned: {axis} of the file points up, since it is open there")
    elif up is None and mesh.up is None:
        notes.append(f"{axis} of the file points up: the format has no rule, and it stands best so")
    return Placed(moved, solid, cavity, axis, scale, tuple(notes))


def _scale(mesh: RawMesh, kind: Kind | None, where: str, size_m: float | None) -> tuple[float, str]:
    longest = float(np.ptp(mesh.bounds(), axis=0).max())
    if size_m is not None:
        return size_m / longest, f"longest side {100 * size_m:.3g} cm, as given"
    by_rule = mesh.unit_m
    low, high = (LEAST_M, MOST_M) if kind is None else (kind.low_m, kind.high_m)
    if by_rule is not None and low <= longest * by_rule <= high:
        return by_rule, f"longest side {100 * longest * by_rule:.3g} cm in the unit of the format"
    if kind is None:
        fits = [name for name, unit in UNITS_M.items() if 0.03 <= longest * unit <= 0.4]
        if by_rule is None and len(fits) == 1:
            unit = UNITS_M[fits[0]]
            return unit, f"longest side {100 * longest * unit:.3g} cm, read as {fits[0]}"
        problem = f"its longest side is {longest:.3g} units, and neither its name nor its format tells its size"
        raise InvalidInputError(where, problem, "Give --size-m, or --kind with a known kind")
    if by_rule is None:
        for name, unit in UNITS_M.items():
            if low <= longest * unit <= high:
                return unit, f"longest side {100 * longest * unit:.3g} cm, read as {name}"
    return kind.middle_m / longest, f"longest side set to {100 * kind.middle_m:.3g} cm, usual for a {kind.name}"


def _standing(mesh: RawMesh, axis: str) -> tuple[RawMesh, Solid, Cavity | None]:
    turn = np.eye(4)
    turn[:3, :3] = _TURNS[axis]
    moved = mesh.moved(turn)
    low, high = moved.bounds()
    shift = np.eye(4)
    shift[:3, 3] = [-0.5 * (low[0] + high[0]), -0.5 * (low[1] + high[1]), -low[2]]
    moved = moved.moved(shift)
    solid = solid_of(*moved.surface())
    return moved, solid, cavity_of(solid)


def _rank(solid: Solid, cavity: Cavity | None, kind: Kind | None, order: int) -> tuple[float, ...]:
    """Return how well an object stands so: open at the top if it should be, then on a broad base, then as listed."""
    water = 0.0
    if kind is not None and kind.is_open and cavity is not None:
        water = round(cavity.volume_m3 / max(float(np.prod(np.ptp(solid.points, axis=0))), 1e-12), 1)
    return water, round(footing(solid), 1), order


def footing(solid: Solid) -> float:
    """Return how broadly an object stands: the tilt at which it would fall over, as tan(angle)."""
    low = solid.points[:, 2] < solid.pitch_m
    base = solid.points[low][:, :2]
    if len(base) < 3:
        return 0.0
    middle = solid.centers(solid.cells).mean(axis=0)
    turns = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    directions = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    reach = ((base - middle[:2]) @ directions.T).max(axis=0).min()
    return float(max(reach, 0.0) / max(middle[2], 1e-6))
