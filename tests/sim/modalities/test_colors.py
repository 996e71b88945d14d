"""Masks and boxes of a viewer have the colors of the objects that they mark."""

from __future__ import annotations

import colorsys

import numpy as np

from betterbench.records.modalities.header import FIRST_OBJECT
from betterbench.sim.modalities.pictures import own_colors

RED, BLUE, WHITE = (190, 40, 35), (40, 60, 170), (225, 225, 220)


def scene(*looks):
    """Return an image and its mask with a square of each look."""
    rgb = np.full((20, 20 * len(looks), 3), 120, dtype=np.uint8)
    instances = np.zeros(rgb.shape[:2], dtype=np.int64)
    for i, look in enumerate(looks):
        rgb[5:15, 20 * i + 5 : 20 * i + 15] = look
        instances[5:15, 20 * i + 5 : 20 * i + 15] = FIRST_OBJECT + i
    return rgb, instances


def hue(color):
    return colorsys.rgb_to_hsv(*(part / 255 for part in color))


def test_a_red_mug_is_shown_in_red_wherever_it_stands_in_the_list():
    for looks in ((RED, BLUE, WHITE), (BLUE, WHITE, RED), (WHITE, RED, BLUE)):
        for look, color in zip(looks, own_colors(*scene(*looks), 3), strict=True):
            if look is WHITE:
                assert hue(color)[1] == 0.0, "gray, not red by chance"
            else:
                assert abs(hue(color)[0] - hue(look)[0]) < 0.02
                assert hue(color)[1] > 0.6


def test_objects_that_look_alike_are_told_apart_by_brightness():
    colors = own_colors(*scene(RED, RED, RED), 3)
    assert len(set(colors)) == 3
    assert all(abs(hue(c)[0] - hue(RED)[0]) < 0.02 for c in colors)


def test_an_object_that_is_not_seen_has_a_color_all_the_same():
    rgb, instances = scene(RED)
    assert len(own_colors(rgb, instances, 3)) == 3
