"""Good meshes of unusual shapes with random dimensions, and faults that ``planted_faults.py`` does not plant."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import trimesh

from betterbench.sim.assets import Asset, CollisionPart, Texture, VisualPart
from betterbench.sim.assets.importing.measures import corners_of
from made_meshes import Rng, joined, turn_about

Shape = Callable[[Rng], trimesh.Trimesh]


def _moved(mesh: trimesh.Trimesh, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> trimesh.Trimesh:
    mesh.apply_translation([x, y, z])
    return mesh


def _rod(begin: tuple[float, float, float], end: tuple[float, float, float], radius: float) -> trimesh.Trimesh:
    return cast("trimesh.Trimesh", trimesh.creation.cylinder(radius, segment=[begin, end], sections=8))


def _hoop(radius: float, wire: float, z: float) -> trimesh.Trimesh:
    return _moved(trimesh.creation.torus(radius, wire, major_sections=32, minor_sections=6), z=z)


def _wire_basket(rng: Rng) -> trimesh.Trimesh:
    """Return a round basket of wires with gaps of about one centimeter."""
    radius, height, wire = rng.uniform(0.08, 0.1), rng.uniform(0.07, 0.1), 0.0015
    hoops = [_hoop(radius, wire, z) for z in np.linspace(wire, height, 8)]
    turns = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    posts = [
        _rod((radius * np.cos(t), radius * np.sin(t), wire), (radius * np.cos(t), radius * np.sin(t), height), wire)
        for t in turns
    ]
    bars = []
    for at in np.arange(-radius + 0.012, radius, 0.012):
        half = float(np.sqrt(radius**2 - at**2))
        bars += [_rod((at, -half, wire), (at, half, wire), wire), _rod((-half, at, wire), (half, at, wire), wire)]
    return joined([*hoops, *posts, *bars])


def _revolved(profile: list[tuple[float, float]], sections: int = 40) -> trimesh.Trimesh:
    return trimesh.creation.revolve(profile, sections=sections)


def _ladle(rng: Rng) -> trimesh.Trimesh:
    radius, length = rng.uniform(0.032, 0.04), rng.uniform(0.18, 0.24)
    turns = np.linspace(0.0, 0.5 * np.pi, 9)
    outer = [(radius * float(np.sin(t)), radius * (1.0 - float(np.cos(t)))) for t in turns]
    inner = [((radius - 0.003) * float(np.sin(t)), radius - (radius - 0.003) * float(np.cos(t))) for t in turns[::-1]]
    cup = _revolved([*outer, *inner])
    handle = _moved(
        cast("trimesh.Trimesh", trimesh.creation.box([length, 0.012, 0.006])), x=radius + 0.5 * length - 0.004
    )
    handle.apply_transform(turn_about(-rng.uniform(0.05, 0.12), [0, 1, 0]))
    return joined([cup, _moved(handle, z=radius - 0.004)])


def _colander(rng: Rng) -> trimesh.Trimesh:
    """Return a bowl with rows of holes in its wall."""
    radius, wall = rng.uniform(0.08, 0.11), 0.004
    sections, rows = 48, 12
    turns = np.linspace(0.0, 2.0 * np.pi, sections, endpoint=False)
    levels = np.linspace(0.25, 0.5 * np.pi, rows)
    vertices: list[tuple[float, float, float]] = []
    for r in (radius, radius - wall):
        for level in levels:
            for t in turns:
                ring = r * np.sin(level)
                vertices.append((ring * np.cos(t), ring * np.sin(t), radius - r * np.cos(level)))
    faces: list[tuple[int, int, int]] = []

    def index(shell: int, row: int, column: int) -> int:
        return shell * rows * sections + row * sections + column % sections

    def quad(a: int, b: int, c: int, d: int) -> None:
        faces.extend([(a, b, c), (a, c, d)])

    def is_hole(row: int, column: int) -> bool:
        return 0 <= row < rows - 1 and row in (2, 4, 6, 8) and column % 4 == 0

    for row in range(rows - 1):
        for column in range(sections):
            if not is_hole(row, column):
                o = [index(0, row, column), index(0, row, column + 1)]
                o += [index(0, row + 1, column + 1), index(0, row + 1, column)]
                quad(*o)
                quad(*[v + rows * sections for v in o[::-1]])
                continue
            around = [(row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column), (row, column)]
            for (r0, c0), (r1, c1) in itertools.pairwise(around):  # the wall around a hole
                quad(index(0, r0, c0), index(0, r1, c1), index(1, r1, c1), index(1, r0, c0))
    for column in range(sections):  # the rim
        quad(index(0, rows - 1, column), index(0, rows - 1, column + 1), *_pair(index, rows - 1, column))
    low = radius - radius * float(np.cos(levels[0]))
    foot = radius * float(np.sin(levels[0])) + 0.001
    base = _moved(trimesh.creation.cylinder(foot, wall + 0.002, sections=sections), z=low + 0.5 * wall - 0.001)
    mesh = joined([trimesh.Trimesh(vertices, faces, process=False), base])
    return _moved(mesh, z=-float(mesh.bounds[0, 2]))


def _pair(index: Callable[[int, int, int], int], row: int, column: int) -> tuple[int, int]:
    return index(1, row, column + 1), index(1, row, column)


def _thin_tray(rng: Rng) -> trimesh.Trimesh:
    x, y, t, lip = rng.uniform(0.24, 0.36), rng.uniform(0.16, 0.22), 0.003, rng.uniform(0.01, 0.015)
    parts = [_moved(trimesh.creation.box([x, y, t]), z=0.5 * t)]
    for s in (-1, 1):
        parts.append(_moved(trimesh.creation.box([t, y, lip]), x=s * 0.5 * (x - t), z=0.5 * lip))
        parts.append(_moved(trimesh.creation.box([x, t, lip]), y=s * 0.5 * (y - t), z=0.5 * lip))
    return joined(parts)


def _tall_vase(rng: Rng) -> trimesh.Trimesh:
    h, r, w = rng.uniform(0.24, 0.32), rng.uniform(0.03, 0.036), 0.004
    outer = [(0.0, 0.0), (0.9 * r, 0.0), (r, 0.25 * h), (0.6 * r, 0.75 * h), (0.75 * r, h)]
    inner = [(0.75 * r - w, h), (0.6 * r - w, 0.75 * h), (r - w, 0.25 * h), (0.9 * r - w, w), (0.0, w)]
    return _revolved([*outer, *inner])


def _ring(rng: Rng) -> trimesh.Trimesh:
    wire = rng.uniform(0.007, 0.012)
    return _moved(trimesh.creation.torus(rng.uniform(0.035, 0.06), wire, major_sections=40), z=wire)


def _chair(rng: Rng) -> trimesh.Trimesh:
    side, seat, back, leg = rng.uniform(0.055, 0.07), rng.uniform(0.05, 0.07), rng.uniform(0.06, 0.08), 0.008
    parts = [_moved(trimesh.creation.box([side, side, 0.008]), z=seat)]
    for sx in (-1, 1):
        for sy in (-1, 1):
            at = 0.5 * (side - leg)
            parts.append(_moved(trimesh.creation.box([leg, leg, seat]), x=sx * at, y=sy * at, z=0.5 * seat))
    parts.append(_moved(trimesh.creation.box([0.008, side, back]), x=-0.5 * side + 0.004, z=seat + 0.5 * back))
    return joined(parts)


def _bundle(rng: Rng) -> trimesh.Trimesh:
    """Return seven rods side by side in a hexagon, held by a band."""
    length, r = rng.uniform(0.13, 0.2), rng.uniform(0.006, 0.009)
    places = [(0.0, 0.0)] + [(2 * r * np.cos(t), 2 * r * np.sin(t)) for t in np.arange(6) * np.pi / 3.0]
    rods = [_rod((-0.5 * length, y, z), (0.5 * length, y, z), r) for y, z in places]
    band = trimesh.creation.annulus(2.9 * r, 3.15 * r, 0.02)
    band.apply_transform(turn_about(np.pi / 2, [0, 1, 0]))
    mesh = joined([*rods, band])
    return _moved(mesh, z=-float(mesh.bounds[0, 2]))


def _concave_lid(rng: Rng) -> trimesh.Trimesh:
    r, h, w = rng.uniform(0.06, 0.1), rng.uniform(0.02, 0.03), 0.004
    turns = np.linspace(0.0, 1.0, 8)
    outer = [(r * float(np.sqrt(1.0 - t**2)) if t < 1 else 0.0, h * float(t)) for t in turns]
    inner = [((r - w) * float(np.sqrt(1.0 - t**2)) if t < 1 else 0.0, (h - w) * float(t)) for t in turns[::-1]]
    knob = _moved(trimesh.creation.cylinder(0.011, 0.022, sections=24), z=h + 0.009)
    return joined([_revolved([*inner, *outer]), knob])


def _tube(rng: Rng) -> trimesh.Trimesh:
    r, h = rng.uniform(0.022, 0.034), rng.uniform(0.08, 0.13)
    return _moved(cast("trimesh.Trimesh", trimesh.creation.annulus(r - 0.004, r, h, sections=40)), z=0.5 * h)


def _star(rng: Rng) -> trimesh.Trimesh:
    r, t = rng.uniform(0.035, 0.048), rng.uniform(0.012, 0.018)
    turns = np.arange(10) * np.pi / 5.0
    reach = np.where(np.arange(10) % 2 == 0, r, 0.5 * r)
    corners = np.stack([reach * np.cos(turns), reach * np.sin(turns)], axis=1)
    low, high = np.column_stack([corners, np.zeros(10)]), np.column_stack([corners, np.full(10, t)])
    vertices = np.vstack([low, high, [[0.0, 0.0, 0.0], [0.0, 0.0, t]]])
    faces = []
    for k in range(10):
        n = (k + 1) % 10
        faces += [(20, n, k), (21, 10 + k, 10 + n), (k, n, 10 + n), (k, 10 + n, 10 + k)]
    return trimesh.Trimesh(vertices, faces)


def _long_chopstick(rng: Rng) -> trimesh.Trimesh:
    length, thick = rng.uniform(0.22, 0.27), rng.uniform(0.0085, 0.01)
    mesh = _revolved([(0.0, 0.0), (0.3 * thick, 0.0), (0.5 * thick, length), (0.0, length)], 12)
    mesh.apply_transform(turn_about(np.pi / 2, [0, 1, 0]))
    return _moved(mesh, z=-float(mesh.bounds[0, 2]))


ODD_SHAPES: dict[str, Shape] = {
    "ladle": _ladle,
    "colander": _colander,
    "thin tray": _thin_tray,
    "tall vase": _tall_vase,
    "ring": _ring,
    "toy chair": _chair,
    "bundle of sticks": _bundle,
    "pot lid": _concave_lid,
    "tube": _tube,
    "star cookie": _star,
    "chopstick": _long_chopstick,
    "wire basket": _wire_basket,
}
"""Unusual good shapes, with their generators [m], standing on z = 0."""


# ------------------------------------------------------------------------------------------ faults after the import


def _half_inverted(asset: Asset, rng: Rng) -> Asset:
    """Turn the triangles of one half around."""
    axis = int(rng.integers(2))

    def turned(part: VisualPart) -> VisualPart:
        middle = part.vertices[part.faces].mean(axis=1)[:, axis]
        faces = part.faces.copy()
        half = middle > 0.0
        faces[half] = faces[half][:, ::-1]
        texture = part.texture
        if texture is not None and texture.corners is not None:
            corners = texture.corners.copy()
            corners[half] = corners[half][:, ::-1]
            texture = replace(texture, corners=corners)
        return replace(part, faces=faces, texture=texture)

    return replace(asset, visual=tuple(map(turned, asset.visual)))


def _hull(points: np.ndarray, like: CollisionPart) -> CollisionPart:
    return CollisionPart("hull", (0.0, 0.0, 0.0), vertices=np.asarray(points, dtype=np.float32), friction=like.friction)


def _hulls_aside(asset: Asset, rng: Rng) -> Asset:
    turn = rng.uniform(0.0, 2.0 * np.pi)
    by = 0.02 * np.array([np.cos(turn), np.sin(turn), 0.0])
    return replace(asset, collision=tuple(_hull(corners_of(part) + by, part) for part in asset.collision))


def _bar_across(asset: Asset, rng: Rng) -> Asset:
    """Lay an invisible bar across an opening, beside its middle."""
    opening = asset.region("opening")
    x, y, z = opening.position
    half = opening.half_size[0]
    wide, off = rng.uniform(0.3, 0.5) * half, rng.uniform(-0.2, 0.2) * half
    corners = [
        (x + sx * half, y + off + sy * wide, z - 0.5 * depth)
        for sx in (-1, 1)
        for sy in (-1, 1)
        for depth in (0.0, 0.012)
    ]
    return replace(asset, collision=(*asset.collision, _hull(np.array(corners), asset.collision[0])))


def _inertia_times(asset: Asset, factor: float) -> Asset:
    a, b, c, d, e, f = (factor * v for v in asset.inertia)
    return replace(asset, inertia=(a, b, c, d, e, f))


def _in_grams(asset: Asset, rng: Rng) -> Asset:  # noqa: ARG001
    heavy = _inertia_times(asset, 1000.0)
    return replace(heavy, mass_kg=1000.0 * asset.mass_kg)


def _of_grams(asset: Asset, rng: Rng) -> Asset:  # noqa: ARG001
    light = _inertia_times(asset, 0.001)
    return replace(light, mass_kg=0.001 * asset.mass_kg)


def _box_inertia(asset: Asset, rng: Rng) -> Asset:  # noqa: ARG001
    """Give the inertia of the bounding box, 100 times too large."""
    x, y, z = asset.size_m
    m = 100.0 * asset.mass_kg / 12.0
    return replace(asset, inertia=(m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y), 0.0, 0.0, 0.0))


def _negative_inertia(asset: Asset, rng: Rng) -> Asset:
    values = list(asset.inertia)
    k = int(rng.integers(3))
    values[k] = -values[k]
    a, b, c, d, e, f = values
    return replace(asset, inertia=(a, b, c, d, e, f))


def _visible_spike(asset: Asset, rng: Rng) -> Asset:
    """Add a visible spike without a collision shape under the base."""
    long, at = rng.uniform(0.006, 0.02), 0.2 * np.array(asset.size_m[:2]) * rng.uniform(-1, 1, 2)
    cone = trimesh.creation.cone(0.005, long, sections=12)
    cone.apply_transform(turn_about(np.pi, [1, 0, 0]))
    cone.apply_translation([*at, 0.001])
    part = asset.visual[0]
    spike = VisualPart(
        "spike",
        np.asarray(cone.vertices, dtype=np.float32),
        np.asarray(cone.faces, dtype=np.int32),
        part.rgba,
        part.specular,
        part.shininess,
    )
    return replace(asset, visual=(*asset.visual, spike))


def _handle_untouched(asset: Asset, rng: Rng) -> Asset:  # noqa: ARG001
    """Remove the collision parts of a mug's handle."""
    opening = asset.region("opening")
    x, y, _ = opening.position
    reach = 1.2 * max(opening.half_size[:2])
    kept = []
    for part in asset.collision:
        middle = corners_of(part)[:, :2].mean(axis=0)
        if np.hypot(*(middle - (x, y))) < reach:
            kept.append(part)
    cut = []
    for part in kept:  # parts of the wall may reach into the handle
        corners = corners_of(part).copy()
        away = corners[:, :2] - (x, y)
        far = np.linalg.norm(away, axis=1)
        out = far > reach
        corners[out, :2] = (x, y) + away[out] * (reach / far[out])[:, None]
        cut.append(_hull(corners, part))
    return replace(asset, collision=tuple(cut))


