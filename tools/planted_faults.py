"""Faults that ``planted_assets.py`` plants in good assets, and the kinds of objects to which each fault applies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from betterbench.geometry import Pose, Vector, from_axis_angle, multiply
from betterbench.sim.assets import Asset, CollisionPart, Texture
from betterbench.sim.assets.importing.kinds import kind_of
from betterbench.sim.assets.importing.measures import corners_of
from made_meshes import SHAPES, Rng

Inertia = tuple[float, float, float, float, float, float]


def _vector(values: Iterable[float]) -> Vector:
    x, y, z = (float(v) for v in values)
    return x, y, z


def _times(inertia: Inertia, factor: float) -> Inertia:
    ixx, iyy, izz, ixy, ixz, iyz = (factor * v for v in inertia)
    return ixx, iyy, izz, ixy, ixz, iyz


def _six(matrix: np.ndarray) -> Inertia:
    ixx, iyy, izz, ixy, ixz, iyz = (float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    return ixx, iyy, izz, ixy, ixz, iyz


def _turned(asset: Asset, rotation: tuple[float, float, float]) -> Asset:
    """Return an asset rotated by a rotation vector [rad] and set back onto z = 0."""
    q = from_axis_angle(rotation)
    turn = np.array([Pose((0.0, 0.0, 0.0), q).apply(axis) for axis in np.eye(3).tolist()]).T
    corners = np.concatenate([part.vertices for part in asset.visual]) @ turn.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    shift = np.array([-0.5 * (low[0] + high[0]), -0.5 * (low[1] + high[1]), -low[2]])
    visual = tuple(replace(p, vertices=(p.vertices @ turn.T + shift).astype(np.float32)) for p in asset.visual)
    move = Pose(_vector(shift), q)

    def moved(part: CollisionPart) -> CollisionPart:
        if part.vertices is not None:
            return replace(part, vertices=(part.vertices @ turn.T + shift).astype(np.float32))
        return replace(part, position=move.apply(part.position), quaternion=multiply(q, part.quaternion))

    ixx, iyy, izz, ixy, ixz, iyz = asset.inertia
    inertia = turn @ np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]) @ turn.T
    return replace(
        asset,
        visual=visual,
        collision=tuple(map(moved, asset.collision)),
        size_m=_vector(high - low),
        center_of_mass=move.apply(asset.center_of_mass),
        inertia=_six(inertia),
        grasps=tuple(replace(g, pose=move @ g.pose) for g in asset.grasps),
        regions=tuple(replace(r, position=move.apply(r.position), quaternion=q) for r in asset.regions),
    )


def _scaled(asset: Asset, factors: tuple[float, float, float]) -> Asset:
    """Return an asset with stretched shape and regions and unchanged mass; hulls replace primitives."""
    s = np.array(factors)
    parts = tuple(
        CollisionPart("hull", (0.0, 0.0, 0.0), vertices=(corners_of(p) * s).astype(np.float32), friction=p.friction)
        for p in asset.collision
    )
    x, y, z = asset.center_of_mass
    return replace(
        asset,
        visual=tuple(replace(p, vertices=(p.vertices * s).astype(np.float32)) for p in asset.visual),
        collision=parts,
        size_m=_vector(np.array(asset.size_m) * s),
        center_of_mass=(x * s[0], y * s[1], z * s[2]),
        inertia=_times(asset.inertia, float((s**2).mean())),
        grasps=tuple(
            replace(
                g,
                width_m=g.width_m * float(s[:2].max()),
                pose=replace(g.pose, position=_vector(np.array(g.pose.position) * s)),
            )
            for g in asset.grasps
        ),
        regions=tuple(
            replace(
                r,
                position=_vector(np.array(r.position) * s),
                half_size=_vector(np.array(r.half_size) * s),
            )
            for r in asset.regions
        ),
    )


def _hull(points: np.ndarray, like: CollisionPart) -> CollisionPart:
    return CollisionPart("hull", (0.0, 0.0, 0.0), vertices=np.asarray(points, dtype=np.float32), friction=like.friction)


def _shifted(asset: Asset, by: tuple[float, float, float]) -> Asset:
    parts = tuple(_hull(corners_of(part) + by, part) for part in asset.collision)
    return replace(asset, collision=parts)


def _disc(center: Sequence[float], low: float, high: float, half_x: float, half_y: float) -> np.ndarray:
    x, y = center
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.stack([x + half_x * np.cos(turn), y + half_y * np.sin(turn)], axis=1)
    return np.concatenate([np.column_stack([ring, np.full(24, z)]) for z in (low, high)])


def _leaking(asset: Asset, rng: Rng) -> Asset:  # noqa: ARG001
    """Remove the parts on the vertical line through the middle of the opening."""
    inside = asset.region("inside")
    x, y = inside.position[:2]
    kept = []
    for part in asset.collision:
        corners = corners_of(part)
        low, high = corners.min(axis=0), corners.max(axis=0)
        if not (low[0] < x < high[0] and low[1] < y < high[1] and low[2] < inside.position[2]):
            kept.append(part)
    return replace(asset, collision=tuple(kept))


def _lid_closed(asset: Asset, rng: Rng) -> Asset:
    opening, inside = asset.region("opening"), asset.region("inside")
    x, y, z = opening.position
    low = z - rng.uniform(0.003, 0.006)
    if rng.random() < 0.3:  # the complete hollow is filled
        low = inside.position[2] - inside.half_size[2]
    lid = _hull(_disc((x, y), low, z, opening.half_size[0], opening.half_size[1]), asset.collision[0])
    return replace(asset, collision=(*asset.collision, lid))


def _center_outside(asset: Asset, rng: Rng) -> Asset:
    x, y, z = (0.5 * side for side in asset.size_m)
    turn, out = rng.uniform(0, 2 * np.pi), rng.uniform(1.3, 2.5)
    reach = out * math.hypot(x, y)
    return replace(asset, center_of_mass=(reach * math.cos(turn), reach * math.sin(turn), z))


def _too_heavy(asset: Asset, rng: Rng) -> Asset:
    factor = float(rng.uniform(15, 60))
    return replace(asset, mass_kg=asset.mass_kg * factor, inertia=_times(asset.inertia, factor))


def _too_wide(asset: Asset, rng: Rng) -> Asset:
    """Stretch the narrow side until the object does not fit a jaw; the longest side stays usual for the kind."""
    x, y, z = asset.size_m
    wide = float(rng.uniform(0.09, 0.11))
    wide = min(wide, 0.98 * max(x, y, z)) if max(x, y, z) > 0.085 else wide
    factors = (max(1.0, wide / x), max(1.0, wide / y), max(1.0, 0.05 / z))
    return replace(_scaled(asset, factors), grasps=())


def _wrong_grasps(asset: Asset, rng: Rng) -> Asset:
    reach = max(asset.size_m) + 0.05
    turn = rng.uniform(0, 2 * np.pi)
    by = (reach * math.cos(turn), reach * math.sin(turn), 0.0)
    return replace(asset, grasps=tuple(replace(g, pose=g.pose.translated(*by)) for g in asset.grasps))


def _jittering(asset: Asset, rng: Rng) -> Asset:
    how = rng.choice(["spike", "light", "rocker"])
    if how == "light":
        return replace(asset, inertia=_times(asset.inertia, 1e-4))
    x, y, _ = asset.size_m
    like = asset.collision[0]
    if how == "spike":
        around = np.array([[0, 0, 0], [0.004, 0, 0], [-0.004, 0, 0], [0, 0.004, 0]]) + np.array([0.3 * x, 0.3 * y, 0.0])
        around[:, 2] = (-rng.uniform(0.006, 0.012), 0.004, 0.004, 0.004)
        return replace(asset, collision=(*asset.collision, _hull(around, like)))
    depth = 0.25 * min(x, y)
    base = _disc((0.0, 0.0), 0.0, 0.002, 0.3 * x, 0.3 * y)
    return replace(asset, collision=(*asset.collision, _hull(np.vstack([base, [[0.0, 0.0, -depth]]]), like)))


def _far_parts(asset: Asset, rng: Rng) -> Asset:
    """Move a part, or the faces of one half, away from the rest."""
    away = float(rng.uniform(0.05, 0.2)) + max(asset.size_m)
    if len(asset.visual) > 1 and rng.random() < 0.5:
        part = asset.visual[-1]
        return replace(
            asset,
            visual=(*asset.visual[:-1], replace(part, vertices=part.vertices + np.array([away, 0, 0], np.float32))),
        )
    part = asset.visual[0]
    middle = np.median(part.vertices[:, 0])
    owners = part.vertices[part.faces][:, :, 0].mean(axis=1) > middle
    vertices = np.concatenate([part.vertices, part.vertices + np.array([away, 0, 0], np.float32)])
    faces = part.faces.copy()
    faces[owners] += len(part.vertices)
    texture = part.texture
    if texture is not None and texture.corners is None:
        texture = replace(texture, uv=np.concatenate([texture.uv, texture.uv]))
    return replace(asset, visual=(replace(part, vertices=vertices, faces=faces, texture=texture), *asset.visual[1:]))


def _missing_texture(asset: Asset, rng: Rng) -> Asset:
    part = asset.visual[0]
    how = rng.choice(["black", "magenta", "invisible", "coordinates"])
    if how == "invisible":
        parts = tuple(replace(p, rgba=(*p.rgba[:3], 0.0)) for p in asset.visual)
        return replace(asset, visual=parts)
    pixels = np.zeros((32, 32, 3), np.uint8)
    if how == "magenta":
        pixels[:] = (255, 0, 255)
    elif how == "coordinates":
        pixels[:] = rng.integers(0, 255, (32, 32, 3))
    uv = np.full((len(part.vertices), 2), 0.5, np.float32)
    if how != "coordinates":
        uv = rng.random((len(part.vertices), 2)).astype(np.float32)
    return replace(asset, visual=(replace(part, texture=Texture(pixels, uv)), *asset.visual[1:]))


def _degenerate(asset: Asset, rng: Rng) -> Asset:
    part = asset.visual[int(np.argmax([len(p.faces) for p in asset.visual]))]
    others = tuple(p for p in asset.visual if p is not part)
    if rng.random() < 0.3:
        vertices = part.vertices.copy()
        vertices[rng.integers(len(vertices))] = np.nan
        return replace(asset, visual=(replace(part, vertices=vertices), *others))
    faces = part.faces.copy()
    share = rng.uniform(0.15, 0.5) * asset.face_count / len(part.faces)
    which = rng.choice(len(faces), min(len(faces), max(1, round(share * len(faces)))), replace=False)
    faces[which, 2] = faces[which, 1]
    return replace(asset, visual=(replace(part, faces=faces), *others))


def _sinking(asset: Asset, rng: Rng) -> Asset:
    return _shifted(asset, (0.0, 0.0, float(rng.choice([-1, 1]) * rng.uniform(0.006, 0.02))))


def _fat(asset: Asset, rng: Rng) -> Asset:
    """Make the collision parts extend beyond the sides."""
    factor = 1.0 + max(0.3, 2.0 * 0.012 / min(asset.size_m[:2])) * float(rng.uniform(1.0, 1.5))
    parts = tuple(_hull(corners_of(part) * (factor, factor, 1.0), part) for part in asset.collision)
    return replace(asset, collision=parts)


def _thin(asset: Asset, rng: Rng) -> Asset:
    """Make the collision parts cover only half of the object."""
    share = float(rng.uniform(0.3, 0.5))
    x, y, _ = asset.size_m
    parts = tuple(
        _hull(corners_of(part) * ((share, 1, 1) if x > y else (1, share, 1)), part) for part in asset.collision
    )
    return replace(asset, collision=parts)


def _inverted(asset: Asset, rng: Rng) -> Asset:  # noqa: ARG001
    def flipped(texture: Texture | None) -> Texture | None:
        if texture is None or texture.corners is None:
            return texture
        return replace(texture, corners=np.ascontiguousarray(texture.corners[:, ::-1]))

    parts = tuple(
        replace(p, faces=np.ascontiguousarray(p.faces[:, ::-1]), texture=flipped(p.texture)) for p in asset.visual
    )
    return replace(asset, visual=parts)


def _unlicensed(asset: Asset, rng: Rng) -> Asset:  # noqa: ARG001
    return replace(asset, license="unknown")


def _scale(factor: float) -> Callable[[Asset, Rng], Asset]:
    def plant(asset: Asset, rng: Rng) -> Asset:
        f = factor if rng.random() < 0.5 else 1.0 / factor
        kind = kind_of(str(asset.parameters.get("kind", "")))
        if kind is not None and kind.low_m <= f * max(asset.size_m) <= kind.high_m:
            f = 1.0 / f  # in the other direction, the size would be unusual for the kind
        return _scaled(asset, (f, f, f))

    return plant


ASSET_FAULTS: dict[str, Callable[[Asset, Rng], Asset]] = {
    "scale x10": _scale(10.0),
    "scale x2.54": _scale(2.54),
    "scale x1000": _scale(1000.0),
    "upside down": lambda asset, _: _turned(asset, (math.pi, 0.0, 0.0)),
    "on its side": lambda asset, rng: _turned(asset, (0.5 * math.pi * rng.choice([-1, 1]), 0.0, 0.0)),
    "inverted faces": _inverted,
    "leaking": _leaking,
    "lid closed": _lid_closed,
    "center of mass outside": _center_outside,
    "too heavy": _too_heavy,
    "too wide": _too_wide,
    "wrong grasps": _wrong_grasps,
    "jittering": _jittering,
    "far parts": _far_parts,
    "missing texture": _missing_texture,
    "degenerate faces": _degenerate,
    "sinking": _sinking,
    "fat collision": _fat,
    "thin collision": _thin,
    "no license": _unlicensed,
}
"""Faults that are planted in an asset after its import."""

FILE_FAULTS = (
    "upside down",
    "on its side",
    "inverted faces",
    "leaking",
    "far parts",
    "wrong size given",
    "wrong axis given",
)
"""Faults planted in a file or in its import options, for a mesh that this script makes."""

OPEN_KINDS = frozenset({"mug", "bowl", "glass", "lunchbox"})
ONE_END_UP = frozenset({"bottle", "jar", "plate"})
"""Further kinds with a wrong end; a can or a notebook may be turned over."""
VICTIMS: dict[str, frozenset[str]] = {
    "upside down": OPEN_KINDS | {"bottle", "jar"},
    "on its side": OPEN_KINDS | {"bottle", "jar", "can", "plate", "notebook"},
    "leaking": OPEN_KINDS,
    "lid closed": OPEN_KINDS,
    "too wide": frozenset({"marker", "sausage", "spoon", "fork", "candle", "banana"}),
    "wrong grasps": frozenset(
        {"mug", "glass", "bottle", "jar", "can", "block", "marker", "candle", "soap", "orange", "box"}
    ),
    "wrong axis given": OPEN_KINDS | {"bottle", "can", "jar", "plate", "notebook"},
    "scale x10": frozenset(SHAPES),
    "scale x2.54": frozenset({"mug", "glass", "can", "jar", "block", "marker", "soap", "orange", "spoon", "candle"}),
    "scale x1000": frozenset(SHAPES),
}
"""Kinds to which a fault applies: an orange has no wrong side up, and a box may be 2.54 times as large."""
