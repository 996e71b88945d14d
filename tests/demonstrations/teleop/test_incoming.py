"""What a page may send: its own messages come in, and no other one ends a session, keeps a page out or is printed."""

from __future__ import annotations

import contextlib
import json
import logging
import time

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from betterbench.browser.incoming import LEFT_OUT, MAX_MESSAGE_BYTES
from betterbench.browser.keys import MARK
from betterbench.demonstrations.teleop.controls import Controls
from betterbench.demonstrations.teleop.page import GIZMO, Page
from betterbench.demonstrations.teleop.steering import SLOWEST

viser = pytest.importorskip("viser")
msgspec = pytest.importorskip("msgspec")
zstandard = pytest.importorskip("zstandard")
# viser's own code, as it shuts down.
pytestmark = pytest.mark.filterwarnings("default::DeprecationWarning:websockets")
VERSION = f"viser-v{viser.__version__}"
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [1.0, 1, 1],
    "fov": 1.0,
    "near": 0.01,
    "far": 1000,
    "image_height": 300,
    "image_width": 400,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}
DRAGGED = {
    "type": "TransformControlsUpdateMessage",
    "name": GIZMO,
    "wxyz": [0.0, 1, 0, 0],
    "position": [0.4, 0.0, 0.3],
    "owner": "",
}


class Browser:
    """A page that drives."""

    def __init__(self, page):
        self.link = connect(page.url.replace("http", "ws"), subprotocols=[VERSION], max_size=None)
        self.ids = {}
        while "Discard, next start" not in self.ids or "text" not in self.ids:
            frame = self.link.recv(timeout=20)
            size = int.from_bytes(frame[8:16], "little")
            told = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(frame[16 : 16 + size]))
            for message in told["messages"]:
                if message["type"] in ("GuiButtonMessage", "GuiSliderMessage", "GuiTextMessage"):
                    kind = {"GuiSliderMessage": "slider", "GuiTextMessage": "text"}.get(message["type"])
                    self.ids[kind or message["props"]["label"]] = message["uuid"]
        self.send(CAMERA)

    def send(self, form):
        self.link.send(form if isinstance(form, bytes | str) else msgspec.msgpack.encode(form))

    def update(self, element, value):
        return {"type": "GuiUpdateMessage", "uuid": self.ids[element], "updates": {"value": value}}


def until(condition):
    for _ in range(500):
        if condition():
            return True
        time.sleep(0.01)
    return False


def drain(link):
    while True:
        link.recv(timeout=20)


@pytest.fixture
def controls():
    return Controls()


@pytest.fixture
def page(controls):
    made = Page(controls, host="127.0.0.1", port=0, cameras=())
    yield made
    made.close()


@pytest.fixture
def tab(page, controls):
    found = Browser(page)
    with contextlib.closing(found.link):
        assert until(lambda: controls.driver is not None)
        yield found


def test_what_the_page_sends_comes_in(tab, page, controls):
    tab.send(DRAGGED)
    tab.send(tab.update("slider", 35))
    tab.send(tab.update("Discard, next start", True))
    keys = MARK + json.dumps({"held": ["KeyW"], "taps": {"gripper": 1}, "push": [0] * 6, "slow": False, "n": 1})
    tab.send(tab.update("text", keys))
    assert until(lambda: len(controls._taps) == 2 and page.speed == 0.35)
    asked = controls.take(time.monotonic())
    assert asked.taps == ("discard", "gripper")
    np.testing.assert_allclose(asked.drag.position, (0.4, 0.0, 0.3))
    assert asked.push[0] == 1.0
    assert controls.take_problems() == []


def bad_values(tab):
    numbers = ["1" * 400, "x", "", None, float("nan"), float("inf"), 1e308, 2**63, True, [], {}, b"1", [[1] * 4] * 4]
    yield from (tab.update("slider", value) for value in numbers)
    yield from (tab.update("text", value) for value in (5, True, ["a"], {"a": 1}, "x" * 5000))
    yield from (tab.update("Discard, next start", value) for value in (1, "x", None, [True]))
    yield tab.update("slider", 50) | {"uuid": "0" * 36}
    for name in ("removed", "update_cb", "sync_cb", "uuid", "props", "is_button", "__class__"):
        yield tab.update("slider", 50) | {"updates": {name: 1}}
        yield tab.update("slider", 50) | {"updates": {"value": 50, name: None}}
    yield from (
        CAMERA | {"position": bad} for bad in ([float("nan")] * 3, [1e200] * 3, [1.0], "abc", [["a"]] * 3, None)
    )
    yield from (DRAGGED | {"wxyz": bad} for bad in ([1e308] * 4, [float("inf")] * 4, [1.0] * 3, {}, [None] * 4))
    yield {name: value for name, value in DRAGGED.items() if name != "position"}
    yield CAMERA | {"more": 1}


def bad_messages(tab):
    yield from bad_values(tab)
    yield from ({"type": name} for name in ("ShareUrlRequest", "ShareUrlDisconnect", "NoSuchMessage", "Message", "", 5))
    upload = {"transfer_uuid": "a", "filename": "../../x", "mime_type": "a", "part_count": 9, "size_bytes": 2**40}
    yield {"type": "FileTransferStartUpload", "source_component_uuid": tab.ids["text"], **upload}
    yield {"type": "RunJavascriptMessage", "source": "alert(1)"}
    yield {"type": "RemoveSceneNodeMessage", "name": GIZMO}
    yield from (b"", b"\xc1", b"\x91" * 5000, b"\x81\xa4type", "text", [CAMERA], [], 5, None, {})


def test_no_other_message_does_anything(tab, page, monkeypatch, caplog, capfd):
    controls = page._controls
    shared = []
    monkeypatch.setattr(type(page._server), "request_share_url", lambda *_, **__: shared.append(1))
    for message in bad_messages(tab):
        controls.take_problems()
        tab.send(message)
        assert until(lambda: controls.problems), message
        assert controls.take_problems() == [LEFT_OUT]
    asked = controls.take(time.monotonic())
    assert (asked.taps, asked.drag, asked.push) == ((), None, (0.0,) * 6)
    assert SLOWEST <= page.speed <= 1.0
    assert page.view_yaw == page.view_yaw
    tab.send(tab.update("slider", 45))
    assert until(lambda: page.speed == 0.45)
    with contextlib.closing(Browser(page).link):  # the next page is let in
        pass
    assert shared == []
    assert [r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING] == []
    assert "Traceback" not in "".join(capfd.readouterr())


def test_a_message_that_is_too_large_closes_its_page_alone(tab, page):
    with contextlib.suppress(ConnectionClosed):
        tab.send(b"x" * (MAX_MESSAGE_BYTES + 1))
    with pytest.raises(ConnectionClosed):
        drain(tab.link)
    with contextlib.closing(Browser(page).link):
        pass
