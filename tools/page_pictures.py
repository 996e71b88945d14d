"""Take screenshots of our pages for the documentation, in a headless Chromium.

The report covers the full suite with one trial per variation, and its section on knowledge a run with a model's
answers. The teleoperation page shows two packed items, and the review page a mug that was set upright. The page of a
real arm shows a scene of the mock. The judge's page shows a film of a simulated protocol, after one entry.

Example:
    better eval --policy zoo:lexical --trials 1 --out runs/lexical
    better report runs/lexical
    python tools/page_pictures.py report runs/lexical/report/index.html --out docs/pictures/report.jpg
    python tools/page_pictures.py knowledge runs/mine/report/index.html --out docs/pictures/knowing.png
    python tools/page_pictures.py teleop runs/by_hand --out docs/pictures/teleop.jpg
    python tools/page_pictures.py review runs/review --out docs/pictures/review.jpg
    python tools/page_pictures.py real runs/bench --out docs/pictures/real.jpg
    better eval --suite real_world --tasks fruit_basket --robot so101 --policy zoo:phase --trials 1 --out runs/phase
    python tools/simulated_protocol.py runs/judged --run zoo:phase=runs/phase --films 480 --judges 0
    better real sheet --out runs/sheet
    python tools/page_pictures.py sheet runs/sheet/sheet_a4_0.svg --out docs/pictures/real-sheet.jpg
    python tools/page_pictures.py judge runs/judged --out docs/pictures/real-judge.jpg
"""

from __future__ import annotations

import argparse
import io
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from betterbench.demonstrations.teleop.session import TeleopSession

TESTS = Path(__file__).resolve().parents[1] / "tests"
sys.path[:0] = [str(TESTS / "report"), str(TESTS / "demonstrations" / "teleop"), str(TESTS / "review")]

from browser_operator import BrowserOperator  # type: ignore[import-not-found]  # noqa: E402 - of the tests, which are no package
from browser_reviewer import BrowserReviewer, write_leaning_mug  # type: ignore[import-not-found]  # noqa: E402
from chromium import browser  # type: ignore[import-not-found]  # noqa: E402
from scripted_operator import CONDITION, ITEMS, TASK, above_spot, fresh_scene, grasp_of  # type: ignore[import-not-found]  # noqa: E402

REPORT_SIZE, TELEOP_SIZE, REVIEW_SIZE, REAL_SIZE = (1200, 700), (1280, 720), (1440, 800), (1280, 800)
"""Sizes of the pictures [px]."""
SHEET_SIZE = (1123, 794)
"""A4 in landscape at 96 pixels per inch."""

LAPTOP = (1440, 840)
"""Size at which the report is shown [px]: its first screen with the film; scaled to the picture size."""

_MARGIN = 80
"""Height of the page's head above a section [px]."""

REPORT_QUALITY, TELEOP_QUALITY = 82, 85
SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")

_DISMISS_NOTICE = "document.querySelectorAll('.mantine-Notification-closeButton').forEach(b => b.click()); 1"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write one picture; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", choices=("report", "knowledge", "teleop", "review", "real", "judge", "sheet"))
    parser.add_argument(
        "source", type=Path, help="the report's index.html, or a new folder for the demonstration or the review"
    )
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        if options.page == "knowledge":
            options.out.write_bytes(knowledge_section(options.source, Path(profile)))
            print(options.out)
            return 0
        if options.page == "report":
            png, size, quality = report_page(options.source, Path(profile)), REPORT_SIZE, REPORT_QUALITY
        elif options.page == "real":
            png, size, quality = real_page(options.source, Path(profile)), REAL_SIZE, TELEOP_QUALITY
        elif options.page == "sheet":
            png, size, quality = sheet_page(options.source, Path(profile)), SHEET_SIZE, TELEOP_QUALITY
        elif options.page == "judge":
            png, size, quality = judge_page(options.source, Path(profile)), REAL_SIZE, TELEOP_QUALITY
        elif options.page == "review":
            png, size, quality = review_page(options.source, Path(profile)), REVIEW_SIZE, TELEOP_QUALITY
        else:
            png, size, quality = teleop_page(options.source, Path(profile)), TELEOP_SIZE, TELEOP_QUALITY
    picture = Image.open(io.BytesIO(png)).convert("RGB").resize(size, Image.Resampling.LANCZOS)
    picture.save(options.out, quality=quality, optimize=True)
    print(options.out)
    return 0


def report_page(page: Path, profile: Path) -> bytes:
    """Return the first screen of a report as PNG."""
    with browser(profile) as chromium:
        chromium.open(page, *LAPTOP)
        shown = "i.src && i.offsetParent && i.getBoundingClientRect().top < innerHeight"  # others load when scrolled to
        chromium.wait_until(f"[...document.images].filter(i => {shown}).every(i => i.complete)")
        return bytes(chromium.screenshot())


