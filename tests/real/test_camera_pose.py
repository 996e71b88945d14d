"""The camera's pose from the printed markers: measured on renderings at known poses, and refused where it would lie."""

import json
import re
import struct
import sys
import warnings
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image
from tests.daily import others_slow
from tests.real.sheet_scene import mount_at, rendered, sheet_picture

from betterbench.cli.main import main
from betterbench.errors import InvalidInputError, MissingDependencyError
from betterbench.interface.actions import SO101_DEGREES
from betterbench.real.sheet import annotated as annotated_module
from betterbench.real.sheet import camera_pose, images
from betterbench.real.sheet.camera_pose import correction_of, measure_camera, mounted, twin_camera
from betterbench.real.sheet.layout import MARKERS_MM, SHEET, TILES, corners_mm
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.cameras import camera_matrices
from betterbench.tasks.interventions.resolve import resolve_condition

pytestmark = pytest.mark.render
POSES = {
    "placed": mount_at(),
    "moved": mount_at((3.0, -2.0, 4.0), tilt=3.0, pan=-2.0, roll=4.0),
    "narrow": mount_at((-5.0, 5.0, 0.0), tilt=2.0, pan=5.0, fovy_deg=45.0),
    "wide": mount_at((0.0, 0.0, 10.0), tilt=-5.0, fovy_deg=60.0),
    "far": mount_at((8.0, -6.0, 5.0), tilt=-1.0, pan=-3.0, roll=-2.0, fovy_deg=50.0),
    "upside down": mount_at((1.0, 1.0, 1.0), roll=180.0),
}


@pytest.fixture(scope="module")
def pictures():
    """The picture of a pose by its name, which is rendered when it is first asked for."""

    class Pictures(dict):
        def __missing__(self, name):
            self[name] = rendered(POSES[name])
            return self[name]

    return Pictures()


def errors_of(image, mount, **options):
    """Return the error of the position [mm], of the direction [degree], and the measured camera."""
    found = measure_camera(image, **options)
    off = correction_of(found.pose, mounted(mount))
    return 1000.0 * off.distance_m, off.angle_deg, found


def distorted(image, k1, fovy_deg):
    """Return an image as a lens with a radial distortion would take it."""
    height, width = image.shape[:2]
    focal = 0.5 * height / np.tan(0.5 * np.radians(fovy_deg))
    center = np.array([0.5 * (width - 1), 0.5 * (height - 1)])
    K = np.array([[focal, 0.0, center[0]], [0.0, focal, center[1]], [0.0, 0.0, 1.0]])
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 1, 2).astype(np.float32)
    source = (cv2.undistortPoints(grid, K, np.array([k1, 0.0, 0.0, 0.0]))[:, 0] * focal + center).astype(np.float32)
    u, v = source.reshape(height, width, 2).transpose(2, 0, 1)
    return cv2.remap(image, np.ascontiguousarray(u), np.ascontiguousarray(v), cv2.INTER_LINEAR)


