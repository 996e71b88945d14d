"""Reduction of objects of many thin parts, such as a basket of wires: every part stays."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from betterbench.sim.assets.importing.appearance import LOST_SHARE, THIN_FACE_BUDGET, visual_parts
from betterbench.sim.assets.importing.raw import RawMesh, RawPart


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


def test_no_wire_is_lost():
    points, faces = grid(20, 8, 0.0015)
    assert len(faces) > 1.5 * THIN_FACE_BUDGET
    (part,) = visual_parts(RawMesh((RawPart("basket", points, faces),), "z", 1.0))
    assert len(part.faces) <= THIN_FACE_BUDGET
    size = float(np.ptp(points, axis=0).max())
    before, after = sampled(points, faces, 5_000), sampled(part.vertices, part.faces, 40_000)
    assert cKDTree(after).query(before)[0].max() < LOST_SHARE * size
    a, b, c = (part.vertices[part.faces[:, k]].astype(float) for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0.0, "the triangles face outward"
