"""Positions of the release on our table."""

from __future__ import annotations

import copy
import itertools

import numpy as np
import pytest
from tests.generation.better_release.writing import APPLE, BOX, CAN, LAYOUT, LEMON, ORANGE, lunch, pose, write_task

from betterbench.generation.better_release.layout import (
    FAR_X_M,
    FRONT_CAMERA_M,
    JITTER_M,
    NEAR_X_M,
    SEEN_AT_0_M,
    SEEN_SLOPE,
    beyond_workspace_m,
)


def test_positions_in_reach_and_in_view_are_taken_over(tmp_path, imported):
    slots = imported(write_task(tmp_path, lunch())).built.slots
    assert max(slots.moved_m.values()) < 0.02
    assert slots.crowded == ()
    for name in (APPLE, ORANGE, LEMON, CAN):
        slot = slots.slots[slots.of["TV-01", name]]
        assert (slot.x, slot.y) == pytest.approx(LAYOUT[name]["position"][:2], abs=0.02)
    assert slots.of["TV-01", APPLE] == slots.of["EV-01", ORANGE]


def test_near_positions_are_one_slot_and_far_ones_are_not(tmp_path, imported):
    files = lunch()
    files["variations/EV-01.yaml"]["pose_overrides"] = {APPLE: pose(0.415, -0.24), ORANGE: pose(0.44, 0.24)}
    of = imported(write_task(tmp_path, files)).built.slots.of
    assert of["EV-01", APPLE] == of["TV-01", APPLE]
    assert of["EV-01", ORANGE] != of["TV-01", ORANGE]


def test_positions_outside_are_moved_in_and_keep_their_order(tmp_path, imported):
    files = lunch()
    wide = {
        BOX: pose(0.60, 0.0),
        APPLE: pose(0.20, -0.60),
        ORANGE: pose(0.25, 0.30),
        LEMON: pose(0.90, -0.45),
        CAN: pose(0.85, 0.55),
    }
    files["base_variation.yaml"]["pose_overrides"] = wide
    files["variations/EV-01.yaml"]["pose_overrides"] = {APPLE: pose(0.5, 0.5)}
    slots = imported(write_task(tmp_path, files)).built.slots
    for variation in ("TV-01", "EV-01"):
        places = {name: slots.slots[slots.of[variation, name]] for name in wide}
        wished = {**wide, **({} if variation == "TV-01" else {APPLE: pose(0.5, 0.5)})}
        for a, b in itertools.combinations(wide, 2):
            for axis, mine in ((0, "x"), (1, "y")):
                apart = wished[a]["position"][axis] - wished[b]["position"][axis]
                if abs(apart) > 0.02:
                    assert apart * (getattr(places[a], mine) - getattr(places[b], mine)) > 0.0, (a, b, mine)
        for slot in places.values():
            assert beyond_workspace_m(slot.x, slot.y) < 1e-4


def test_objects_that_are_too_close_get_room(tmp_path, imported):
    files = lunch()
    files["base_variation.yaml"]["pose_overrides"] = {**LAYOUT, LEMON: pose(0.45, -0.24)}
    found = imported(write_task(tmp_path, files))
    slots = found.built.slots
    a, b = (slots.slots[slots.of["TV-01", name]] for name in (APPLE, LEMON))
    half = sum(0.5 * min(found.matches[n].asset.size_m[:2]) for n in (APPLE, LEMON))
    assert max(abs(a.x - b.x), abs(a.y - b.y)) > half + 0.02


def test_a_task_with_many_positions_is_laid_out(tmp_path, imported):
    files = lunch()
    names = [f"EV-{i:02}" for i in range(1, 99)]
    files["task.yaml"]["variation_registry"]["eval"] = names
    for i, name in enumerate(names):
        places = {n: pose(0.36 + 0.003 * i, y + 0.001 * i) for n, y in ((APPLE, -0.2), (ORANGE, 0.1), (CAN, 0.15))}
        files[f"variations/{name}.yaml"] = {"variation_id": name, "extends": "BASE", "pose_overrides": places}
    found = imported(write_task(tmp_path, files))
    assert len(found.built.slots.slots) > 20
    assert all(beyond_workspace_m(s.x, s.y) < 1e-4 for s in found.built.slots.slots.values())


@pytest.mark.physics
def test_the_workspace_is_what_the_front_camera_shows():
    from betterbench.interface.actions import EE_DELTA
    from betterbench.sim.scenes import Scene
    from betterbench.sim.scenes.cameras import ViewPlacement, camera_matrices
    from betterbench.sim.scenes.framing import MARGIN_M, extreme_jitters
    from betterbench.sim.scenes.stage import quality_preset
    from betterbench.tasks import get_task

    task = get_task("fruit_lunch")
    scene = Scene(task, task.training[0], seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))
    xs = np.linspace(NEAR_X_M - JITTER_M, FAR_X_M + JITTER_M, 12)
    limits = SEEN_AT_0_M - SEEN_SLOPE * np.clip(xs, NEAR_X_M, FAR_X_M) + JITTER_M
    points = np.array([(x, side * y, 0.0) for x, y in zip(xs, limits, strict=True) for side in (-1.0, 1.0)])
    data, least = copy.copy(scene.data), np.full(len(points), np.inf)
    for jitter in extreme_jitters():
        ViewPlacement(scene.model, jitter).apply(data)
        view = camera_matrices(scene.model, data, "front", width=256, height=256)
        pixels, depths = view.project(points)
        edge = np.minimum(pixels + 0.5, 255.5 - pixels).min(axis=1)
        least = np.minimum(least, edge * depths / view.K[0, 0])
    assert least.min() >= MARGIN_M
    camera = scene.model.camera("front")
    assert tuple(camera.pos) == pytest.approx(FRONT_CAMERA_M)