def noisy(image, level, seed=0):
    noise = np.random.default_rng(seed).normal(0.0, level, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def test_the_pose_of_the_twin_is_that_of_its_scene():
    setting = resolve_condition("fruit_basket", "train1")
    scene = Scene(setting.task, setting.condition, seed=0, action_space=SO101_DEGREES, steady_views=True)
    scene.reset(check_premise=False)
    there = camera_matrices(scene.model, scene.data, "front", width=640, height=480)
    pose = twin_camera()
    assert np.allclose(pose.position_m, there.T_world_camera.position)
    point = pose.position_m + pose.axes @ [0.1, 0.05, 0.5]
    pixel, _ = there.project(point[None])
    focal = 240.0 / np.tan(np.radians(0.5 * pose.fovy_deg))
    assert np.allclose(pixel, [[319.5 + 0.2 * focal, 239.5 + 0.1 * focal]])


@pytest.mark.parametrize("name", others_slow(POSES, 3))
def test_known_poses_are_measured_to_millimeters(pictures, name):
    off_mm, off_deg, found = errors_of(pictures[name], POSES[name])
    assert off_mm < 5.0
    assert off_deg < 0.2
    assert abs(found.pose.fovy_deg - POSES[name].fovy_deg) < 0.4
    assert found.error_px < 0.8
    assert len(found.corners_px) >= 9
    fixed_mm, fixed_deg, _ = errors_of(pictures[name], POSES[name], fovy_deg=POSES[name].fovy_deg)
    assert fixed_mm < 4.0
    assert fixed_deg < 0.2


@pytest.mark.parametrize(
    ("change", "most_mm"),
    [
        (lambda image, _: noisy(image, 8.0), 6.0),
        (lambda image, _: noisy(image, 20.0), 10.0),
        (lambda image, _: cv2.GaussianBlur(image, (0, 0), 1.0), 8.0),
        (lambda image, mount: distorted(image, -0.2, mount.fovy_deg), 8.0),
        (lambda image, mount: distorted(image, 0.05, mount.fovy_deg), 6.0),
        (lambda image, _: (0.35 * image).astype(np.uint8), 7.0),
        (lambda image, _: np.clip(1.3 * image * [1.0, 0.9, 0.75], 0, 255).astype(np.uint8), 7.0),
    ],
    ids=["noise", "strong noise", "slight blur", "barrel", "pincushion", "dark", "warm light"],
)
@pytest.mark.parametrize("name", others_slow(["placed", "moved", "narrow"], 3))
def test_worse_images_are_measured_nearly_as_well(pictures, name, change, most_mm):
    off_mm, off_deg, _ = errors_of(change(pictures[name], POSES[name]), POSES[name])
    assert off_mm < most_mm
    assert off_deg < 0.4


@pytest.mark.parametrize("name", others_slow(["placed", "moved"], 2))
@pytest.mark.parametrize("sigma", [2.5, 4.0, 8.0])
def test_a_blurred_image_is_refused_as_blurred(pictures, name, sigma):
    with pytest.raises(InvalidInputError, match=r"pixels wide.*Focus the camera"):
        measure_camera(cv2.GaussianBlur(pictures[name], (0, 0), sigma))


def test_the_way_to_the_twin_undoes_what_was_done(pictures):
    found = measure_camera(pictures["moved"])
    correction = correction_of(found.pose, twin_camera())
    assert np.allclose(100.0 * correction.move_m, [-3.0, 2.0, -4.0], atol=0.4)
    assert not correction.is_near
    move, turn = correction.sentences
    assert re.search(r"(3\.[6-9]|4\.[0-4]) cm down", move)
    assert re.search(r"cm toward the arm", move)
    assert re.search(r"cm to the arm's left", move)
    for part in ("tilt it down by", "turn it to its right by", "roll it counterclockwise"):
        assert part in turn
    for tilt, pan, roll, says in ((2, 0, 0, "tilt it down"), (0, -2, 0, "turn it to its right"), (0, 0, 2, "counterc")):
        (only,) = correction_of(mounted(mount_at(tilt=tilt, pan=pan, roll=roll)), twin_camera()).sentences
        assert says in only
        assert "by 2.0 degrees" in only
    assert correction_of(twin_camera(), twin_camera()).sentences == ()
    assert correction_of(measure_camera(pictures["placed"]).pose, twin_camera()).is_near


def test_a_mirrored_image_is_refused(pictures):
    with pytest.raises(InvalidInputError, match="it is mirrored"):
        measure_camera(np.ascontiguousarray(pictures["placed"][:, ::-1]))


def test_too_few_markers_are_refused(pictures):
    image = pictures["placed"].copy()
    with pytest.raises(InvalidInputError, match=r"0 of the sheet's 13 markers found, 5 needed\. Point the camera"):
        measure_camera(rendered(POSES["placed"], picture=np.full((40, 80), 255, np.uint8)))
    image[270:] = 200
    image[:, 400:] = 200
    with pytest.raises(InvalidInputError, match=r"[1-4] of the sheet's 13 markers found, 5 needed"):
        measure_camera(image)


@pytest.mark.parametrize("ruler", [97.0, 103.0, 88.0, 1000.0])
def test_a_sheet_of_another_scale_is_refused_by_its_ruler(pictures, ruler):
    with pytest.raises(InvalidInputError, match="Print the sheet again at 100 %"):
        measure_camera(pictures["placed"], ruler_mm=ruler)


def test_a_ruler_within_a_percent_corrects_the_scale():
    image = rendered(POSES["placed"], scale=0.991)
    blind, _, _ = errors_of(image, POSES["placed"])
    off_mm, _, _ = errors_of(image, POSES["placed"], ruler_mm=99.1)
    assert off_mm < 5.0
    assert off_mm < blind


def test_pages_that_were_printed_smaller_and_laid_at_their_places_are_refused():
    whole = sheet_picture()
    small, px = np.full_like(whole, 255), 4.0
    for x, y in MARKERS_MM:  # each marker shrinks about its own center
        u, v = (SHEET.y_high - y) * px, (SHEET.x_high - x) * px
        half, less = 120 + 20, round(0.94 * 140)
        patch = whole[round(v) - half : round(v) + half, round(u) - half : round(u) + half]
        patch = cv2.resize(patch, (2 * less, 2 * less), interpolation=cv2.INTER_AREA)
        small[round(v) - less : round(v) + less, round(u) - less : round(u) + less] = patch
    with pytest.raises(InvalidInputError, match=r"markers have 9[3-5]\.\d % of the size that their distances imply"):
        measure_camera(rendered(POSES["placed"], picture=small))


def test_pages_that_are_laid_wrongly_are_refused():
    whole = sheet_picture()
    wrong = whole.copy()
    wrong[:, -1020:] = np.roll(whole[:, -1020:], 40, axis=0)  # the right pages lie 10 mm nearer
    with pytest.raises(InvalidInputError, match=r"markers deviate by .* pixels, marker"):
        measure_camera(rendered(POSES["placed"], picture=wrong))


def part(tile):
    """Return the part of the sheet's picture with a page."""
    rows = slice(round(4 * (SHEET.x_high - tile.x_high)), round(4 * (SHEET.x_high - tile.x_low)))
    return rows, slice(round(4 * (SHEET.y_high - tile.y_high)), round(4 * (SHEET.y_high - tile.y_low)))


@pytest.mark.parametrize("page", others_slow([1, 2, 3, 4, 6], 5))
def test_a_page_that_is_turned_around_is_named(page):
    whole = sheet_picture().copy()
    there = part(TILES[page - 1])
    whole[there] = whole[there][::-1, ::-1].copy()
    with pytest.raises(
        InvalidInputError, match=rf"sheet: page {page} is turned around\. Arrange the pages as shown on"
    ):
        measure_camera(rendered(POSES["placed"], picture=whole))


@pytest.mark.parametrize(("one", "other"), others_slow([(1, 2), (1, 4), (2, 5), (3, 6), (5, 6)], 5))
def test_pages_that_are_swapped_are_named(one, other):
    whole = sheet_picture().copy()
    first, second = part(TILES[one - 1]), part(TILES[other - 1])
    whole[first], whole[second] = whole[second].copy(), whole[first].copy()
    says = f"page {one} is at the position of page {other}; page {other} is at the position of page {one}"
    with pytest.raises(InvalidInputError, match=says):
        measure_camera(rendered(POSES["placed"], picture=whole))


@pytest.mark.parametrize("name", others_slow(["placed", "moved", "wide", "far", "upside down"], 5))
def test_the_near_row_of_pages_alone_does_not_place_a_camera(name):
    half = np.full_like(sheet_picture(), 255)
    for tile in TILES[3:]:
        half[part(tile)] = sheet_picture()[part(tile)]
    with pytest.raises(
        InvalidInputError, match=r"uncertain by [12]\.\d cm\. Move the camera so that it sees more markers"
    ):
        measure_camera(rendered(POSES[name], picture=half))


@pytest.mark.parametrize("fovy_deg", [10.0, 40.0, 56.0, 70.0, 150.0])
def test_a_lens_that_does_not_fit_is_blamed_on_its_option(pictures, fovy_deg):
    with pytest.raises(InvalidInputError, match=r"--fovy-deg: \d+ degrees do not match the image, which shows 52\.\d"):
        measure_camera(pictures["placed"], fovy_deg=fovy_deg)


@pytest.mark.parametrize(
    ("ruler", "says"),
    [
        (10.0, "seems to be in centimeters. Pass the length in millimeters: 100.0"),
        (3.94, "seems to be in inches. Pass the length in millimeters: 100.1"),
        (0.1, "seems to be in meters. Pass the length in millimeters: 100.0"),
        (0.0, "expected a positive length in millimeters, got 0. Measure"),
        (-100.0, "expected a positive length in millimeters, got -100"),
        (float("nan"), "positive length in millimeters, got nan"),
        (float("inf"), "positive length in millimeters, got inf"),
    ],
)
def test_a_ruler_in_another_unit_does_not_ask_for_another_print(pictures, ruler, says):
    with pytest.raises(InvalidInputError, match=re.escape(says)):
        measure_camera(pictures["placed"], ruler_mm=ruler)


def test_a_small_or_an_empty_image_is_not_called_blurred(pictures):
    with pytest.raises(InvalidInputError, match=r"with 160 x 120 pixels, it is too small"):
        measure_camera(cv2.resize(pictures["placed"], (160, 120), interpolation=cv2.INTER_AREA))
    with pytest.raises(InvalidInputError, match=r"its brightness is nearly uniform\. Take the cap off the lens"):
        measure_camera(np.zeros((480, 640, 3), np.uint8))


@pytest.mark.parametrize(
    ("options", "says"),
    others_slow(
        [
            ({"move_cm": (4, 0, 0)}, r"[34]\.\d cm toward the arm"),
            ({"move_cm": (-4, 0, 0)}, r"[34]\.\d cm away from the arm"),
            ({"move_cm": (0, 4, 0)}, r"[34]\.\d cm to the arm's right"),
            ({"move_cm": (0, -4, 0)}, r"[34]\.\d cm to the arm's left"),
            ({"move_cm": (0, 0, 4)}, r"[34]\.\d cm down"),
            ({"move_cm": (0, 0, -4)}, r"[34]\.\d cm up"),
            ({"tilt": 3.0}, r"tilt it down by [23]\.\d"),
            ({"tilt": -3.0}, r"tilt it up by [23]\.\d"),
            ({"pan": 3.0}, r"turn it to its left by [23]\.\d"),
            ({"pan": -3.0}, r"turn it to its right by [23]\.\d"),
            ({"roll": 5.0}, r"roll it counterclockwise \(seen from behind it\) by [45]\.\d"),
            ({"roll": -5.0}, r"roll it clockwise \(seen from behind it\) by [45]\.\d"),
        ],
        4,
    ),
)
def test_each_direction_is_named_as_it_is_rendered(options, says):
    correction = correction_of(measure_camera(rendered(mount_at(**options))).pose, twin_camera())
    assert re.search(says, " ".join(correction.sentences))


def test_a_marker_that_is_seen_twice_is_refused(pictures):
    image = pictures["placed"].copy()
    image[360:440, 20:120] = image[290:370, 0:100]
    with pytest.raises(InvalidInputError, match=r"marker [05] occurs twice in the image"):
        measure_camera(image)


@pytest.mark.parametrize(
    "image", [np.zeros((480, 640), np.uint8), np.zeros((480, 640, 3)), np.zeros((8, 8, 3), np.uint8)]
)
def test_other_arrays_are_refused(image):
    with pytest.raises(InvalidInputError, match="Use a color image"):
        measure_camera(image)


def test_larger_images_are_measured_too():
    image = rendered(POSES["moved"], size=(1280, 960))
    off_mm, off_deg, _ = errors_of(image, POSES["moved"])
    assert off_mm < 3.0
    assert off_deg < 0.15


def write(path, image):
    Image.fromarray(image).save(path)
    return str(path)


def test_the_command_says_how_far_and_which_way(pictures, tmp_path, capsys):
    assert main(["real", "check-cameras", write(tmp_path / "a.png", pictures["placed"]), "--ruler-mm", "100"]) == 0
    told = capsys.readouterr().out
    assert "none, the pose is correct" in told
    assert re.search(r"reprojection error 0\.\d\d px", told)
    moved = write(tmp_path / "b.jpg", pictures["moved"])
    with pytest.raises(SystemExit) as status:
        main(["real", "check-cameras", moved, "--ruler-mm", "100"])
    assert status.value.code == 1
    told = capsys.readouterr().out
    assert re.search(r"offset +(4\.[6-9]|5\.\d) cm and 5\.\d degrees", told)
    assert "cm down" in told
    with pytest.raises(SystemExit):
        main(["real", "check-cameras", moved, "--ruler-mm", "100", "--json"])
    form = json.loads(capsys.readouterr().out)
    assert form["placed"] is False
    assert form["distance_m"] == pytest.approx(0.0539, abs=0.005)
    with pytest.raises(SystemExit):
        main(["real", "check-cameras", write(tmp_path / "c.png", pictures["wide"]), "--ruler-mm", "100"])
    assert "The lens is wider than the twin's" in capsys.readouterr().out


def test_the_command_draws_what_it_found_and_the_places_of_the_twin(pictures, tmp_path, capsys):
    moved, out = write(tmp_path / "moved.png", pictures["moved"]), tmp_path / "seen.png"
    words = ["real", "check-cameras", moved, "--ruler-mm", "100", "--out", str(out)]
    with pytest.raises(SystemExit):
        main(words)
    assert f"wrote {out}" in capsys.readouterr().err
    drawn = np.asarray(Image.open(out).convert("RGB")).astype(int)
    assert drawn.shape[1] == 640
    assert drawn.shape[0] > 480  # a legend below the image
    found = measure_camera(pictures["moved"])
    for corners in found.corners_px.values():  # the outline of a marker runs through its corners
        for u, v in corners.round().astype(int):
            near = drawn[max(v - 2, 0) : v + 3, max(u - 2, 0) : u + 3].reshape(-1, 3)
            assert np.abs(near - [40, 220, 90]).sum(axis=1).min() < 60
    (tmp_path / "other.png").write_bytes(b"mine")
    assert main([*words[:-1], str(tmp_path / "other.png")]) != 0
    assert (tmp_path / "other.png").read_bytes() == b"mine"
    assert main([*words[:-1], str(tmp_path / "seen.gif")]) == 2
    assert "ends with .png or .jpg" in " ".join(capsys.readouterr().err.split())


def test_in_the_image_of_a_placed_camera_both_outlines_of_a_marker_are_the_same(pictures):
    found = measure_camera(pictures["placed"])
    off = []
    for marker, corners in found.corners_px.items():
        points = np.column_stack([0.001 * corners_mm(marker), np.zeros(4)])
        off.append(np.abs(annotated_module._seen(points, twin_camera(), (480, 640)) - corners).max())
    assert max(off) < 2.0


def test_the_command_refuses_what_is_no_image(tmp_path, capsys):
    (tmp_path / "a.png").write_text("no image")
    for words, says in (
        ([str(tmp_path / "a.png")], "the file cannot be read as PNG or JPEG"),
        ([str(tmp_path / "b.png")], "b.png"),
        ([], "Pass either one image file or --camera 0"),
        ([str(tmp_path / "a.png"), "--camera", "0"], "Pass either one image file or --camera 0"),
        (["--camera", "/nowhere/video"], "sends no frames"),
    ):
        assert main(["real", "check-cameras", *words, "--ruler-mm", "100"]) == 2
        assert says in " ".join(capsys.readouterr().err.split())


def orientation(value):
    exif = Image.Exif()
    exif[0x112] = value
    return exif


def test_photographs_of_other_kinds_are_read_as_viewers_show_them(pictures, tmp_path):
    picture = Image.fromarray(pictures["placed"])
    gray = np.asarray(picture.convert("L"))
    picture.rotate(90, expand=True).save(tmp_path / "turned.jpg", exif=orientation(6), quality=95)
    picture.rotate(180).save(tmp_path / "upside_down.jpg", exif=orientation(3), quality=95)
    picture.convert("RGBA").save(tmp_path / "alpha.png")
    picture.convert("CMYK").save(tmp_path / "cmyk.jpg", quality=95)
    Image.fromarray(gray).save(tmp_path / "gray.png")
    Image.fromarray(gray.astype(np.uint16) * 257).save(tmp_path / "deep.png")
    Image.fromarray(gray.astype(np.uint16) * 16).save(tmp_path / "twelve_bits.png")
    for path in sorted(tmp_path.iterdir()):
        image = images.image_of(path)
        assert image.shape == (480, 640, 3), path
        assert correction_of(measure_camera(image).pose, twin_camera()).is_near, path


def bits_png(width, height):
    """Return a PNG of one bit per pixel with the first row alone: whoever decodes it finds that it is cut off."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    row = zlib.compress(b"\0" + b"\xff" * (width // 8))
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", row) + chunk(b"IEND", b"")


@pytest.mark.parametrize("size", [(13000, 13000), (9000, 9000), (20000, 20000)])
def test_an_image_with_too_many_pixels_is_refused_before_it_is_decoded(tmp_path, size):
    path = tmp_path / "bomb.png"
    path.write_bytes(bits_png(*size))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InvalidInputError, match=r"pixels\. Use an image of at most 64 million pixels"):
            images.image_of(path)


@pytest.mark.parametrize("camera", ["²", "9" * 20, "-1"])
def test_a_camera_that_is_no_index_sends_no_frames(capsys, camera):
    assert main(["real", "check-cameras", "--camera", camera, "--ruler-mm", "100"]) == 2
    assert "sends no frames" in " ".join(capsys.readouterr().err.split())


def test_the_command_notes_a_squeezed_image_and_a_sheet_that_is_turned_around(pictures, tmp_path, capsys):
    squeezed = cv2.resize(pictures["placed"], (640, 360))
    with pytest.raises(SystemExit):
        main(["real", "check-cameras", write(tmp_path / "a.png", squeezed), "--ruler-mm", "100", "--json"])
    assert "640 x 360 pixels, expected an aspect ratio of 4:3" in json.loads(capsys.readouterr().out)["notes"][-1]
    turned = rendered(POSES["placed"], picture=sheet_picture()[::-1, ::-1].copy())
    with pytest.raises(SystemExit):
        main(["real", "check-cameras", write(tmp_path / "b.png", turned), "--ruler-mm", "100"])
    told = " ".join(capsys.readouterr().out.split())
    assert "cm behind the arm" in told
    assert "rotate the sheet by 180 degrees" in told


def test_without_opencv_the_extra_is_named(pictures, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(MissingDependencyError, match="real"):
        measure_camera(pictures["placed"])


class Capture:
    """A camera of OpenCV that sends one image."""

    image = np.zeros((480, 640, 3), np.uint8)

    def __init__(self, source):
        self.source = source

    def set(self, *_):
        return True

    def read(self):
        return True, self.image

    def release(self):
        pass


def test_a_live_frame_is_taken_in_rgb_and_in_the_size_of_the_trials(pictures, monkeypatch):
    monkeypatch.setattr(camera_pose.opencv(), "VideoCapture", Capture)
    monkeypatch.setattr(Capture, "image", np.ascontiguousarray(pictures["placed"][..., ::-1]))
    assert np.array_equal(images.live_image("0", (640, 480)), pictures["placed"])
    with pytest.raises(InvalidInputError, match="sends images of 640 x 480 pixels instead of 1280 x 720"):
        images.live_image("/dev/video2", (1280, 720))
