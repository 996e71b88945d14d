"""Grasps of imported objects, tried in simulation."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trimesh

from betterbench.sim.asset_checks import tried_grasps
from betterbench.sim.asset_checks.lift import LiftTrial
from betterbench.sim.asset_checks.tried_grasps import with_tried_grasps
from betterbench.sim.assets.importing import child
from betterbench.sim.assets.importing.importer import Wishes, import_mesh


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """A file of a block, and its options."""
    path = tmp_path_factory.mktemp("meshes") / "block.stl"
    trimesh.creation.box((0.05, 0.03, 0.04)).export(path)
    return path, Wishes("block", size_m=0.05, mass_kg=0.1)


@pytest.fixture(scope="module")
def found(block):
    """The imported block with its proposed grasps."""
    return import_mesh(*block)


def test_a_grasp_that_fails_is_left_out_and_the_others_are_named_in_order(found):
    good = found.draft.grasps[0]
    beside = replace(good, name="beside", pose=good.pose.translated(0.2, 0.0, 0.0), preference=0)
    mixed = replace(found, draft=replace(found.draft, grasps=(beside, replace(good, preference=1))))
    tried = with_tried_grasps(mixed)
    (kept,) = tried.draft.grasps
    assert (kept.name, kept.preference, kept.pose) == ("body", 0, good.pose)
    assert tried.notes[-1] == "1 of 2 grasps lift and carry it in simulation"


def test_the_firmest_grasps_are_first_and_equal_ones_keep_their_order(found, monkeypatch):
    first = found.draft.grasps[0]
    shifts = (0.0, 0.001, 0.002, 0.003, 0.004)
    several = tuple(
        replace(first, name=f"g{k}", preference=k, pose=first.pose.translated(x, 0, 0)) for k, x in enumerate(shifts)
    )
    trials = iter([(True, 12.0, 30.0), (False, 40.0, 0.0), (True, 0.9, 4.0), (True, 0.2, 3.0), (True, 1.0, 11.0)])
    monkeypatch.setattr(tried_grasps, "try_grasp", lambda *_: LiftTrial(*next(trials)))
    tried = with_tried_grasps(replace(found, draft=replace(found.draft, grasps=several)))
    moved = [round(g.pose.position[0] - first.pose.position[0], 4) for g in tried.draft.grasps]
    assert moved == [0.002, 0.003, 0.004, 0.0]
    assert [g.preference for g in tried.draft.grasps] == [0, 1, 2, 3]
    assert tried.notes[-1].startswith("4 of 5")


def test_an_object_that_is_too_heavy_to_lift_keeps_its_proposals(found):
    heavy = replace(found, draft=replace(found.draft, mass_kg=4.0))
    assert with_tried_grasps(heavy) is heavy


def test_an_import_tries_the_grasps_in_its_child(block, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert child.import_safely(*block).notes[-1].endswith("grasps lift and carry it in simulation")
