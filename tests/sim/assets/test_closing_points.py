"""The packaged closing points are those of the library's grasps."""

from __future__ import annotations

import math

import pytest
from tests.daily import others_slow

from betterbench.sim.assets import build_unpainted, categories, looks, unseen_looks
from betterbench.tasks.judging.picked_slots import closing_points


def test_every_category_that_can_be_grasped_has_closing_points():
    assert set(closing_points()) == {c for c in categories() if build_unpainted(c).grasps}


@pytest.mark.parametrize("category", others_slow(sorted(closing_points()), 4))
def test_closing_points_are_where_the_preferred_grasps_close(category):
    points = closing_points()[category]
    met = set()
    for look in (*looks(category), *unseen_looks(category)):
        grasps = build_unpainted(category, look=look).grasps
        best = min(grasp.preference for grasp in grasps)
        for grasp in (g for g in grasps if g.preference == best):
            x, y = (1000.0 * value for value in grasp.pose.position[:2])
            near = min(points, key=lambda p: math.dist(p[:2], (x, y)) - p.spread_mm)
            assert math.dist(near[:2], (x, y)) <= near.spread_mm + 0.2, (look, grasp.name)
            met.add(near)
    assert met == set(points), "no point that no grasp meets"
