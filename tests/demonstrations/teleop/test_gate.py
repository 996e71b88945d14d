"""Who may drive: nobody without the token in the page's address, and no page of another site; by real sockets."""

from __future__ import annotations

import contextlib
import http.client
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.daily import others_slow
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

sys.path.insert(0, str(Path(__file__).parent))

from scripted_operator import CONDITION, TASK
from test_station import WANTED, FakeDisplay

from betterbench.browser import gate
from betterbench.demonstrations.teleop.controls import MOST_TAPS, Controls
from betterbench.demonstrations.teleop.page import Page
from betterbench.demonstrations.teleop.station import Station
from betterbench.demonstrations.teleop.store import DemonstrationStore
from betterbench.errors import MissingDependencyError
from betterbench.policies.serving.callers import is_own_host, is_own_origin

viser = pytest.importorskip("viser")
msgspec = pytest.importorskip("msgspec")
zstandard = pytest.importorskip("zstandard")
# viser's own code, as it shuts down.
pytestmark = pytest.mark.filterwarnings("default::DeprecationWarning:websockets")
ALL = "0.0.0.0"  # noqa: S104 - compared, not bound
VERSION = f"viser-v{viser.__version__}"


@pytest.fixture(scope="module")
def page():
    made = Page(Controls(), host="127.0.0.1", port=0, cameras=())
    yield made
    made.close()


def asked(page, path, **headers):
    link = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    with contextlib.closing(link):
        link.putrequest("GET", path, skip_host="Host" in headers)
        for name, value in headers.items():
            for one in [value] if isinstance(value, str) else value:
                link.putheader(name, one)
        link.endheaders()
        answer = link.getresponse()
        return answer.status, answer.read().decode(errors="replace"), dict(answer.getheaders())


def token(page):
    return page.url.rpartition("/")[2]


def test_the_printed_address_holds_a_secret_that_is_new_each_time(page):
    other = Page(Controls(), host="127.0.0.1", port=0, cameras=())
    other.close()
    assert len(token(page)) >= 32
    assert token(page) != token(other)


@pytest.mark.parametrize("mark", ["", "/", "/?fixedDpr=0.5", "/index.html"])
def test_whoever_knows_the_address_gets_the_page(page, mark):
    status, text, headers = asked(page, f"/{token(page)}{mark}")
    assert (status, text.startswith("<!doctype html>")) == (200, True)
    assert headers["Referrer-Policy"] == "no-referrer"  # the address is not told to anybody
    assert headers["X-Frame-Options"] == "DENY"


def test_a_request_that_viser_does_not_expect_is_refused_and_no_traceback(page, caplog):
    path = f"/{token(page)}"
    status, text, headers = asked(page, path, **{"Accept-Encoding": ["gzip", "br"]})
    assert (status, text) == (400, "This request cannot be read.\n")
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert [record for record in caplog.records if record.exc_info] == []
    assert asked(page, path)[0] == 200


def test_without_the_token_nothing_is_answered_but_one_line(page):
    known = token(page)
    wrong = ["", "x", known[:-1], known + "x", known.swapcase(), "%2e%2e", "?token=" + known, f"x/{known}", "~" * 9]
    for path in wrong:
        status, text, _ = asked(page, "/" + path)
        assert (status, text.count("\n"), "printed by better teleop" in text) == (403, 1, True), path
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://127.0.0.1:{page.port}/{path}", subprotocols=[VERSION])


