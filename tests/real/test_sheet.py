"""The marker sheet is true to scale: sizes are read back from its SVG and PDF, and a detector finds its markers."""

import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from tests.real.sheet_scene import PX_PER_MM, SVG, filled_rectangles, picture_of

from betterbench.cli.main import main
from betterbench.errors import UnknownNameError
from betterbench.real.sheet.drawing import POINTS_PER_MM, Circle, pdf, svg
from betterbench.real.sheet.layout import (
    BASE_MM,
    BASKET_MM,
    CELLS,
    DICTIONARY,
    MARKER_MM,
    MARKERS_MM,
    QUIET_MM,
    SHEET,
    TILES,
    cells_of,
    corners_mm,
    spots,
)
from betterbench.real.sheet.pages import PAPERS_MM, sheet_pages
from betterbench.sim.assets import build_unpainted, looks
from betterbench.sim.robots.so101 import build_so101
from betterbench.tasks import get_task

DETECTOR = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY)))
PAPERS = (*PAPERS_MM, "whole")


def pdf_pages(data):
    """Return (width_mm, height_mm, operators) of each page of a PDF."""
    text = data.decode("ascii")
    objects = {int(number): body for number, body in re.findall(r"(\d+) 0 obj\n(.*?)\nendobj", text, re.DOTALL)}
    kids = re.search(r"/Kids \[(.*?)\]", objects[2])[1]
    found = []
    for number in re.findall(r"(\d+) 0 R", kids):
        page = objects[int(number)]
        width, height = re.search(r"/MediaBox \[0 0 (\S+) (\S+)\]", page).groups()
        content = objects[int(re.search(r"/Contents (\d+) 0 R", page)[1])]
        stream = re.search(r"stream\n(.*)endstream", content, re.DOTALL)[1]
        assert int(re.search(r"/Length (\d+)", content)[1]) == len(stream)
        found.append((float(width) / POINTS_PER_MM, float(height) / POINTS_PER_MM, stream.splitlines()))
    return found


def pdf_rectangles(operators):
    """Return (x, y, width, height, gray) of the filled rectangles of a page in millimeters on paper, from its top."""
    a, b, c, d, *_ = map(float, operators[0].split()[:6])
    assert (b, c) == (0.0, 0.0)
    assert a == -d
    mm = a / POINTS_PER_MM  # a unit of the page on paper
    found = []
    for line in operators:
        match = re.fullmatch(r"(\S+) g (\S+) (\S+) (\S+) (\S+) re f", line)
        if match:
            gray, *box = map(float, match.groups())
            found.append((*(mm * v for v in box), gray))
    return found


def marker_squares(rectangles):
    """Return the black squares of a marker's size."""
    return [r for r in rectangles if r[4] == 0 and abs(r[2] - r[3]) < 1e-6 and r[2] > 40.0]


@pytest.mark.parametrize("paper", PAPERS)
def test_pages_and_markers_have_their_size_on_paper(paper):
    pages = sheet_pages(paper)
    read = pdf_pages(pdf(pages))
    assert len(read) == len(pages) == (1 if paper == "whole" else 7)
    expected = PAPERS_MM.get(paper, (795.0, 410.0))
    count = 0
    for page, (width, height, operators) in zip(pages, read, strict=True):
        root = ET.fromstring(svg(page))  # noqa: S314 - our own
        size = (root.get("width"), root.get("height"))
        assert size == tuple(f"{v:g}mm" for v in expected)
        assert root.get("viewBox") == f"0 0 {expected[0]:g} {expected[1]:g}"
        assert (width, height) == pytest.approx(expected, abs=0.01)
        in_svg = marker_squares([(*r[:4], r[4] / 255) for r in filled_rectangles(svg(page))])
        in_pdf = marker_squares(pdf_rectangles(operators))
        assert len(in_svg) == len(in_pdf)
        for one, other in zip(in_svg, in_pdf, strict=True):
            assert one == pytest.approx(other, abs=0.002)
            assert one[2:4] == pytest.approx((MARKER_MM, MARKER_MM), abs=0.002)
        left, top, wide, high = page.clip
        count += sum(
            left <= x and top <= y and x + w <= left + wide and y + h <= top + high for x, y, w, h, _ in in_svg
        )
    assert count == len(MARKERS_MM)  # each one lies on one page, whole


@pytest.mark.parametrize("paper", PAPERS)
def test_markers_are_found_at_their_places_with_their_numbers(paper):
    """The pages are painted from their SVG, and the markers measured by the detector that reads photographs."""
    areas = [SHEET] if paper == "whole" else TILES
    pages = sheet_pages(paper)[-len(areas) :]
    seen = {}
    for area, page in zip(areas, pages, strict=True):
        left, top, *_ = page.clip
        corners, numbers, _ = DETECTOR.detectMarkers(picture_of(page))
        for number, points in zip(numbers.ravel().tolist(), corners, strict=True):
            on_page = (points[0] + 0.5) / PX_PER_MM
            seen[number] = np.column_stack([area.x_high - (on_page[:, 1] - top), area.y_high - (on_page[:, 0] - left)])
    assert sorted(seen) == list(range(len(MARKERS_MM)))
    for number, found in seen.items():
        assert np.abs(found - corners_mm(number)).max() < 0.5, number
    between = np.linalg.norm(seen[2].mean(axis=0) - seen[6].mean(axis=0))
    assert between == pytest.approx(665.0, abs=0.5)


def test_cells_are_those_of_the_dictionary():
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    for number in range(len(CELLS)):
        image = cv2.aruco.generateImageMarker(dictionary, number, 60)
        assert np.array_equal(image.reshape(6, 10, 6, 10)[1:5, 5, 1:5, 5] > 127, cells_of(number)), number


