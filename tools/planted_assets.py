"""Plant faults in assets and measure how many the importer and the asset certificate let through.

    .venv/bin/python tools/planted_assets.py --seed 0 --out runs/planted [--meshes FOLDER]            # make the items
    .venv/bin/python tools/planted_assets.py --seed 0 --out runs/planted [--meshes FOLDER] --measure  # and measure

Good assets are meshes that this script makes, assets of the procedural library and, if given, meshes of a folder (``*.glb``, and
``NAME/*.obj``). A bad asset is a good one with one fault, planted in the file, in the options of the import, or in the asset after
the import. The plan is ``plan.json``; each result is a line of ``journal.jsonl``, and the same command goes on after an interruption.

False accepts are bad assets that the importer made and the certificate passed. A fault of a file that the importer mends leaves a
good asset: whether it did is told from the known size, up axis and volume of the original, and these items are listed
separately. Accepted assets are dropped once more, in a simulation of this script, to tell whether they lie still.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import hashlib
import json
import math
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
import trimesh
from PIL import Image

from betterbench.errors import BetterError
from betterbench.geometry import Pose, from_axis_angle, multiply
from betterbench.jobs import LineJournal, in_processes, run_items, write_durably
from betterbench.sim.asset_checks import certify_asset
from betterbench.sim.assets import Asset, CollisionPart, Texture, build
from betterbench.sim.assets.authoring.registry import asset_of
from betterbench.sim.assets.importing.child import VERSION
from betterbench.sim.assets.importing.importer import Imported, Wishes, import_mesh
from betterbench.sim.assets.importing.kinds import Kind, kind_of
from betterbench.sim.assets.importing.measures import corners_of
from betterbench.sim.assets.importing.stored import from_bytes, to_bytes
from betterbench.sim.robots.physics import PHYSICS
from betterbench.sim.scenes import add_asset

Rng = np.random.Generator


# ---------------------------------------------------------------------------------------------------------- good meshes


def _revolved(profile: list[tuple[float, float]], rng: Rng) -> trimesh.Trimesh:
    return trimesh.creation.revolve(profile, sections=int(rng.choice([24, 32, 48, 64])))


def _cup(radius: float, height: float, wall: float, rng: Rng, *, foot: float = 1.0) -> trimesh.Trimesh:
    r, f, w = radius, radius * foot, wall
    profile = [(0, 0), (f, 0), (r, height), (r - w, height), (f - w, w), (0, w)]
    return _revolved(profile, rng)


def _mug(rng: Rng) -> trimesh.Trimesh:
    height, wall = rng.uniform(0.085, 0.11), rng.uniform(0.003, 0.005)
    radius = rng.uniform(0.033, 0.042)
    ring = trimesh.creation.torus(0.3 * height, 0.006, major_sections=24, minor_sections=12)
    ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    ring.apply_translation([radius, 0, 0.5 * height])
    ring.update_faces(ring.triangles_center[:, 0] > radius - 0.7 * wall)  # the other half would stand in the mug
    ring.remove_unreferenced_vertices()
    return trimesh.util.concatenate([_cup(radius, height, wall, rng), ring])


def _bowl(rng: Rng) -> trimesh.Trimesh:
    radius = rng.uniform(0.06, 0.11)
    return _cup(radius, radius * rng.uniform(0.5, 0.75), rng.uniform(0.004, 0.006), rng, foot=rng.uniform(0.5, 0.7))


def _glass(rng: Rng) -> trimesh.Trimesh:
    return _cup(rng.uniform(0.03, 0.037), rng.uniform(0.09, 0.15), rng.uniform(0.003, 0.004), rng, foot=rng.uniform(0.8, 1.0))


def _bottle(rng: Rng) -> trimesh.Trimesh:
    height, radius = rng.uniform(0.17, 0.28), rng.uniform(0.028, 0.036)
    neck = rng.uniform(0.35, 0.5) * radius
    return _revolved([(0, 0), (radius, 0), (radius, 0.6 * height), (neck, 0.8 * height), (neck, height), (0, height)], rng)


def _jar(rng: Rng) -> trimesh.Trimesh:
    height, radius = rng.uniform(0.08, 0.14), rng.uniform(0.028, 0.036)
    return _revolved([(0, 0), (radius, 0), (radius, 0.8 * height), (0.8 * radius, 0.85 * height), (0.8 * radius, height), (0, height)], rng)


def _can(rng: Rng) -> trimesh.Trimesh:
    height, radius = rng.uniform(0.08, 0.13), rng.uniform(0.028, 0.036)
    return _revolved([(0, 0), (radius, 0), (radius, height), (0, height)], rng)


def _plate(rng: Rng) -> trimesh.Trimesh:
    r, t = rng.uniform(0.07, 0.12), 0.004
    lip = rng.uniform(0.012, 0.02)
    return _revolved([(0, 0), (0.7 * r, 0), (r, lip), (r - t, lip), (0.68 * r, t), (0, t)], rng)


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Callable[[Rng], trimesh.Trimesh]:
    def make(rng: Rng) -> trimesh.Trimesh:
        sides = rng.uniform(low, high)
        mesh = trimesh.creation.box(sides)
        mesh.apply_translation([0, 0, 0.5 * sides[2]])
        return mesh

    return make


def _tray(low: float, high: float, wall_height: tuple[float, float]) -> Callable[[Rng], trimesh.Trimesh]:
    def make(rng: Rng) -> trimesh.Trimesh:
        x, y, z, t = rng.uniform(low, high), rng.uniform(0.6, 0.9), rng.uniform(*wall_height), 0.005
        y = x * y
        parts = [((x, y, t), (0, 0, t / 2))]
        for s in (-1, 1):
            parts += [((t, y, z), (s * (x - t) / 2, 0, z / 2)), ((x, t, z), (0, s * (y - t) / 2, z / 2))]
        made = []
        for size, at in parts:
            part = trimesh.creation.box(size)
            part.apply_translation(at)
            made.append(part)
        return trimesh.util.concatenate(made)

    return make


def _rod(length: tuple[float, float], radius: tuple[float, float], *, lies: bool) -> Callable[[Rng], trimesh.Trimesh]:
    def make(rng: Rng) -> trimesh.Trimesh:
        h, r = rng.uniform(*length), rng.uniform(*radius)
        mesh = trimesh.creation.cylinder(r, h, sections=24)
        if lies:
            mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
        mesh.apply_translation([0, 0, r if lies else 0.5 * h])
        return mesh

    return make


def _ball(rng: Rng) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=rng.uniform(0.03, 0.036))
    mesh.apply_scale([1.0, rng.uniform(0.9, 1.0), rng.uniform(0.85, 0.95)])
    mesh.apply_translation([0, 0, -mesh.bounds[0, 2]])
    return mesh


def _spoon(rng: Rng) -> trimesh.Trimesh:
    length = rng.uniform(0.14, 0.2)
    handle = trimesh.creation.box([0.7 * length, 0.011, 0.009])
    handle.apply_translation([-0.15 * length, 0, 0.0045])
    head = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    head.apply_scale([0.19 * length, 0.017, 0.006])
    head.apply_translation([0.31 * length, 0, 0.006])
    return trimesh.util.concatenate([handle, head])


SHAPES: dict[str, Callable[[Rng], trimesh.Trimesh]] = {
    "mug": _mug,
    "bowl": _bowl,
    "glass": _glass,
    "bottle": _bottle,
    "jar": _jar,
    "can": _can,
    "plate": _plate,
    "block": _box((0.04, 0.035, 0.03), (0.07, 0.06, 0.05)),
    "box": _box((0.12, 0.06, 0.05), (0.2, 0.07, 0.08)),
    "notebook": _box((0.16, 0.12, 0.012), (0.24, 0.18, 0.025)),
    "soap": _box((0.07, 0.045, 0.02), (0.1, 0.06, 0.03)),
    "tray": _tray(0.22, 0.4, (0.025, 0.05)),
    "lunchbox": _tray(0.15, 0.24, (0.05, 0.09)),
    "marker": _rod((0.11, 0.17), (0.008, 0.011), lies=True),
    "sausage": _rod((0.1, 0.2), (0.012, 0.018), lies=True),
    "candle": _rod((0.07, 0.14), (0.022, 0.035), lies=False),
    "orange": _ball,
    "spoon": _spoon,
}
"""Kinds that this script makes, with their generators [m], standing on z = 0."""

LIBRARY = {
    "apple": "apple", "orange": "orange", "lemon": "lemon", "block": "block", "can": "can", "mug": "mug", "tumbler": "glass",
    "fork": "fork", "spoon": "spoon", "stapler": "stapler", "soap_bar": "soap", "salt_shaker": "shaker", "speaker": "speaker",
    "keyboard": "keyboard", "serving_plate": "plate", "place_plate": "plate", "bun_bottom": "bread", "sauce_cup": "cup",
    "cheese_slice": "cheese", "drawer_cabinet": "", "lower_drawer": "", "coffee_machine": "", "spice_rack": "", "round_block": "block",
}  # fmt: skip
"""Categories of the procedural library, with the kind that a user would name."""


def _painted(mesh: trimesh.Trimesh, rng: Rng) -> trimesh.Trimesh:
    color = [int(v) for v in rng.integers(60, 230, 3)]
    if rng.random() < 0.5:
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=[*color, 255])
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
        return mesh
    noise = np.clip(np.array(color) + rng.integers(-30, 30, (64, 64, 3)), 0, 255).astype(np.uint8)
    uv = (mesh.vertices[:, :2] - mesh.bounds[0, :2]) / np.ptp(mesh.bounds, axis=0)[:2]
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(noise))
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return mesh


def write_mesh(mesh: trimesh.Trimesh, path: Path, rng: Rng) -> str:
    """Write a mesh that stands on z = 0 in meters, and return the axis of the file that points up."""
    mesh = mesh.copy()
    if path.suffix == ".glb":
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
        _painted(mesh, rng)
    elif path.suffix == ".stl":
        mesh.apply_scale(1000.0)
    elif path.suffix == ".ply":
        mesh.visual.vertex_colors = np.tile([*rng.integers(60, 230, 3), 255], (len(mesh.vertices), 1))
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh.export(path)
    return "y" if path.suffix == ".glb" else "z"


# --------------------------------------------------------------------------------------------------------------- faults


def _turned(asset: Asset, rotation: tuple[float, float, float]) -> Asset:
    """Return an asset turned by a rotation vector [rad] and set back onto z = 0."""
    q = from_axis_angle(rotation)
    turn = np.array([Pose((0.0, 0.0, 0.0), q).apply(axis) for axis in np.eye(3).tolist()]).T
    corners = np.concatenate([part.vertices for part in asset.visual]) @ turn.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    shift = np.array([-0.5 * (low[0] + high[0]), -0.5 * (low[1] + high[1]), -low[2]])
    visual = tuple(replace(p, vertices=(p.vertices @ turn.T + shift).astype(np.float32)) for p in asset.visual)
    move = Pose(tuple(shift.tolist()), q)

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
        size_m=tuple((high - low).tolist()),
        center_of_mass=move.apply(asset.center_of_mass),
        inertia=tuple(float(inertia[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))),
        grasps=tuple(replace(g, pose=move @ g.pose) for g in asset.grasps),
        regions=tuple(replace(r, position=move.apply(r.position), quaternion=q) for r in asset.regions),
    )


def _scaled(asset: Asset, factors: tuple[float, float, float]) -> Asset:
    """Return an asset with its shape and places stretched, its mass unchanged; hulls take the place of primitives."""
    s = np.array(factors)
    parts = tuple(
        CollisionPart("hull", (0.0, 0.0, 0.0), vertices=(corners_of(p) * s).astype(np.float32), friction=p.friction)
        for p in asset.collision
    )
    x, y, z = asset.center_of_mass
    i = np.array(asset.inertia) * float((s**2).mean())
    return replace(
        asset,
        visual=tuple(replace(p, vertices=(p.vertices * s).astype(np.float32)) for p in asset.visual),
        collision=parts,
        size_m=tuple((np.array(asset.size_m) * s).tolist()),
        center_of_mass=(x * s[0], y * s[1], z * s[2]),
        inertia=tuple(i.tolist()),
        grasps=tuple(
            replace(g, width_m=g.width_m * float(s[:2].max()), pose=replace(g.pose, position=tuple((np.array(g.pose.position) * s).tolist())))
            for g in asset.grasps
        ),
        regions=tuple(
            replace(r, position=tuple((np.array(r.position) * s).tolist()), half_size=tuple((np.array(r.half_size) * s).tolist()))
            for r in asset.regions
        ),
    )


def _hull(points: np.ndarray, like: CollisionPart) -> CollisionPart:
    return CollisionPart("hull", (0.0, 0.0, 0.0), vertices=np.asarray(points, dtype=np.float32), friction=like.friction)


def _shifted(asset: Asset, by: tuple[float, float, float]) -> Asset:
    parts = tuple(_hull(corners_of(part) + by, part) for part in asset.collision)
    return replace(asset, collision=parts)


def _disc(x: float, y: float, low: float, high: float, half_x: float, half_y: float) -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.stack([x + half_x * np.cos(turn), y + half_y * np.sin(turn)], axis=1)
    return np.concatenate([np.column_stack([ring, np.full(24, z)]) for z in (low, high)])


def _leaking(asset: Asset, rng: Rng) -> Asset:  # noqa: ARG001
    """Take away the parts that a plumb line through the middle of the opening meets."""
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
    if rng.random() < 0.3:  # the whole hollow is filled
        low = inside.position[2] - inside.half_size[2]
    lid = _hull(_disc(x, y, low, z, opening.half_size[0], opening.half_size[1]), asset.collision[0])
    return replace(asset, collision=(*asset.collision, lid))


def _center_outside(asset: Asset, rng: Rng) -> Asset:
    x, y, z = (0.5 * side for side in asset.size_m)
    turn, out = rng.uniform(0, 2 * np.pi), rng.uniform(1.3, 2.5)
    reach = out * math.hypot(x, y)
    return replace(asset, center_of_mass=(reach * math.cos(turn), reach * math.sin(turn), z))


def _too_heavy(asset: Asset, rng: Rng) -> Asset:
    factor = float(rng.uniform(15, 60))
    return replace(asset, mass_kg=asset.mass_kg * factor, inertia=tuple(v * factor for v in asset.inertia))


def _too_wide(asset: Asset, rng: Rng) -> Asset:
    """Stretch what is narrow until no jaw takes it; the longest side stays usual for the kind."""
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
        return replace(asset, inertia=tuple(v * 1e-4 for v in asset.inertia))
    x, y, z = asset.size_m
    like = asset.collision[0]
    if how == "spike":
        point = np.array([[0.3 * x, 0.3 * y, -rng.uniform(0.006, 0.012)], [0.3 * x + 0.004, 0.3 * y, 0.004], [0.3 * x - 0.004, 0.3 * y, 0.004],
                          [0.3 * x, 0.3 * y + 0.004, 0.004]])  # fmt: skip
        return replace(asset, collision=(*asset.collision, _hull(point, like)))
    depth = 0.25 * min(x, y)
    base = _disc(0.0, 0.0, 0.0, 0.002, 0.3 * x, 0.3 * y)
    return replace(asset, collision=(*asset.collision, _hull(np.vstack([base, [[0.0, 0.0, -depth]]]), like)))


def _far_parts(asset: Asset, rng: Rng) -> Asset:
    """Move a part, or the faces of one half, away."""
    away = float(rng.uniform(0.05, 0.2)) + max(asset.size_m)
    if len(asset.visual) > 1 and rng.random() < 0.5:
        part = asset.visual[-1]
        return replace(asset, visual=(*asset.visual[:-1], replace(part, vertices=part.vertices + np.float32([away, 0, 0]))))
    part = asset.visual[0]
    middle = np.median(part.vertices[:, 0])
    owners = part.vertices[part.faces][:, :, 0].mean(axis=1) > middle
    vertices = np.concatenate([part.vertices, part.vertices + np.float32([away, 0, 0])])
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
    """Let the collision parts stand out to the sides."""
    factor = 1.0 + max(0.3, 2.0 * 0.012 / min(asset.size_m[:2])) * float(rng.uniform(1.0, 1.5))
    parts = tuple(_hull(corners_of(part) * (factor, factor, 1.0), part) for part in asset.collision)
    return replace(asset, collision=parts)


def _thin(asset: Asset, rng: Rng) -> Asset:
    """Let the collision parts cover half of the object only."""
    share = float(rng.uniform(0.3, 0.5))
    x, y, _ = asset.size_m
    parts = tuple(_hull(corners_of(part) * ((share, 1, 1) if x > y else (1, share, 1)), part) for part in asset.collision)
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
            f = 1.0 / f  # the other way the size is not one of its kind
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

FILE_FAULTS = ("upside down", "on its side", "inverted faces", "leaking", "far parts", "wrong size given", "wrong axis given")
"""Faults that are planted in the file or in the options of the import of a mesh that this script makes."""

_OPEN = frozenset({"mug", "bowl", "glass", "lunchbox"})
_VICTIMS: dict[str, frozenset[str]] = {
    "upside down": _OPEN | {"bottle", "jar"},
    "on its side": _OPEN | {"bottle", "jar", "can", "plate", "notebook"},
    "leaking": _OPEN,
    "lid closed": _OPEN,
    "too wide": frozenset({"marker", "sausage", "spoon", "fork", "candle", "banana"}),
    "wrong grasps": frozenset({"mug", "glass", "bottle", "jar", "can", "block", "marker", "candle", "soap", "orange", "box"}),
    "wrong axis given": _OPEN | {"bottle", "can", "jar", "plate", "notebook"},
    "scale x10": frozenset(SHAPES),
    "scale x2.54": frozenset({"mug", "glass", "can", "jar", "block", "marker", "soap", "orange", "spoon", "candle"}),
    "scale x1000": frozenset(SHAPES),
}
"""Kinds in which a fault is a fault: an orange upside down is an orange, and a box may be 2.54 times as large."""


# ----------------------------------------------------------------------------------------------------------------- plan


@dataclass(frozen=True)
class Item:
    """One asset to be judged.

    Attributes:
        id: Its number and name.
        origin: "made", "library" or "mesh".
        name: Name that a user would give; tells the kind.
        file: Mesh file, or category and look of the library.
        fault: Planted fault, None for a good one.
        stage: Where it is planted: "file" or "asset".
        size_m: True longest side, None if it is not known.
        up: True up axis of the file, None if it is not known.
        wishes: Options of the import.
        seed: Of the fault.
    """

    id: str
    origin: str
    name: str
    file: str
    fault: str | None
    stage: str
    size_m: float | None
    up: str | None
    wishes: tuple[tuple[str, object], ...]
    seed: int


def make_plan(seed: int, out: Path, meshes: Path | None, *, each: int = 4) -> list[Item]:
    """Write the mesh files and return the items.

    There are ``each`` bad ones per fault of an asset, half as many per fault of a file, and as many good ones. The victims
    of the faults of assets are good items.
    """
    rng = np.random.default_rng([seed, 45])
    faults = [fault for fault in ASSET_FAULTS for _ in range(each)]
    of_files = [fault for fault in FILE_FAULTS for _ in range(max(1, each // 2))]
    good = _good_items(len(faults) + len(of_files), rng, out, meshes)
    items = list(good)
    for fault in faults:
        able = [item for item in good if _is_victim(item, fault)]
        victim = able[int(rng.integers(len(able)))]
        items.append(replace(victim, id=_id(len(items), fault, victim.name), fault=fault, stage="asset", seed=_seed(rng)))
    for fault in of_files:
        items.append(_bad_file(len(items), fault, rng, out))
    return items


def _id(number: int, fault: str | None, name: str) -> str:
    return f"{number:03d} {'good' if fault is None else fault} {name or 'asset'}"


def _seed(rng: Rng) -> int:
    return int(rng.integers(2**31))


def _is_victim(item: Item, fault: str) -> bool:
    if fault in _VICTIMS:
        return item.origin == "made" and item.name in _VICTIMS[fault]
    return fault != "too heavy" or kind_of(item.name) is not None


def _good_items(count: int, rng: Rng, out: Path, meshes: Path | None) -> list[Item]:
    """Return good items: two of each made kind at least, a fifth from the library, and meshes of the folder."""
    folder = [] if meshes is None else sorted([*meshes.glob("**/*.glb"), *meshes.glob("**/*.obj")])
    from_library = count // 5
    from_folder = min(len(folder), max(0, count - from_library - 2 * len(SHAPES)))
    items: list[Item] = []
    for k in rng.permutation(len(folder))[:from_folder]:
        file = folder[int(k)]
        name = file.parent.name if file.suffix == ".obj" else file.stem
        wishes = (("name", name), ("license", "as its folder states"))
        items.append(Item(_id(len(items), None, name), "mesh", name, str(file), None, "file", None, None, wishes, _seed(rng)))
    categories = sorted(LIBRARY)
    for k in range(from_library):
        category = categories[k % len(categories)]
        file_and_look = f"{category} {int(rng.integers(8))}"
        items.append(
            Item(_id(len(items), None, category), "library", LIBRARY[category], file_and_look, None, "file", None, None, (), _seed(rng))
        )
    kinds = sorted(SHAPES)
    while len(items) < count:
        items.append(_made(len(items), kinds[len(items) % len(kinds)], None, rng, out))
    return items


def _bad_file(number: int, fault: str, rng: Rng, out: Path) -> Item:
    victims = sorted((_VICTIMS.get(fault) or frozenset(SHAPES)) & set(SHAPES))
    return _made(number, str(rng.choice(victims)), fault, rng, out)


def _made(number: int, kind: str, fault: str | None, rng: Rng, out: Path) -> Item:
    """Write a mesh of this script, perhaps with a fault in the file or in the options of its import."""
    mesh = SHAPES[kind](rng)
    size = float(np.ptp(mesh.bounds, axis=0).max())
    suffix = str(rng.choice([".glb", ".stl", ".ply"]))
    wishes: dict[str, object] = {"name": kind, "license": "CC0-1.0"}
    if fault is not None:
        mesh, more = _file_fault(mesh, fault, size, rng)
        wishes |= more
    path = out / "meshes" / f"{number:03d}-{kind}{suffix}"
    up = write_mesh(mesh, path, rng)
    if fault == "wrong axis given":
        wishes["up"] = "-" + up if kind in _OPEN else "x"
    elif suffix != ".glb" and fault not in ("upside down", "on its side"):
        wishes["up"] = up  # these formats do not tell it
    return Item(
        _id(number, fault, kind), "made", kind, str(path.relative_to(out)), fault, "file", size, up, tuple(wishes.items()), _seed(rng)
    )


def _file_fault(mesh: trimesh.Trimesh, fault: str, size: float, rng: Rng) -> tuple[trimesh.Trimesh, dict[str, object]]:
    """Return a mesh with a fault, and options of the import that go with it."""
    mesh = mesh.copy()
    if fault == "upside down":
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0]))
    elif fault == "on its side":
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    elif fault == "inverted faces":
        mesh.invert()
    elif fault == "leaking":
        low = mesh.bounds[0, 2]
        centers = mesh.triangles_center
        floor = (np.abs(mesh.face_normals[:, 2]) > 0.9) & (centers[:, 2] < low + 0.01)
        mesh.update_faces(~floor)
    elif fault == "far parts":
        other = mesh.copy()
        other.apply_translation([1.5 * size, 0.0, 0.0])
        mesh = trimesh.util.concatenate([mesh, other])
    elif fault == "wrong size given":
        return mesh, {"size_m": size * float(rng.choice([10.0, 0.1, 1000.0, 4.0, 0.25]))}
    return mesh, {}


# -------------------------------------------------------------------------------------------------------------- measure


@dataclass(frozen=True)
class Judged:
    """Result of one item.

    Attributes:
        outcome: "refused" by the importer, "rejected" by the certificate, or "accepted".
        failed: Names of the failed checks, or the message of the importer.
        mended: Whether the importer made a good asset of a bad file.
        still: Whether an accepted asset lies still in a simulation of this script.
    """

    id: str
    fault: str | None
    stage: str
    origin: str
    outcome: str
    failed: list[str]
    mended: bool
    still: bool | None


def judge(item: Item, *, out: Path) -> Judged:
    """Import and certify one item of a folder."""
    rng = np.random.default_rng(item.seed)
    kind = kind_of(item.name)
    mended = False
    try:
        if item.origin == "library":
            category, look = item.file.split()
            asset = build(category, look=int(look))
        else:
            wishes = Wishes(**dict(item.wishes))  # type: ignore[arg-type]
            asset = asset_of(_imported(out / item.file, wishes, out / "imports").draft, "planted", color="gray")
            mended = item.stage == "file" and _is_mended(item, asset)
    except BetterError as error:
        return Judged(item.id, item.fault, item.stage, item.origin, "refused", [str(error)], False, None)
    if item.fault is not None and item.stage == "asset":
        asset = ASSET_FAULTS[item.fault](asset, rng)
    certificate = certify_asset(asset, name=item.id, kind=kind)
    failed = [f"{check.name}: {check.sentence}" for check in certificate.failed]
    outcome = "rejected" if failed else "accepted"
    still = lies_still(asset, rng) if outcome == "accepted" else None
    return Judged(item.id, item.fault, item.stage, item.origin, outcome, failed, mended, still)


def _imported(file: Path, wishes: Wishes, kept: Path) -> Imported:
    """Import a file in this process, or take what an earlier item made of it."""
    key = hashlib.sha256(f"{VERSION} {file} {wishes}".encode() + file.read_bytes()).hexdigest()[:24]
    stored = kept / f"{key}.npz"
    if not stored.is_file():
        kept.mkdir(parents=True, exist_ok=True)
        write_durably(stored, to_bytes(import_mesh(file, wishes)))
    return from_bytes(stored.read_bytes(), file.name)


def _is_mended(item: Item, asset: Asset) -> bool:
    """Tell whether the import of a bad file is a good asset, from what is known about the original."""
    if item.fault in ("leaking", "far parts"):
        return False
    if item.fault == "inverted faces":
        part = asset.visual[0]
        return bool(trimesh.Trimesh(part.vertices, part.faces).volume > 0.0)
    if item.fault == "wrong size given":
        return False
    expected = {"upside down": {"y": "-y", "z": "-z"}, "on its side": {"y": "z", "z": "y"}}.get(str(item.fault), {})
    found = str(asset.parameters["up"])
    if item.fault == "on its side":
        return found.lstrip("-") == expected.get(str(item.up)) and _opens_upward(asset)
    return found == expected.get(str(item.up))


def _opens_upward(asset: Asset) -> bool:
    return any(region.name == "opening" for region in asset.regions)


def lies_still(asset: Asset, rng: Rng) -> bool:
    """Drop an asset by 3 mm in a random direction, and tell whether it moves less than 2 mm and 2 degrees from 2 to 5 s."""
    spec = mujoco.MjSpec()
    PHYSICS.set_scene(spec)
    spec.option.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1])
    add_asset(spec, "asset", asset)
    model = spec.compile()
    data = mujoco.MjData(model)
    yaw = rng.uniform(-np.pi, np.pi)
    low = min(float(corners_of(part)[:, 2].min()) for part in asset.collision)
    data.qpos[:7] = (0, 0, 0.003 - low, math.cos(yaw / 2), 0, 0, math.sin(yaw / 2))
    mujoco.mj_step(model, data, nstep=1000)
    before = data.qpos[:7].copy()
    most, turned = 0.0, 0.0
    for _ in range(30):
        mujoco.mj_step(model, data, nstep=50)
        most = max(most, float(np.linalg.norm(data.qpos[:3] - before[:3])))
        turned = max(turned, 2 * math.acos(min(1.0, abs(float(data.qpos[3:7] @ before[3:7])))))
    return most < 0.002 and turned < math.radians(2.0)


class _Results(LineJournal):
    """The results of the items that were judged."""

    def _take_in(self, lines: list[bytes]) -> None:
        self.found = {form["id"]: Judged(**form) for form in map(json.loads, lines)}

    def keep(self, result: Judged) -> None:
        """Store a result."""
        self._append_line(asdict(result))
        self.found[result.id] = result


def measure(items: list[Item], out: Path, *, workers: int) -> list[Judged]:
    """Judge all items; those of an earlier command are not judged again."""
    with _Results(out / "journal.jsonl") as journal:
        run_items(
            items,
            is_done=lambda item: item.id in journal.found,
            work=lambda waiting: in_processes(waiting, functools.partial(judge, out=out), workers=workers),
            keep=journal.keep,
            on_progress=lambda p: print(f"\r{p.done}/{p.planned}", end="", file=sys.stderr, flush=True),
        )
        return [journal.found[item.id] for item in items]


def print_table(results: list[Judged]) -> dict[str, float]:
    """Print accepted and rejected per fault as a table for the documentation, and return the rates."""
    print("\n| fault | planted in | items | refused by the importer | rejected by the certificate | mended | false accepts |")
    print("|---|---|---|---|---|---|---|")
    bad = [r for r in results if r.fault is not None]
    for fault, stage in dict.fromkeys((r.fault, r.stage) for r in bad):
        rows = [r for r in bad if (r.fault, r.stage) == (fault, stage)]
        mended = sum(r.mended and r.outcome == "accepted" for r in rows)
        false = [r for r in rows if r.outcome == "accepted" and not r.mended]
        counts = [sum(r.outcome == o for r in rows) for o in ("refused", "rejected")]
        print(f"| {fault} | {stage} | {len(rows)} | {counts[0]} | {counts[1]} | {mended} | {len(false)} |")
    good = [r for r in results if r.fault is None]
    for origin in dict.fromkeys(r.origin for r in good):
        rows = [r for r in good if r.origin == origin]
        print(f"good ({origin}): {sum(r.outcome == 'accepted' for r in rows)} of {len(rows)} kept")
    false = [r for r in bad if r.outcome == "accepted" and not r.mended]
    judged = [r for r in bad if not (r.mended and r.outcome == "accepted")]
    accepted = [r for r in results if r.outcome == "accepted"]
    rates = {
        "false_accepts": len(false) / max(len(judged), 1),
        "good_kept": sum(r.outcome == "accepted" for r in good) / max(len(good), 1),
        "still": sum(bool(r.still) for r in accepted) / max(len(accepted), 1),
    }
    print(f"false accepts: {len(false)} of {len(judged)} ({100 * rates['false_accepts']:.1f} %)")
    print(f"good kept: {100 * rates['good_kept']:.1f} % of {len(good)}")
    print(f"of the accepted lie still: {100 * rates['still']:.1f} % of {len(accepted)}")
    for r in false:
        print("  false accept", r.id)
    for r in good:
        if r.outcome != "accepted":
            print("  lost", r.id, "; ".join(r.failed)[:300])
    for r in accepted:
        if not r.still:
            print("  not still", r.id)
    return rates


def main(arguments: list[str] | None = None) -> None:
    """Make the items and, with ``--measure``, judge them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seed", type=int, required=True, help="seed of shapes, victims and faults")
    parser.add_argument("--out", type=Path, required=True, help="folder of the items and their results")
    parser.add_argument("--meshes", type=Path, help="folder of good meshes besides those that this script makes")
    parser.add_argument("--each", type=int, default=4, help="bad assets per fault")
    parser.add_argument("--measure", action="store_true", help="import and certify all items")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    given = parser.parse_args(arguments)
    out = given.out.absolute()
    items = make_plan(given.seed, out, None if given.meshes is None else given.meshes.absolute(), each=given.each)
    (out / "plan.json").write_text(json.dumps([dataclasses.asdict(item) for item in items], indent=1), encoding="utf-8")
    print(f"{sum(item.fault is not None for item in items)} bad and {sum(item.fault is None for item in items)} good items in {out}")
    if given.measure:
        print_table(measure(items, out, workers=given.workers))


if __name__ == "__main__":
    main()
