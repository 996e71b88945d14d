"""What the things of kitchen and table have to keep beyond what every asset keeps."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from tests.looping import each

from betterbench.sim.assets import build, build_unpainted, categories, colors, looks
from betterbench.sim.assets.procedural import (
    breakfast,
    burger,
    burger_layers,
    coffee_machine,
    cup,
    cutlery,
    drink_cup,
    fries,
    fruit,
    lunchbox,
    mug,
    place_plate,
    plates,
    spice_jars,
    spice_rack,
    takeaway_box,
)

FILES = (
    breakfast, burger, burger_layers, coffee_machine, cup, cutlery, drink_cup, fries, fruit, lunchbox, mug, place_plate,
    plates, spice_jars, spice_rack, takeaway_box,
)  # fmt: skip
KITCHEN = [c for c in categories() if any(c in vars(file) for file in FILES)]


def shape_of(asset):
    """Hash of the meshes alone: what is left of a look without its colors and prints."""
    digest = hashlib.sha256()
    for part in asset.visual:
        digest.update(part.vertices.tobytes())
    return digest.hexdigest()


def test_all_categories_of_the_files_are_found():
    assert len(KITCHEN) == 35


@pytest.mark.parametrize("category", KITCHEN)
def test_no_two_looks_have_one_mesh(category):
    assert len({shape_of(build_unpainted(category, look=look)) for look in looks(category)}) == len(looks(category))


@each("category", KITCHEN)
def test_mass_and_friction_come_from_the_material(category):
    assets = [build_unpainted(category, look=look) for look in looks(category)]
    for asset in assets:
        assert all(part.friction[0] != 0.8 or category in SOFT for part in asset.collision), asset.identity
    if category not in FIXED:
        assert len({asset.mass_kg for asset in assets}) >= 4


SOFT = ("cheese_slice", "patty")
"""What has a sliding friction of 0.8, the number that everything had."""
FIXED = ("coffee_machine", "spice_rack", "takeaway_box", "lunchbox", "place_plate")
"""Fixtures and containers, which nobody lifts."""


@pytest.mark.parametrize("category", ["patty", "cheese_slice", "lettuce_leaf"])
def test_all_fillings_are_equally_thick(category):
    for look in looks(category):
        asset = build_unpainted(category, look=look)
        assert asset.region("top").position[2] == pytest.approx(0.014, abs=1e-9)
        assert max(part.position[2] + part.size[1 if part.shape == "cylinder" else 2] for part in asset.collision) == (
            pytest.approx(0.014, abs=1e-9)
        )


def test_the_size_of_a_plate_says_nothing_about_its_color():
    every = looks("dinner_plate")
    sizes = {c: [build_unpainted("dinner_plate", look=look, color=c).size_m for look in every] for c in COLORS}
    assert len({tuple(found) for found in sizes.values()}) == 1
    assert len(set(sizes["red"])) >= 6
    assert all(0.15 < x < 0.17 and z < 0.022 for x, _, z in sizes["red"])


COLORS = colors("dinner_plate")


@pytest.mark.parametrize("look", looks("plain_salt_jar"))
def test_plain_jars_differ_in_their_print_alone(look):
    salt, pepper, paprika = (build(f"plain_{name}_jar", look=look) for name in ("salt", "pepper", "paprika"))
    assert salt.color == pepper.color == paprika.color == "gray"
    assert shape_of(salt) == shape_of(pepper) == shape_of(paprika)
    pictures = [np.asarray(asset.visual[0].texture.pixels, float) for asset in (salt, pepper, paprika)]
    for a, b in ((0, 1), (0, 2), (1, 2)):
        differing = np.abs(pictures[a] - pictures[b]).max(axis=2) > 40
        assert 0.01 < differing.mean() < 0.20, "a print, and nothing else"
    for picture in pictures:
        saturation = picture.max(axis=2) - picture.min(axis=2)
        assert saturation.max() < 30, "no color on body or label"