def _wrong_friction(asset: Asset, rng: Rng) -> Asset:
    """Set the sliding friction much too low or much too high."""
    sliding = float(rng.choice([0.0, 0.01, 5.0, 50.0]))
    return replace(asset, collision=tuple(replace(part, friction=(sliding, 0.0, 0.0)) for part in asset.collision))


def _wide_grasp(asset: Asset, rng: Rng) -> Asset:
    """State grasps that are wider than the gripper opens."""
    wide = float(rng.uniform(0.085, 0.15))
    return replace(asset, grasps=tuple(replace(grasp, width_m=wide) for grasp in asset.grasps))


def _narrow_grasp(asset: Asset, rng: Rng) -> Asset:  # noqa: ARG001
    """State grasps as a third of their width."""
    return replace(asset, grasps=tuple(replace(g, width_m=g.width_m / 3.0, clearance_m=0.001) for g in asset.grasps))


def _wrong_picture(asset: Asset, rng: Rng) -> Asset:
    """Replace the texture by noise of another color, as if the files of two objects were swapped."""
    part = asset.visual[0]
    pixels = rng.integers(0, 255, (64, 64, 3)).astype(np.uint8)
    uv = rng.random((len(part.vertices), 2)).astype(np.float32)
    return replace(asset, visual=(replace(part, texture=Texture(pixels, uv)), *asset.visual[1:]))