def test_pages_of_other_sites_and_names_are_refused_although_they_know_the_token(page):
    own, path = f"127.0.0.1:{page.port}", f"/{token(page)}"
    for origin in ("http://evil.example", "null", "", f"https://{own}", "http://127.0.0.1:1", f"http://{own}/"):
        assert asked(page, path, Origin=origin)[0] == 403, origin
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://{own}{path}", origin=origin, subprotocols=[VERSION])
    for host in ("evil.example", f"evil.example:{page.port}", f"127.0.0.1.evil.example:{page.port}", "", "[::2]"):
        assert asked(page, path, Host=host)[0] == 403, host
        assert asked(page, path, Host=host, Origin=f"http://{host}")[0] == 403, host
    assert asked(page, path, Host=[own, "evil.example"])[0] in (400, 403)
    assert asked(page, path, Origin=[f"http://{own}", "http://evil.example"])[0] in (400, 403)
    for host in (own, f"localhost:{page.port}", "localhost:9000"):  # a forwarded port may be another one
        assert asked(page, path, Host=host, Origin=f"http://{host}")[0] == 200, host
    with connect(f"ws://{own}{path}", origin=f"http://{own}", subprotocols=[VERSION]) as link:
        assert len(link.recv(timeout=10)) > 1000


def test_hosts_of_all_interfaces():
    assert is_own_host(["192.0.2.7:8080"], ALL)
    assert is_own_host(["[2001:db8::1]:8080"], "::")
    assert not is_own_host(["evil.example:8080"], ALL)
    assert not is_own_host(["192.0.2.7:8080"], "127.0.0.1")
    assert not is_own_host([], "127.0.0.1")
    assert is_own_origin([], [])
    assert not is_own_origin(["http://a"], [])


def test_a_viser_that_the_gate_does_not_stand_before_is_not_used(monkeypatch):
    monkeypatch.setattr(gate.Gate, "before_servers", lambda _: contextlib.nullcontext())
    with pytest.raises(MissingDependencyError, match="cannot control access"):
        Page(Controls(), host="127.0.0.1", port=0, cameras=())


@pytest.mark.physics
def test_a_flood_of_clicks_makes_one_scene(tmp_path, monkeypatch):
    controls, display = Controls(), FakeDisplay()
    controls.connected(1)
    with DemonstrationStore(tmp_path / "run", WANTED) as store:
        station = Station(store, controls, display, name="tester")
        assert display.scenes == 1
        for _ in range(500):
            controls.tapped(1, "discard")
        assert len(controls._taps) == MOST_TAPS
        station.tick(0.05)
        assert display.scenes == 2
        station.tick(0.10)
        assert display.scenes == 2


def buttons(link):
    """Return the ids of the buttons of the page by their labels, from what the server sends first."""
    found = {}
    while not any("Discard" in label for label in found):
        frame = link.recv(timeout=60)
        size = int.from_bytes(frame[8:16], "little")
        told = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(frame[16 : 16 + size]))
        for message in told["messages"]:
            if message["type"] == "GuiButtonMessage":
                found[message["props"]["label"]] = message["uuid"]
    return found


@pytest.mark.physics
@pytest.mark.parametrize("number", others_slow([signal.SIGTERM, signal.SIGINT], 2))
def test_a_signal_ends_it_within_two_seconds_in_the_midst_of_a_flood(tmp_path, number):
    command = [sys.executable, "-m", "betterbench.cli", "teleop", "--tasks", TASK, "--condition", CONDITION]
    command += ["--demos", "3", "--out", str(tmp_path / "run"), "--port", "0", "--devices", "none", "--cameras", "none"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ)
    try:
        line = process.stdout.readline()
        url = re.fullmatch(r"open (http://localhost:\d+/\S+)\n", line)
        assert url is not None, process.stderr.read()
        with connect(url[1].replace("http", "ws"), subprotocols=[VERSION], max_size=None) as link:
            discard = next(uuid for label, uuid in buttons(link).items() if "Discard" in label)
            click = {"type": "GuiUpdateMessage", "uuid": discard, "updates": {"value": True}}
            with contextlib.suppress(ConnectionClosed):  # viser drops a page now and then; its script comes back
                for _ in range(400):
                    link.send(msgspec.msgpack.encode(click))
            time.sleep(0.5)
            assert process.poll() is None
            began = time.monotonic()
            process.send_signal(number)
            _, said = process.communicate(timeout=20)
            took = time.monotonic() - began
        assert process.returncode == 0, said
        assert "Traceback" not in said
        assert "0 of 3 demonstrations are saved" in said
        assert took < 2.0, took
    finally:
        process.kill()
        process.communicate()
