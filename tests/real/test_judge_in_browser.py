"""The judge's page as a judge meets it: ``better real judge`` in a headless Chromium, by keys alone.

The films of all trials have colors of their own, so that the picture on the screen tells which trial is shown.
"""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tests.real.protocols import POLICIES, header_of, packs

sys.path.insert(0, str(Path(__file__).parents[1] / "report"))

from chromium import COMMAND, browser

from betterbench.demonstrations.export.video import VideoWriter
from betterbench.real.judging import JudgeDesk
from betterbench.real.plan import make_plan, write_plan
from betterbench.real.record import Film, RealJournal, enter, read_run, write_attempt

pytestmark = [pytest.mark.slow, pytest.mark.skipif(COMMAND is None, reason="no Chromium is installed")]
COLORS = ((200, 40, 40), (40, 180, 40), (40, 60, 200), (200, 190, 40), (190, 40, 190), (40, 190, 190))
WIDTH, HEIGHT = 320, 240

COLOR = """(() => {
  const video = document.querySelector("video");
  if (!video || video.readyState < 2 || video.src.indexOf("/film/" + state.film + "/") < 0) return null;
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 1;
  canvas.getContext("2d").drawImage(video, 10, 10, 20, 20, 0, 0, 1, 1);
  return [...canvas.getContext("2d").getImageData(0, 0, 1, 1).data].slice(0, 3);
})()"""


def film_of(color, steps):
    """Return a film with a square that moves, on a ground of one color."""
    writer = VideoWriter(rate_hz=20)
    for step in range(steps):
        image = np.full((HEIGHT, WIDTH, 3), color, np.uint8)
        left = 40 + step % 240
        image[100:140, left : left + 40] = 250
        writer.add(image)
    return writer.finish()


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "bench"
    plan = make_plan(POLICIES, conditions=["train1", "T1", "T5"], seed=3)
    write_plan(made, plan)
    samples = packs()
    with RealJournal(made) as journal:
        for planned, color in zip(plan.trials, COLORS, strict=True):
            place = journal.begin(planned.code, "olga")
            films = {camera: Film(WIDTH, HEIGHT, 100) for camera in ("front", "wrist")}
            told = plan.instruction(planned.condition)
            header = header_of(planned.code, 1, len(samples), instruction=told, films=films)
            write_attempt(place, header, samples, {"front": film_of(color, 100), "wrist": film_of((90, 90, 90), 100)})
            journal.end(planned.code, "time_limit")
            enter(made, planned.code, 1, author="olga", role="operator", outcome="done")
    return made


