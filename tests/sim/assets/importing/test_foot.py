"""The foot of an imported object: what would roll gets one, what stands does not; none is wider than its object."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from betterbench.sim.assets.importing.foot import foot_under, returns_upright
from betterbench.sim.assets.importing.hulls import with_thickness


def ball(radius: float = 0.035) -> np.ndarray:
    """Points of a fine sphere on the ground."""
    turns, rises = np.meshgrid(np.linspace(0, 2 * np.pi, 40, endpoint=False), np.linspace(-1, 1, 30))
    across = np.sqrt(1 - rises**2)
    points = radius * np.stack([across * np.cos(turns), across * np.sin(turns), rises], axis=2).reshape(-1, 3)
    return points + np.array([0.0, 0.0, radius])


def box(x: float, y: float, z: float) -> np.ndarray:
    return np.array([[a * x / 2, b * y / 2, c * z] for a in (-1, 1) for b in (-1, 1) for c in (0, 1)])


def ring(radius: float, z: float) -> np.ndarray:
    turns = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    return np.stack([radius * np.cos(turns), radius * np.sin(turns), np.full(48, z)], axis=1)


def test_a_ball_gets_a_foot_from_which_it_returns():
    points, center = ball(), np.array([0.0, 0.0, 0.035])
    assert not returns_upright(points, center)
    foot = foot_under([points], center)
    assert foot is not None
    assert foot[:, 2].min() < points[:, 2].min()
    assert returns_upright(np.concatenate([points, foot]), center)
    assert np.hypot(foot[:, 0], foot[:, 1]).max() < 0.035


def test_what_stands_well_has_none():
    assert foot_under([box(0.06, 0.06, 0.05)], np.array([0.0, 0.0, 0.025])) is None
    # A plate touches the ground with the rim of its foot; a bump in the middle is not what it stands on.
    plate = [ring(0.13, 0.026), ring(0.08, 0.0), np.array([[0.0, 0.0, 0.0002]])]
    assert foot_under(plate, np.array([0.0, 0.0, 0.012])) is None


def test_no_foot_is_wider_than_its_object():
    """A candle on end falls over with or without one: that is for the certificate to say."""
    candle = np.concatenate([ring(0.002, 0.0), ring(0.006, 0.12)])
    assert foot_under([candle], np.array([0.0, 0.0, 0.06])) is None


def test_the_foot_is_under_the_center_of_mass():
    center = np.array([0.004, -0.003, 0.03])
    foot = foot_under([ball()], center)
    assert foot is not None
    assert np.allclose(foot[:, :2].mean(axis=0), center[:2])
    assert math.isclose(float(np.ptp(foot[:, 0])), float(np.ptp(foot[:, 1])))


def test_a_flat_hull_is_given_a_thickness_that_mujoco_takes():
    """The tines of a fork are thinner than the cells that its hulls are made of."""
    flat = np.array([[0.0, 0.0, 0.01], [0.03, 0.0, 0.01], [0.03, 0.004, 0.01], [0.0, 0.004, 0.01], [0.01, 0.002, 0.01]])
    tilted = flat @ np.linalg.qr(np.arange(9.0).reshape(3, 3) + np.eye(3))[0]
    for corners in (flat, tilted):
        thick = with_thickness(corners)
        spec = mujoco.MjSpec()
        spec.add_mesh(name="hull", uservert=thick.ravel())
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hull")
        spec.compile()
        assert np.allclose(thick.mean(axis=0), corners.mean(axis=0))
    assert with_thickness(box(0.02, 0.02, 0.02)) is not None
    assert np.array_equal(with_thickness(box(0.02, 0.02, 0.0006)), box(0.02, 0.02, 0.0006))
