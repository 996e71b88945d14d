"""What the things of the desk have to keep beyond what every asset keeps."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.spatial import KDTree
from tests.looping import each

from betterbench.errors import UnknownNameError
from betterbench.sim.assets import build, build_unpainted, categories, looks
from betterbench.sim.assets.authoring import MATERIALS, material
from betterbench.sim.assets.procedural import (
    blocks,
    can,
    computer_mouse,
    crumpled_napkin,
    crushed_can,
    drawers,
    keyboard,
    laptop,
    speaker,
    stapler,
    table_extras,
    tape_roll,
    waste_bin,
)
from betterbench.sim.robots.panda import PAD_FRICTION

FILES = (
    blocks, can, computer_mouse, crumpled_napkin, crushed_can, drawers, keyboard, laptop, speaker, stapler,
    table_extras, tape_roll, waste_bin,
)  # fmt: skip
FUNCTIONS = {"block": "toy_block"}
OFFICE = [c for c in categories() if any(FUNCTIONS.get(c, c) in vars(file) for file in FILES)]
TABLE_FRICTION = 0.5
"""Sliding friction of the table top, see the stage."""
BY_HAND = [c for c in OFFICE if c != "drawer_cabinet"]


def test_all_categories_of_the_files_are_found():
    assert len(OFFICE) == 19


def corners(asset):
    """All corners of what is seen, (n, 3) [m]."""
    return np.concatenate([part.vertices for part in asset.visual])


@pytest.mark.parametrize("category", OFFICE)
def test_looks_differ_in_shape_by_more_than_a_millimeter(category):
    """Of any two looks one has a box of another size, or surfaces elsewhere: it is not one mesh in another dress."""
    assets = [build_unpainted(category, look=look) for look in looks(category)]
    for one, other in itertools.combinations(assets, 2):
        sizes = np.abs(np.subtract(one.size_m, other.size_m)).max()
        apart = KDTree(corners(other)).query(corners(one))[0].max()
        assert max(sizes, apart) > 1e-3, f"looks {one.look} and {other.look}"


@each("category", OFFICE)
def test_friction_is_that_of_a_material_and_mass_goes_with_size(category):
    known = {m.friction for m in MATERIALS.values()}
    assets = [build_unpainted(category, look=look) for look in looks(category)]
    for asset in assets:
        assert {part.friction for part in asset.collision} <= known, asset.identity
    if category in BY_HAND:
        assert len({asset.mass_kg for asset in assets}) >= 4


def test_every_material_holds_better_than_the_table_and_worse_than_the_pads():
    for entry in MATERIALS.values():
        assert TABLE_FRICTION <= entry.sliding < PAD_FRICTION[0]
        assert entry.reason
    assert material("soap").sliding < material("sponge").sliding
    with pytest.raises(UnknownNameError, match="paper"):
        material("papper")


@each("look", looks("crushed_can"))
def test_a_crushed_can_lies_and_a_full_one_stands(look):
    crushed, full = build_unpainted("crushed_can", look=look), build_unpainted("can", look=look)
    assert full.size_m[2] - crushed.size_m[2] > 0.015
    assert max(crushed.size_m[:2]) > 1.3 * crushed.size_m[2]
    assert crushed.grasps[0].width_m < 0.045, "it is taken at its waist"


@each("look", looks("stapler"))
def test_a_stapler_has_an_open_steel_mouth_and_the_block_of_its_size_none(look):
    real, fake = (build_unpainted(category, look=look, color="red") for category in ("stapler", "stapler_block"))
    assert real.size_m[:2] == pytest.approx(fake.size_m[:2], rel=0.08)
    assert real.mass_kg == pytest.approx(fake.mass_kg, rel=0.01)
    assert {"magazine", "anvil"} <= {part.name for part in real.visual}
    # Between base and arm, at the mouth, is air.
    tip = next(p for p in real.visual if p.name == "head").vertices
    assert float(tip[:, 2].min()) > 0.018


@pytest.mark.parametrize("look", looks("drawer_cabinet"))
def test_the_handles_of_a_cabinet_stand_out_from_its_fronts(look):
    """Two handles, apart by more than a hand, and of another brightness than the board that they are on."""
    for color in ("white", "brown", "gray"):
        upper, lower = build("upper_drawer", look=look, color=color), build("lower_drawer", look=look, color=color)
        assert lower.region("knob").position[1] - upper.region("knob").position[1] > 0.12
        handle = next(p for p in upper.visual if p.name == "handle")
        front = next(p for p in upper.visual if p.name == "front")
        assert front.texture is not None
        board = front.texture.pixels.reshape(-1, 3).mean() / 255.0
        assert abs(float(np.mean(handle.rgba[:3])) - board) > 0.2, f"{color}: {handle.rgba} on {board}"


@pytest.mark.parametrize("look", looks("waste_bin"))
def test_a_waste_bin_has_a_bag_a_mesh_or_the_sign_of_recycling(look):
    bin_ = build("waste_bin", look=look)
    names = {part.name for part in bin_.visual}
    assert "bag" in names or bin_.parameters["pattern"] == "mesh" or _has_light_marks(bin_)
    assert bin_.size_m[2] > 0.55 * bin_.size_m[1]


def _has_light_marks(bin_):
    """Whether a dark bin has something nearly white printed on its wall, below its rim."""
    pixels = next(p for p in bin_.visual if p.name == "bin").texture.pixels
    rows = pixels[round(0.5 * len(pixels)) :].reshape(-1, 3)
    return math.isclose(float(rows.max()) / 255.0, 0.85, abs_tol=0.15)