@pytest.mark.parametrize("paper", PAPERS)
def test_rulers_are_a_hundred_millimeters_in_both_directions(paper):
    for page in sheet_pages(paper)[-6:]:
        lines = list(ET.fromstring(svg(page)).iter(f"{SVG}line"))[-24:]  # noqa: S314 - our own
        sizes = [tuple(abs(float(e.get(f"{axis}2")) - float(e.get(f"{axis}1"))) for axis in "xy") for e in lines]
        assert (100.0, 0.0) in sizes
        assert (0.0, 100.0) in sizes


def test_tiles_cover_the_sheet_and_nothing_twice():
    assert sum(t.width * t.depth for t in TILES) == pytest.approx(SHEET.width * SHEET.depth)
    centers = {(0.5 * (t.x_low + t.x_high), 0.5 * (t.y_low + t.y_high)) for t in TILES}
    assert len(centers) == len(TILES)
    for width, height in PAPERS_MM.values():  # 6 mm for the printer's margin, and the rulers
        assert all(t.width + 2 * 10.0 <= width and t.depth + 2 * 10.0 <= height for t in TILES)


def test_markers_are_clear_of_slots_basket_base_and_cuts():
    places = spots()
    basket = next(s for s in places if s.name == "stand")
    for number, (x, y) in enumerate(MARKERS_MM):
        half = 0.5 * MARKER_MM
        for spot in places:
            gap = np.hypot(max(abs(spot.x - x) - half, 0.0), max(abs(spot.y - y) - half, 0.0)) - spot.radius
            assert gap >= QUIET_MM, (number, spot.name)
        ring = np.hypot(max(abs(basket.x - x) - half, 0.0), max(abs(basket.y - y) - half, 0.0))
        assert ring >= 0.5 * BASKET_MM, number
        assert x - half - QUIET_MM >= BASE_MM[1] or abs(y) - half - QUIET_MM >= BASE_MM[2], number
        (tile,) = [t for t in TILES if t.x_low < x < t.x_high and t.y_low < y < t.y_high]
        cut = min(x - tile.x_low, tile.x_high - x, y - tile.y_low, tile.y_high - y) - half
        assert cut >= 8.0, number


def test_slots_and_basket_are_those_of_the_twin():
    drawn = [(s.name, s.x, s.y, s.radius) for s in spots()]
    assert drawn == [(s.name, 1000 * s.x, 1000 * s.y, 1000 * s.jitter_m) for s in get_task("fruit_basket").slots]
    widest = max(1000 * build_unpainted("fruit_basket", look=look).size_m[0] for look in looks("fruit_basket"))
    assert 0.0 <= BASKET_MM - widest < 1.0
    (page,) = sheet_pages("whole")
    radii = [shape.radius for shape in page.within if isinstance(shape, Circle)]
    assert radii.count(0.5 * BASKET_MM) == 1
    assert len(radii) == len(spots()) + 1


def test_the_foot_of_the_base_is_that_of_the_twin():
    model = build_so101().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    points = []
    for geom in range(model.ngeom):
        mesh = model.geom_dataid[geom]
        if mesh >= 0 and model.body(model.geom_bodyid[geom]).name == "base":
            start = model.mesh_vertadr[mesh]
            vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
            points.append(vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    points = 1000.0 * np.concatenate(points)
    foot = points[points[:, 2] < 15.0]
    low, high = foot.min(axis=0), foot.max(axis=0)
    assert (low[0], high[0], high[1], -low[1]) == pytest.approx((*BASE_MM, BASE_MM[2]), abs=0.1)


def test_the_command_writes_the_pages_and_replaces_only_its_own(tmp_path, capsys):
    out = tmp_path / "sheet"
    for _ in range(2):
        assert main(["real", "sheet", "--out", str(out), "--paper", "letter"]) == 0
    assert str(out / "sheet_letter.pdf") in capsys.readouterr().out
    names = sorted(p.name for p in out.iterdir() if not p.name.startswith("."))
    assert names == ["sheet_letter.pdf", *(f"sheet_letter_{k}.svg" for k in range(7))]
    assert (out / "sheet_letter.pdf").read_bytes() == pdf(sheet_pages("letter"))
    assert b"/PrintScaling /None" in (out / "sheet_letter.pdf").read_bytes()
    foreign = tmp_path / "mine"
    foreign.mkdir()
    (foreign / "thesis.pdf").write_text("mine")
    assert main(["real", "sheet", "--out", str(foreign)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    with pytest.raises(UnknownNameError, match="a4"):
        sheet_pages("a5")


@pytest.mark.slow
def test_a_browser_shows_the_pages_so_that_markers_are_found(tmp_path):
    sys.path.insert(0, str(Path(__file__).parents[1] / "report"))
    from chromium import COMMAND, browser

    if COMMAND is None:
        pytest.skip("no Chromium is installed")
    found = set()
    for k, page in enumerate(sheet_pages("a4")[1:], start=1):
        path = tmp_path / f"{k}.svg"
        path.write_text(svg(page))
        with browser(tmp_path / f"profile{k}") as chromium:
            chromium.open(path, 1123, 794)  # A4 at 96 pixels per inch
            (tmp_path / "page.png").write_bytes(chromium.screenshot())
        image = cv2.imread(str(tmp_path / "page.png"), cv2.IMREAD_GRAYSCALE)
        corners, numbers, _ = DETECTOR.detectMarkers(image)
        for number, points in zip(numbers.ravel().tolist(), corners, strict=True):
            found.add(number)
            edges = np.linalg.norm(points[0] - np.roll(points[0], 1, axis=0), axis=1)
            assert edges == pytest.approx(MARKER_MM * 96 / 25.4, abs=2.5)
    assert found == set(range(len(MARKERS_MM)))