def knowledge_section(page: Path, profile: Path) -> bytes:
    """Return the section of a report on a model's knowledge as PNG, in full height."""
    with browser(profile) as chromium:
        chromium.open(page, *LAPTOP)
        height = int(chromium.value("document.querySelector('#knowledge').offsetHeight"))
        chromium.open(page, LAPTOP[0], height + _MARGIN)
        chromium.value("document.querySelector('#knowledge').scrollIntoView({behavior: 'instant'}); 1")
        time.sleep(1.0)
        return bytes(chromium.screenshot())


def teleop_page(run: Path, profile: Path) -> bytes:
    """Return the page of ``better teleop`` as PNG, after both items are packed; the demonstration is saved in a run."""
    command = [sys.executable, "-m", "betterbench.cli", "teleop", "--tasks", TASK, "--condition", CONDITION]
    command += ["--out", str(run), "--port", "0", "--devices", "none"]
    session = TeleopSession(fresh_scene())
    grasps = [grasp_of(session, item)[0] for item in ITEMS]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        url = next(iter(process.stdout or ())).removeprefix("open ").strip()
        with browser(profile, SOFTWARE_GL) as chromium:
            operator: Any = BrowserOperator(chromium, url, width=TELEOP_SIZE[0], height=TELEOP_SIZE[1])
            for number, grasp in enumerate(grasps):
                above = above_spot(session, number, grasp).position
                operator.pack(grasp.position, above)
                if number == 0:
                    operator.drag_to(above)
            operator.wait_for("done: save it")
            chromium.value(_DISMISS_NOTICE)
            time.sleep(2.0)
            png = bytes(chromium.screenshot())
            operator.click("Save")
            operator.wait_for("all saved")
        return png
    finally:
        process.terminate()
        process.wait()


def real_page(folder: Path, profile: Path) -> bytes:
    """Return the page of ``better real run`` as PNG: the first scene fits. The protocol goes to a folder."""
    better = [sys.executable, "-m", "betterbench.cli", "real"]
    subprocess.run([*better, "plan", "--out", str(folder), "--policies", "ours=noop", "--seed", "3"], check=True)
    run = [*better, "run", str(folder), "--robot", "mock", "--cameras", "front", "wrist", "--port", "0"]
    process = subprocess.Popen(run, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
    try:
        url = next(iter(process.stdout or ())).removeprefix("open ").strip()
        with browser(profile) as chromium:
            chromium.open(url, *REAL_SIZE)
            chromium.wait_until("state !== null && state.agreement !== null && state.agreement.accepted")
            time.sleep(3.0)
            return bytes(chromium.screenshot())
    finally:
        process.terminate()
        process.wait()


def sheet_page(page: Path, profile: Path) -> bytes:
    """Return an SVG page of ``better real sheet`` on A4 as PNG."""
    with browser(profile) as chromium:
        chromium.open(page.resolve(), *SHEET_SIZE)
        return bytes(chromium.screenshot())


def judge_page(folder: Path, profile: Path) -> bytes:
    """Return the page of ``better real judge`` as PNG, after one entry, six seconds into the second film."""
    command = [sys.executable, "-m", "betterbench.cli", "real", "judge", str(folder), "--person", "ada", "--port", "0"]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
    try:
        url = next(iter(process.stdout or ())).removeprefix("open ").strip()
        with browser(profile) as chromium:
            chromium.open(url, *REAL_SIZE)
            chromium.wait_until("state !== null && state.film === 0")
            for kind in ("keyDown", "keyUp"):
                chromium.key(kind, "Digit1", "1")
            chromium.wait_until("state.judged === 1 && document.querySelector('video')?.currentTime > 6")
            chromium.value("document.querySelector('video').pause(); 1")
            time.sleep(1.0)
            return bytes(chromium.screenshot())
    finally:
        process.terminate()
        process.wait()


def review_page(folder: Path, profile: Path) -> bytes:
    """Return the page of ``better review`` as PNG: a grasp of an upright mug is being moved.

    The files go to a folder.
    """
    folder.mkdir(parents=True)
    write_leaning_mug(folder / "mug.glb")
    command = [sys.executable, "-m", "betterbench.cli", "review", str(folder), "--author", "ada", "--port", "0"]
    process = subprocess.Popen([*command, "--out", str(folder / "r.jsonl")], stdout=subprocess.PIPE, text=True)
    try:
        url = next(iter(process.stdout or ())).removeprefix("open ").strip()
        with browser(profile, SOFTWARE_GL) as chromium:
            reviewer: Any = BrowserReviewer(chromium, url, width=REVIEW_SIZE[0], height=REVIEW_SIZE[1], dpr=1)
            chromium.value(_DISMISS_NOTICE)
            reviewer.right_the_mug()
            reviewer.raise_grasp(0.015)
            time.sleep(2.0)
            return bytes(chromium.screenshot())
    finally:
        process.terminate()
        process.wait()


if __name__ == "__main__":
    sys.exit(main())
