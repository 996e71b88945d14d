"""What each of the eyes leaves of a picture, and the tiles that it costs."""

from __future__ import annotations

import io

import numpy as np
import pytest
from pictures import png, stripes
from PIL import Image

from betterbench.errors import InvalidInputError
from betterbench.vlm.models.eyes import Eyes, contact_sheet, shown_picture, size_in_detail
from betterbench.vlm.models.tiles import Grid, grid_of


def contrast(data: bytes) -> float:
    with Image.open(io.BytesIO(data)) as image:
        gray = np.asarray(image.convert("L"), float)
    return float(np.ptp(np.quantile(gray, [0.05, 0.95])))


def test_native_eyes_show_the_file_itself():
    picture = stripes(640, 480, 4)
    assert shown_picture(picture, Eyes.NATIVE).data is picture


@pytest.mark.parametrize(("eyes", "side"), [(Eyes.TILE_1, 448), (Eyes.BLUR_224, 448), (Eyes.NATIVE_224, 224)])
def test_one_tile_is_a_square_of_a_stated_size(eyes, side):
    shown = shown_picture(stripes(640, 480, 8), eyes)
    with Image.open(io.BytesIO(shown.data)) as image:
        assert image.size == (shown.width, shown.height) == (side, side)


def test_only_the_stripes_that_the_detail_can_hold_are_left():
    fine = stripes(448, 448, 2)  # one pixel wide: gone where 448 pixels become 224
    assert contrast(shown_picture(fine, Eyes.TILE_1).data) > 250
    assert contrast(shown_picture(fine, Eyes.BLUR_224).data) < 20
    assert contrast(shown_picture(fine, Eyes.NATIVE_224).data) < 20
    coarse = stripes(448, 448, 16)
    for eyes in Eyes:
        assert contrast(shown_picture(coarse, eyes).data) > 200, eyes


def test_blur_shows_what_native_224_shows_enlarged():
    picture = stripes(640, 480, 24)
    blurred, small = (shown_picture(picture, e) for e in (Eyes.BLUR_224, Eyes.NATIVE_224))
    with Image.open(io.BytesIO(small.data)) as image:
        enlarged = np.asarray(image.resize((448, 448), Image.Resampling.BICUBIC))
    with Image.open(io.BytesIO(blurred.data)) as image:
        assert np.array_equal(np.asarray(image), enlarged)
    assert blurred.detail == small.detail == (224, 224)


def test_a_point_keeps_its_fraction_of_the_picture():
    array = np.zeros((480, 640, 3), np.uint8)
    array[350:370, 150:170] = 255  # middle at fractions 0.25, 0.75
    for eyes in (Eyes.TILE_1, Eyes.BLUR_224, Eyes.NATIVE_224):
        shown = shown_picture(png(array), eyes)
        with Image.open(io.BytesIO(shown.data)) as image:
            y, x = np.argwhere(np.asarray(image.convert("L")) > 128).mean(0)
        assert (x + 0.5) / shown.width == pytest.approx(0.25, abs=0.005)
        assert (y + 0.5) / shown.height == pytest.approx(0.75, abs=0.005)


def test_a_small_picture_gains_no_detail():
    assert shown_picture(stripes(100, 80, 8), Eyes.TILE_1).detail == (100, 80)
    assert size_in_detail((10, 10), (100, 80), Eyes.TILE_1) == 10


def test_sizes_shrink_with_the_picture():
    assert size_in_detail((64, 36), (640, 360), Eyes.NATIVE) == pytest.approx(48)
    assert size_in_detail((64, 36), (640, 360), Eyes.NATIVE_224) == pytest.approx((22.4 * 22.4) ** 0.5)
    assert size_in_detail((64, 36), (640, 360), Eyes.BLUR_224) == size_in_detail((64, 36), (640, 360), Eyes.NATIVE_224)
    # A picture of 360 rows is enlarged to the tile's 448: its rows keep their detail.
    assert size_in_detail((64, 36), (640, 360), Eyes.TILE_1) == pytest.approx((64 * 448 / 640 * 36) ** 0.5)


def test_something_that_is_not_a_picture_is_refused():
    with pytest.raises(OSError, match="cannot identify"):
        shown_picture(b"not a picture", Eyes.TILE_1)


def test_the_sheet_has_one_square_per_eyes():
    with Image.open(io.BytesIO(contact_sheet(stripes(640, 480, 8)))) as sheet:
        assert sheet.width > 4 * 448
        assert np.asarray(sheet).std() > 50


# Measured with transformers and max_patches=6; 256 tokens per tile.
@pytest.mark.parametrize(
    ("size", "grid", "tokens"),
    [
        ((640, 480), Grid(3, 2), 1792), ((1280, 720), Grid(2, 1), 768), ((1920, 1080), Grid(2, 1), 768),
        ((448, 448), Grid(1, 1), 256), ((224, 224), Grid(1, 1), 256), ((300, 1000), Grid(1, 3), 1024),
    ],
)  # fmt: skip
def test_tiles_of_pictures_in_use(size, grid, tokens):
    assert grid_of(*size, most=6) == grid
    assert grid.tokens(448) == tokens


def test_a_large_picture_takes_the_larger_of_two_grids_of_the_same_shape():
    assert grid_of(448, 448, most=4) == Grid(1, 1)
    assert grid_of(900, 900, most=4) == Grid(2, 2)


def test_a_tile_of_224_costs_64_tokens():
    assert Grid(1, 1).tokens(224) == 64


def test_a_number_of_tiles_that_is_no_number_of_tiles():
    with pytest.raises(InvalidInputError, match="max-tiles"):
        grid_of(640, 480, most=0)