ODD_ASSET_FAULTS: dict[str, Callable[[Asset, Rng], Asset]] = {
    "half of the faces inverted": _half_inverted,
    "collision parts 2 cm aside": _hulls_aside,
    "bar across the opening": _bar_across,
    "grams as kilograms": _in_grams,
    "kilograms as grams": _of_grams,
    "inertia of a box, 100 times": _box_inertia,
    "negative inertia": _negative_inertia,
    "visible spike under the base": _visible_spike,
    "handle without collision parts": _handle_untouched,
    "wrong friction": _wrong_friction,
    "grasp wider than the gripper": _wide_grasp,
    "grasp narrower than the object": _narrow_grasp,
    "texture of another object": _wrong_picture,
}
"""Faults that are planted in an asset after its import."""


# ----------------------------------------------------------------------------------------------- faults in the file


def sheet_with_hole(rng: Rng) -> trimesh.Trimesh:
    """Return a ring of triangles without a thickness."""
    r = rng.uniform(0.08, 0.12)
    turns = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    ring = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(32)])
    faces = []
    for k in range(32):
        n = (k + 1) % 32
        faces += [(k, n, 32 + n), (k, 32 + n, 32 + k)]
    return trimesh.Trimesh(np.vstack([0.4 * r * ring, r * ring]), faces, process=False)


def with_far_speck(mesh: trimesh.Trimesh, rng: Rng) -> trimesh.Trimesh:
    """Return a mesh with a cube of one millimeter far away."""
    size = float(np.ptp(mesh.bounds, axis=0).max())
    cube = _moved(cast("trimesh.Trimesh", trimesh.creation.box([0.001] * 3)), x=float(rng.uniform(1.5, 4.0)) * size)
    return joined([mesh, _moved(cube, z=float(rng.uniform(0.0, size)))])


def with_spike(mesh: trimesh.Trimesh, rng: Rng) -> trimesh.Trimesh:
    """Return a mesh with a spike under its base, beside the middle."""
    x, y = 0.5 * np.ptp(mesh.bounds, axis=0)[:2] * rng.uniform(0.2, 0.4) * rng.choice([-1, 1], 2)
    long = rng.uniform(0.012, 0.025)
    cone = trimesh.creation.cone(0.006, long + 0.002, sections=12)
    cone.apply_transform(turn_about(np.pi, [1, 0, 0]))
    return joined([mesh, _moved(cone, float(x), float(y), 0.002)])
