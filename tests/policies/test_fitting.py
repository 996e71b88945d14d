"""Images as policies are shown them: every turn, mirror and fit on an image without any symmetry."""

from __future__ import annotations

import numpy as np
import pytest

from betterbench.errors import InvalidInputError
from betterbench.policies.conventions.image_rule import ImageRule

RED, GREEN, BLUE, GREY = (200, 0, 0), (0, 200, 0), (0, 0, 200), (90, 90, 90)
CORNERS = {"top left": RED, "top right": GREEN, "bottom left": BLUE, "bottom right": GREY}


@pytest.fixture
def image():
    """40 x 80: red top left, green top right, blue bottom left, gray bottom right."""
    made = np.zeros((40, 80, 3), np.uint8)
    made[:20, :40], made[:20, 40:], made[20:, :40], made[20:, 40:] = RED, GREEN, BLUE, GREY
    return made


def corners(shown, inset=2):
    top, left, bottom, right = inset, inset, -1 - inset, -1 - inset
    found = shown[top, left], shown[top, right], shown[bottom, left], shown[bottom, right]
    return [tuple(int(v) for v in pixel) for pixel in found]


def rule(**options):
    return ImageRule(("image",), "front", **options)


def test_a_image_of_the_right_size_keeps_its_bits(image):
    assert np.array_equal(rule().show(image), image)
    assert np.array_equal(rule(width=80, height=40).show(image), image)


@pytest.mark.parametrize(
    ("turn", "mirror", "expected"),
    [
        (0, False, [RED, GREEN, BLUE, GREY]),
        (90, False, [GREEN, GREY, RED, BLUE]),
        (180, False, [GREY, BLUE, GREEN, RED]),
        (270, False, [BLUE, RED, GREY, GREEN]),
        (0, True, [GREEN, RED, GREY, BLUE]),
        (180, True, [BLUE, GREY, RED, GREEN]),
        (90, True, [GREY, GREEN, BLUE, RED]),
    ],
)
def test_turns_are_counter_clockwise_and_a_mirror_swaps_left_and_right(image, turn, mirror, expected):
    shown = rule(turn=turn, mirror=mirror).show(image)
    assert shown.shape == ((40, 80, 3) if turn in (0, 180) else (80, 40, 3))
    assert corners(shown) == expected
    assert shown.flags.c_contiguous


def test_half_a_turn_is_what_libero_clients_do(image):
    assert np.array_equal(rule(turn=180).show(image), image[::-1, ::-1])


def test_padding_keeps_the_whole_image_between_black_bars(image):
    shown = rule(width=32, height=32, fit="pad").show(image)
    assert shown.shape == (32, 32, 3)
    assert not shown[:8].any()
    assert not shown[-8:].any()
    assert corners(shown[8:24]) == [RED, GREEN, BLUE, GREY]


def test_cropping_fills_and_loses_the_sides(image):
    image[:, :20] = 255  # the quarter on the left is cut off
    shown = rule(width=32, height=32, fit="crop").show(image)
    assert corners(shown) == [RED, GREEN, BLUE, GREY]


def test_stretching_keeps_everything_and_distorts(image):
    shown = rule(width=32, height=32, fit="stretch").show(image)
    assert corners(shown) == [RED, GREEN, BLUE, GREY]
    assert np.array_equal(shown[4, :16], np.tile(np.array(RED, np.uint8), (16, 1))[:16]) or shown[4, 10].tolist() == [
        *RED
    ]


@pytest.mark.parametrize("keep", [0.25, 0.81])
def test_a_center_crop_keeps_a_share_of_the_area(keep):
    ramp = np.tile(np.arange(200, dtype=np.uint8)[None, :, None], (200, 1, 3))
    shown = rule(width=200, height=200, keep=keep).show(ramp).astype(float)
    seen = (shown[100, -1, 0] - shown[100, 0, 0]) / 199
    assert abs(seen - np.sqrt(keep)) < 0.02
    assert abs(shown[100].mean() - ramp[100].mean()) < 1.0


def test_a_center_crop_without_a_size_keeps_the_size(image):
    assert rule(keep=0.9).show(image).shape == image.shape


def test_shrinking_averages_so_that_fine_stripes_do_not_alias():
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[:, ::2] = 255
    shown = rule(width=16, height=16).show(stripes)
    assert abs(shown[:, 2:-2].astype(float) - 127.5).max() < 20


@pytest.mark.parametrize(
    ("width", "height", "rows"), [(640, 480, 168), (848, 480, 126), (424, 240, 126), (500, 499, 223)]
)
def test_padding_rounds_down_as_openpis_client_does(width, height, rows):
    shown = rule(width=224, height=224, fit="pad").show(np.full((height, width, 3), 255, np.uint8))
    assert int((shown[:, 112, 0] > 0).sum()) == rows
    assert int((shown[: (224 - rows) // 2, 112, 0] > 0).sum()) == 0


def test_other_aspects_come_out_as_large_as_asked():
    rng = np.random.default_rng(0)
    for fit in ("pad", "crop", "stretch"):
        for _ in range(30):
            height, width, to_height, to_width = (int(v) for v in rng.integers(1, 60, 4))
            options = {"width": to_width, "height": to_height, "fit": fit, "keep": float(rng.uniform(0.3, 1))}
            shown = rule(**options).show(rng.integers(0, 256, (height, width, 3)).astype(np.uint8))
            assert shown.shape == (to_height, to_width, 3)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"width": 224}, "only one of width and height"),
        ({"width": 0, "height": 10}, "0 pixels"),
        ({"width": 10, "height": 5000}, "5000 pixels"),
        ({"keep": 0.0}, "keep = 0"),
        ({"keep": 1.2}, r"keep = 1\.2"),
        ({"camera": "*"}, "all cameras would have the same key"),
    ],
)
def test_what_makes_no_sense_is_refused(options, text):
    with pytest.raises(InvalidInputError, match=text):
        ImageRule(("image",), **{"camera": "front", **options})
