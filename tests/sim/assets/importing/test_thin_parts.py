"""Reduction of objects of many thin parts, such as a basket of wires: every part stays."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from tests.daily import in_turn

from betterbench.errors import InvalidInputError
from betterbench.sim.assets.importing.appearance import (
    LOST_SHARE,
    THIN_FACE_BUDGET,
    WIRES_FACE_BUDGET,
    _reduced_enough,
    visual_parts,
)
from betterbench.sim.assets.importing.cavity import cavity_of
from betterbench.sim.assets.importing.hulls import convex_hulls, filled_share
from betterbench.sim.assets.importing.measures import surface_solid
from betterbench.sim.assets.importing.raw import RawMesh, RawPart
from betterbench.sim.assets.importing.solid import solid_of


def grid(count, sides, radius):
    """Return crossing rods, each closed by itself, and a hoop around them, as (points, triangles) [m]."""
    found = []
    for k in range(count):
        at = -0.09 + 0.18 * k / (count - 1)
        for turn in ([0, 1, 0], [1, 0, 0]):
            rod = trimesh.creation.cylinder(radius, 0.2, sections=sides)
            rod.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, turn))
            found.append(rod.apply_translation([0, at, 0] if turn[1] else [at, 0, 2.5 * radius]))
    found.append(trimesh.creation.torus(0.14, radius, 48, 8))
    mesh = trimesh.util.concatenate(found)
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def sampled(points, faces, count):
    """Return points drawn evenly from a surface."""
    rng = np.random.default_rng(4)
    a, b, c = (np.asarray(points, float)[faces[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    owners = rng.choice(len(faces), count, p=areas / areas.sum())
    u, v = np.sort(rng.random((2, count)), axis=0)
    weights = np.stack([u, v - u, 1.0 - v], axis=1)
    return np.einsum("kc,ckd->kd", weights, np.stack([a, b, c])[:, owners])


@in_turn(0, 2)
def test_no_wire_is_lost():
    points, faces = grid(20, 8, 0.0015)
    assert len(faces) > 1.5 * THIN_FACE_BUDGET
    (part,) = visual_parts(RawMesh((RawPart("basket", points, faces),), "z", 1.0), "basket.glb")
    assert len(part.faces) <= THIN_FACE_BUDGET
    size = float(np.ptp(points, axis=0).max())
    before, after = sampled(points, faces, 5_000), sampled(part.vertices, part.faces, 40_000)
    assert cKDTree(after).query(before)[0].max() < LOST_SHARE * size
    a, b, c = (part.vertices[part.faces[:, k]].astype(float) for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0.0, "the triangles face outward"


def basket(radius=0.09, height=0.08, wire=0.0015):
    """Return a round basket of hoops, posts and crossing bars, each closed by itself, as (points, triangles) [m]."""
    hoops = [
        trimesh.creation.torus(radius, wire, 40, 8).apply_translation([0, 0, z]) for z in np.linspace(0, height, 8)
    ]
    turns = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    feet = np.stack([radius * np.cos(turns), radius * np.sin(turns), 0.0 * turns], axis=1)
    ends = [(foot, foot + np.array([0.0, 0.0, height])) for foot in feet]
    for at in np.arange(0.012 - radius, radius, 0.012):
        half = float(np.sqrt(radius**2 - at**2))
        ends += [((at, -half, 0.0), (at, half, 0.0)), ((-half, at, 0.0), (half, at, 0.0))]
    mesh = trimesh.util.concatenate([*hoops, *(trimesh.creation.cylinder(wire, segment=e, sections=8) for e in ends)])
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


@in_turn(1, 2)
def test_a_wire_basket_keeps_its_hoops_and_its_opening():
    points, faces = basket()
    solid = solid_of(points, faces)
    cavity = cavity_of(solid)
    seen = _reduced_enough(points, faces, "basket.glb")
    assert len(seen[1]) <= WIRES_FACE_BUDGET
    visible = cavity_of(solid_of(*seen))
    assert visible is not None, "a hoop is lost"
    assert visible.volume_m3 == pytest.approx(cavity.volume_m3, rel=0.1)
    hulls, _ = convex_hulls(solid, (points, faces), cavity)
    assert filled_share(hulls, solid, cavity) < 0.1
    touched = cavity_of(surface_solid(hulls), with_seams=True)
    assert touched is not None, "a seam between two parts is not a leak"
    assert touched.volume_m3 > 0.6 * cavity.volume_m3


def test_so_many_parts_that_only_splinters_would_be_left_are_an_error():
    steps = np.stack(np.meshgrid(*(np.arange(n) for n in (8, 8, 5)), indexing="ij"), axis=-1).reshape(-1, 3)
    boxes = [trimesh.creation.box((0.012,) * 3).apply_translation(0.0125 * step) for step in steps]
    mesh = trimesh.util.concatenate(boxes)
    with pytest.raises(InvalidInputError, match=r"blocks.glb: it has too many parts: .*would be missing. Use a mesh"):
        _reduced_enough(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64), "blocks.glb")


def test_a_hole_in_the_floor_of_collision_parts_is_no_seam():
    walls = [trimesh.creation.box((0.1, 0.002, 0.05)).apply_translation([0, s * 0.05, 0.025]) for s in (-1, 1)]
    walls += [trimesh.creation.box((0.002, 0.1, 0.05)).apply_translation([s * 0.05, 0, 0.025]) for s in (-1, 1)]
    for gap, holds in ((0.0025, True), (0.012, False)):
        side = 0.5 * (0.1 - gap)
        floor = [
            trimesh.creation.box((side, 0.1, 0.002)).apply_translation([s * 0.5 * (side + gap), 0, 0.001])
            for s in (-1, 1)
        ]
        solid = surface_solid([np.asarray(part.vertices) for part in (*walls, *floor)])
        assert cavity_of(solid) is None
        assert (cavity_of(solid, with_seams=True) is not None) is holds
