"""Generators of good meshes of common objects with random dimensions, for ``planted_assets.py``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import cast

import numpy as np
import trimesh
from PIL import Image

Rng = np.random.Generator


def turn_about(angle: float, axis: Sequence[float]) -> np.ndarray:
    """Return the (4, 4) rotation by an angle [rad] about an axis through the origin."""
    return np.asarray(trimesh.transformations.rotation_matrix(angle, axis))  # type: ignore[no-untyped-call]


def joined(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Return meshes as one."""
    return cast("trimesh.Trimesh", trimesh.util.concatenate(list(meshes)))


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
    ring.apply_transform(turn_about(np.pi / 2, [1, 0, 0]))
    ring.apply_translation([radius, 0, 0.5 * height])
    ring.update_faces(ring.triangles_center[:, 0] > radius - 0.7 * wall)  # the other half would stick into the mug
    ring.remove_unreferenced_vertices()
    return joined([_cup(radius, height, wall, rng), ring])


def _bowl(rng: Rng) -> trimesh.Trimesh:
    radius = rng.uniform(0.06, 0.11)
    return _cup(radius, radius * rng.uniform(0.5, 0.75), rng.uniform(0.004, 0.006), rng, foot=rng.uniform(0.5, 0.7))


def _glass(rng: Rng) -> trimesh.Trimesh:
    return _cup(
        rng.uniform(0.03, 0.037), rng.uniform(0.09, 0.15), rng.uniform(0.003, 0.004), rng, foot=rng.uniform(0.8, 1.0)
    )


def _bottle(rng: Rng) -> trimesh.Trimesh:
    height, radius = rng.uniform(0.17, 0.28), rng.uniform(0.028, 0.036)
    neck = rng.uniform(0.35, 0.5) * radius
    return _revolved(
        [(0, 0), (radius, 0), (radius, 0.6 * height), (neck, 0.8 * height), (neck, height), (0, height)], rng
    )


def _jar(rng: Rng) -> trimesh.Trimesh:
    height, radius = rng.uniform(0.08, 0.14), rng.uniform(0.028, 0.036)
    return _revolved(
        [
            (0, 0),
            (radius, 0),
            (radius, 0.8 * height),
            (0.8 * radius, 0.85 * height),
            (0.8 * radius, height),
            (0, height),
        ],
        rng,
    )


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
        mesh = cast("trimesh.Trimesh", trimesh.creation.box(sides))
        mesh.apply_translation([0, 0, 0.5 * sides[2]])
        return mesh

    return make


def _tray(low: float, high: float, wall_height: tuple[float, float]) -> Callable[[Rng], trimesh.Trimesh]:
    def make(rng: Rng) -> trimesh.Trimesh:
        x, y, z, t = rng.uniform(low, high), rng.uniform(0.6, 0.9), rng.uniform(*wall_height), 0.005
        y = x * y
        parts = [((x, y, t), (0.0, 0.0, t / 2))]
        for s in (-1, 1):
            parts += [((t, y, z), (s * (x - t) / 2, 0.0, z / 2)), ((x, t, z), (0.0, s * (y - t) / 2, z / 2))]
        made: list[trimesh.Trimesh] = []
        for size, at in parts:
            part = trimesh.creation.box(size)
            part.apply_translation(at)
            made.append(part)
        return joined(made)

    return make


def _rod(length: tuple[float, float], radius: tuple[float, float], *, lies: bool) -> Callable[[Rng], trimesh.Trimesh]:
    def make(rng: Rng) -> trimesh.Trimesh:
        h, r = rng.uniform(*length), rng.uniform(*radius)
        mesh = cast("trimesh.Trimesh", trimesh.creation.cylinder(r, h, sections=24))
        if lies:
            mesh.apply_transform(turn_about(np.pi / 2, [0, 1, 0]))
        mesh.apply_translation([0, 0, r if lies else 0.5 * h])
        return mesh

    return make


def _ball(rng: Rng) -> trimesh.Trimesh:
    mesh = cast("trimesh.Trimesh", trimesh.creation.icosphere(subdivisions=3, radius=rng.uniform(0.03, 0.036)))
    mesh.apply_transform(np.diag([1.0, rng.uniform(0.9, 1.0), rng.uniform(0.85, 0.95), 1.0]))
    mesh.apply_translation([0, 0, -mesh.bounds[0, 2]])
    return mesh


def _spoon(rng: Rng) -> trimesh.Trimesh:
    length = rng.uniform(0.14, 0.2)
    handle = trimesh.creation.box([0.7 * length, 0.011, 0.009])
    handle.apply_translation([-0.15 * length, 0, 0.0045])
    head = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    head.apply_transform(np.diag([0.19 * length, 0.017, 0.006, 1.0]))
    head.apply_translation([0.31 * length, 0, 0.006])
    return joined([handle, head])


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
"""Generators by kind; the meshes are in meters and stand on z = 0."""

LIBRARY = {
    "apple": "apple",
    "orange": "orange",
    "lemon": "lemon",
    "block": "block",
    "can": "can",
    "mug": "mug",
    "tumbler": "glass",
    "fork": "fork",
    "spoon": "spoon",
    "stapler": "stapler",
    "soap_bar": "soap",
    "salt_shaker": "shaker",
    "speaker": "speaker",
    "keyboard": "keyboard",
    "serving_plate": "plate",
    "place_plate": "plate",
    "bun_bottom": "",
    "sauce_cup": "cup",
    "cheese_slice": "cheese",
    "drawer_cabinet": "",
    "lower_drawer": "",
    "coffee_machine": "",
    "spice_rack": "",
    "round_block": "block",
}
"""Categories of the procedural library, with the kind that a user would name."""


def _painted(mesh: trimesh.Trimesh, rng: Rng) -> trimesh.Trimesh:
    color = [int(v) for v in rng.integers(60, 230, 3)]
    if rng.random() < 0.5:
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=[*color, 255])  # type: ignore[no-untyped-call]
        mesh.visual = trimesh.visual.TextureVisuals(material=material)  # type: ignore[no-untyped-call]
        return mesh
    noise = np.clip(np.array(color) + rng.integers(-30, 30, (64, 64, 3)), 0, 255).astype(np.uint8)
    uv = (mesh.vertices[:, :2] - mesh.bounds[0, :2]) / np.ptp(mesh.bounds, axis=0)[:2]
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(noise))  # type: ignore[no-untyped-call]
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)  # type: ignore[no-untyped-call]
    return mesh


def write_mesh(mesh: trimesh.Trimesh, path: Path, rng: Rng) -> str:
    """Write a mesh that rests on z = 0, in meters, and return the file's up axis."""
    mesh = mesh.copy()
    if path.suffix == ".glb":
        mesh.apply_transform(turn_about(-np.pi / 2, [1, 0, 0]))
        _painted(mesh, rng)
    elif path.suffix == ".stl":
        mesh.apply_transform(np.diag([1000.0, 1000.0, 1000.0, 1.0]))
    elif path.suffix == ".ply":
        colors = np.tile([*rng.integers(60, 230, 3), 255], (len(mesh.vertices), 1))
        mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=colors)
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh.export(path)
    return "y" if path.suffix == ".glb" else "z"
