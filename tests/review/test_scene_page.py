"""The page of a review of scenes without a browser: commands, and what they show."""

from __future__ import annotations

import threading

import pytest

from betterbench.geometry import Pose, from_yaw
from betterbench.review.scenes.changes import SceneJournal
from betterbench.review.scenes.desk import SceneDesk
from betterbench.review.scenes.queue import scene_queue

pytest.importorskip("viser")
pytestmark = [
    pytest.mark.physics,
    pytest.mark.render,
    # viser's own code, as it shuts down.
    pytest.mark.filterwarnings("default::DeprecationWarning:websockets"),
]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    from betterbench.review.scenes.page import ScenePage

    path = tmp_path_factory.mktemp("scenes") / "r.jsonl"
    with SceneJournal(path) as journal:
        queue = scene_queue(["morning_coffee/train1", "morning_coffee/O1"])
        made = ScenePage(SceneDesk(queue, journal, "ada"), host="127.0.0.1", port=0)
        made.begin()
        yield made
        made.server.close()


def obey(page, command, value=None):
    page.obey(command, value, threading.Event())
    return page._desk


def test_every_key_has_a_command_and_a_row(page):
    from betterbench.review.scenes.page import KEY_ROWS, TAP_KEYS

    listed = " ".join(keys for keys, _ in KEY_ROWS).replace(",", "").split()
    short = {"ArrowLeft": "←", "ArrowRight": "→"}
    keys = [short.get(code, code.removeprefix("Key").removeprefix("Digit")) for code in TAP_KEYS]
    assert sorted(keys) == sorted(listed)
    assert set(TAP_KEYS.values()) == set(page._do)


def test_commands_change_the_desk_and_the_page(page):
    desk = page._desk
    assert "Put the red mug" in page._head.content
    assert page._images["front"].image.std() > 5.0
    slots = [slot.name for slot in desk.slots]
    while desk.slot.name != "near":
        obey(page, "select")
    assert tuple(page._gizmo.position)[:2] == (0.60, -0.13)
    mug = [n for n, name in enumerate(p.spec.name for p in desk.scene.placements) if name == "red_mug"]
    body = int(desk.scene.compiled.bodies[mug[0]])
    before = tuple(page._bodies[body].position)
    obey(page, "drag", (Pose((0.62, -0.13, 0.2), from_yaw(-1.5708)), True))
    assert page._bodies[body].position[0] - before[0] == pytest.approx(0.02, abs=1e-6)
    assert "Enter keeps it" in page._status.content
    obey(page, "keep")
    assert "Kept: slot near moved by +20 mm" in page._status.content
    assert page._gizmo.position[0] == 0.62
    assert not any(part.visible for part in page._touched["red_mug"])
    obey(page, "view")
    assert all(part.visible for part in page._touched["red_mug"])
    assert not page._bodies[body].visible
    obey(page, "frame")
    assert "Gizmo: frame" in page._status.content
    obey(page, "away")
    assert "part of the library" in page._status.content
    obey(page, "slot")
    obey(page, "accept")
    assert "train1: fix" in page._status.content
    assert "✎" in page._list.content
    page._reason.value = "<b>no</b>"
    obey(page, "reject")
    assert page._reason.value == ""
    assert "<b>no" not in page._status.content + page._head.content
    obey(page, "complain", "what is that?")
    assert "what is that?" in page._status.content
    assert len(slots) == 3