class Program:
    """``better real judge`` and the page that the judge has open."""

    def __init__(self, folder, chromium, person):
        command = [sys.executable, "-m", "betterbench.cli", "real", "judge", str(folder), "--person", person]
        self.process = subprocess.Popen(
            [*command, "--port", "0"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        found = re.fullmatch(r"open (http://localhost:\d+/[\w-]{32}/)\n", self.process.stdout.readline())
        assert found is not None, self.process.stderr.read()
        self.page = chromium
        self.page.open(found[1], 1280, 800)
        self.page.wait_until("state !== null")

    def press(self, code, key):
        for kind in ("keyDown", "keyUp"):
            self.page.key(kind, code, key)

    def end(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        said = self.process.communicate(timeout=60)[1]
        return self.process.returncode, said


@pytest.fixture
def open_program(folder, tmp_path):
    made = []
    with browser(tmp_path / "profile", ("--disable-gpu", "--autoplay-policy=no-user-gesture-required")) as chromium:

        def start(person="ada"):
            made.append(Program(folder, chromium, person))
            return made[-1]

        yield start
        for program in made:
            if program.process.poll() is None:
                program.end()


def test_a_judge_works_through_the_films_by_keys(open_program, folder):
    colors = {t.code: color for t, color in zip(read_run(folder).plan.trials, COLORS, strict=True)}
    desk = JudgeDesk(folder, "ada")
    program = open_program()
    page = program.page

    def require_shown(number):
        """Check that the picture on the screen is the film of the trial that an entry would go to."""
        page.wait_until(f"state.film === {number} && {COLOR} !== null")
        seen = np.array(page.value(COLOR), int)
        assert np.abs(seen - colors[desk.trials[number].code]).max() < 25
        assert page.value("document.querySelectorAll('video').length") == 2
        assert page.value("document.getElementById('instruction').textContent") == (
            f"“{desk.trials[number].header.instruction}”"
        )

    require_shown(0)
    pictures = os.environ.get("BETTERBENCH_TEST_PICTURES")
    if pictures:
        time.sleep(1.0)
        Path(pictures, "judge.png").write_bytes(page.screenshot())
    page.wait_until("document.querySelector('video').currentTime > 1.5")
    page.value("document.querySelector('video').pause(), document.querySelector('video').currentTime = 0.5")
    page.wait_until("!document.querySelector('video').seeking")
    assert abs(page.value("document.querySelector('video').currentTime") - 0.5) < 0.1
    page.value("document.querySelector('video').play(), 0")
    program.press("Space", " ")
    page.wait_until("document.querySelector('video').currentTime < 1.0")
    assert page.value("document.documentElement.scrollWidth") <= 1280
    assert page.value("document.getElementById('note').getBoundingClientRect().bottom") <= 800  # all on one screen
    boxes = page.value("[...document.querySelectorAll('video')].map(v => v.getBoundingClientRect().toJSON())")
    assert all(box["top"] >= 0 and box["bottom"] <= 800 and box["height"] > 350 for box in boxes)

    program.press("Digit3", "3")
    require_shown(1)
    program.press("Digit9", "9")  # needs a note
    page.wait_until("document.getElementById('message').className === 'problem'")
    assert "needs a note" in page.value("document.getElementById('message').textContent")
    page.value("document.getElementById('note').focus()")
    for letter in "9 it waved":  # keys in the note are text, not outcomes
        page.call("Input.insertText", text=letter)
    program.press("Enter", "Enter")
    program.press("Digit9", "9")
    require_shown(2)
    assert page.value("document.getElementById('note').value") == ""
    program.press("Digit1", "1")
    require_shown(3)
    program.press("Backspace", "Backspace")
    require_shown(2)
    program.press("ArrowLeft", "ArrowLeft")
    require_shown(1)
    assert page.value("document.querySelector('tr.chosen b').textContent") == "something else"
    assert program.end()[0] == 0

    # a key without a program is told, and nothing is entered
    program.press("Digit1", "1")
    page.wait_until("document.getElementById('message').textContent.includes('The program does not answer')")

    program = open_program()
    require_shown(2)
    for number in range(2, 6):
        require_shown(number)
        program.press("Digit3", "3")
        page.wait_until(f"state.film !== {number} || state.judged === 6")
    page.wait_until("state.judged === 6")
    assert "this was the last video" in page.value("document.getElementById('message').textContent")
    assert page.complaints() == []
    code, said = program.end()
    assert (code, "ada has judged 6 of 6 videos" in said) == (0, True)
    votes = {t.code: t.seen_by("judge")[0].decision for t in read_run(folder).trials}
    assert [votes[t.code].outcome for t in desk.trials] == ["froze", "other", "froze", "froze", "froze", "froze"]
    assert votes[desk.trials[1].code].note == "9 it waved"


def test_a_film_that_was_damaged_is_said_on_the_page_and_gets_no_entry(open_program, folder):
    trial = JudgeDesk(folder, "ada").at_hand
    (trial.folder / "front.mp4").write_bytes(b"no film")
    program = open_program()
    page = program.page
    page.wait_until("document.getElementById('films').textContent.includes('This video cannot be shown')")
    program.press("Digit1", "1")
    page.wait_until("document.getElementById('message').className === 'problem'")
    message = page.value("document.getElementById('message').textContent")
    assert "video 1: cannot be shown, because its file is missing or was changed" in message
    program.press("ArrowRight", "ArrowRight")
    page.wait_until("state.film === 1")
    program.press("Digit1", "1")
    page.wait_until("state.judged === 1")
    code, said = program.end()
    assert code == 0
    assert str(trial.folder / "front.mp4") in said
    assert read_run(folder).trial(trial.code).seen_by("judge") == ()
