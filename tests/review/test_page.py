"""The page of a review without a browser: commands, what they show, and who may connect."""

from __future__ import annotations

import contextlib
import http.client
import sys
import threading
from pathlib import Path

import pytest
import trimesh

sys.path.insert(0, str(Path(__file__).parents[1] / "report"))

from chromium import COMMAND, browser

from betterbench.browser.keys import MARK
from betterbench.geometry import Pose
from betterbench.review.desk import ReviewDesk
from betterbench.review.panel import panel_head, queue_list
from betterbench.review.queue import QueuedObject
from betterbench.sim.assets.importing.importer import Wishes, import_mesh
from betterbench.sim.assets.importing.review import ReviewJournal, ReviewState

pytest.importorskip("viser")
# viser's own code, as it shuts down.
pytestmark = [pytest.mark.physics, pytest.mark.filterwarnings("default::DeprecationWarning:websockets")]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    from betterbench.review.page import ReviewPage

    folder = tmp_path_factory.mktemp("review")
    path = folder / "block.stl"
    trimesh.creation.box((0.05, 0.04, 0.06)).export(path)
    state = ReviewState(import_mesh(path, Wishes(name="block", size_m=0.06, mass_kg=0.1, up="z")))
    broken = QueuedObject(path, "c" * 64, [], "block.stl: it contains no triangles. Export it again.")
    queue = [QueuedObject(path, "a" * 64, [state]), QueuedObject(path, "b" * 64, [state]), broken]
    with ReviewJournal(folder / "r.jsonl") as journal:
        made = ReviewPage(ReviewDesk(queue, journal, "ada"), host="127.0.0.1", port=0)
        made._desk.open_first()
        made.show()
        yield made
        made.server.close()


def obey(page, command, value=None):
    stopped = threading.Event()
    stopped.set()  # motions are not shown
    page.obey(command, value, stopped)
    return page._desk


def test_the_address_holds_a_token_that_every_request_needs(page):
    token = page.server.url.rpartition("/")[2]
    for path, status in ((f"/{token}", 200), ("/", 403), (f"/{token}x", 403)):
        link = http.client.HTTPConnection("127.0.0.1", page.server.port, timeout=10)
        with contextlib.closing(link):
            link.request("GET", path)
            answer = link.getresponse()
            text = answer.read().decode(errors="replace")
            assert answer.status == status
            assert status == 200 or "printed by better review" in text


def test_every_key_has_a_command_and_a_row():
    from betterbench.review.page import KEY_ROWS, TAP_KEYS

    listed = " ".join(keys for keys, _ in KEY_ROWS).replace(",", "").split()
    short = {"ArrowLeft": "←", "ArrowRight": "→", "BracketLeft": "[", "BracketRight": "]"}
    keys = [short.get(code, code.removeprefix("Key").removeprefix("Digit")) for code in TAP_KEYS]
    assert sorted(keys) == sorted(listed)
    assert len(set(TAP_KEYS.values())) == len(TAP_KEYS)


def test_commands_change_the_desk_and_the_page(page):
    desk = obey(page, "x+90")
    assert "Enter keeps it" in page._status.content
    desk = obey(page, "keep")
    assert "4.0 cm" in page._head.content
    assert desk.history.changes
    for mode in ("support", "grasp", "frame", "pose"):
        assert obey(page, mode).mode == mode
        assert page._turn.visible == (mode == "pose")
    obey(page, "grasp")
    before = desk.grasp.pose
    obey(page, "drag", (before.translated(z=0.005), True))
    assert tuple(page._frame.position) == pytest.approx(before.translated(z=0.005).position)
    obey(page, "drop edit")
    obey(page, "drop test")
    assert "rest" in page._status.content
    obey(page, "undo")
    assert desk.history.changes == ()
    obey(page, "accept")
    assert desk.index == 1
    assert "✔" in page._list.content
    obey(page, "reject")
    assert "Write the reason" in page._status.content
    page._reason.value = "<b>no</b>"
    obey(page, "reject")
    assert page._reason.value == ""
    assert "<b>no" not in page._status.content
    assert desk.index == 2


def test_an_object_that_cannot_be_imported_is_shown_with_its_reason_and_can_be_rejected(page):
    desk = page._desk
    desk._go(2)
    page.show()
    assert "it contains no triangles" in page._head.content
    for command in ("x+90", "keep", "drop test", "lift test", "new", "remove", "accept", "larger"):
        obey(page, command)
    obey(page, "drag", (Pose((0.0, 0.0, 0.1)), True))
    assert desk.history.reviews == ()
    page._reason.value = "cannot be read"
    obey(page, "reject")
    assert desk.journal.reviews[-1].decision.reason == "cannot be read"


def test_what_a_page_sends_and_cannot_be_read_is_one_line(page):
    import asyncio
    from types import SimpleNamespace

    for text in (MARK + "{", MARK + '{"taps": {"accept": -1}}', "x" * 100):
        asyncio.run(page._typed(SimpleNamespace(target=SimpleNamespace(value=text), client_id=5)))
        command, value = page._commands.get(timeout=5)
        assert command == "complain"
        obey(page, command, value)
        assert page._desk.is_problem
    asyncio.run(page._typed(SimpleNamespace(target=SimpleNamespace(value=MARK + '{"taps": {"keep": 1}}'), client_id=5)))
    assert page._commands.get(timeout=5) == ("keep", None)


@pytest.mark.skipif(COMMAND is None, reason="no Chromium is installed")
def test_a_long_name_is_not_cut_off_at_the_edge_of_the_panel(tmp_path):
    name = "a_mug_with_a_rather_long_file_name_for_a_narrow_panel.glb"
    head = panel_head(name, None, [("size", "12.1 x 7.6 x 9.0 cm")], author="ada", index=0, judged=0, total=1)
    page = tmp_path / "panel.html"
    page.write_text(f"<body style='width:230px'>{head}{queue_list([name], [None], 0)}</body>", encoding="utf-8")
    with browser(tmp_path / "profile") as chromium:
        chromium.open(page, 600, 400)
        assert chromium.value("Math.max(...[...document.querySelectorAll('div')].map(d => d.scrollWidth))") <= 230
