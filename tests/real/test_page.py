"""The operator's page over HTTP: behind its token, without names, with pictures; and the server's refusals."""

import http.client
import io
import json
import re
import socket
import struct
import threading
import time
import urllib.parse
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.report.chromium import COMMAND, browser

from betterbench import real
from betterbench.browser.plain import PlainServer
from betterbench.errors import InvalidInputError
from betterbench.real.page import OperatorPage, ghost_png
from betterbench.real.plan import RealPolicy, make_plan, write_plan
from betterbench.real.robots.mock import MockRobot
from betterbench.real.session import RealSession

SCRIPTED = f"python:{Path(__file__).parent / 'scripted.py'}:Reach"


def ask(url, path="", *, body=None, **headers):
    parts = urllib.parse.urlsplit(url)
    connection = http.client.HTTPConnection("127.0.0.1", parts.port, timeout=20)
    connection.request("GET" if body is None else "POST", parts.path + path, body=body, headers=headers)
    answer = connection.getresponse()
    data = answer.read()
    connection.close()
    return answer.status, data, answer.headers


@pytest.fixture
def server():
    def obey(form):
        if form == {"bad": 1}:
            raise InvalidInputError("page", "it is bad", "Be good")
        return {"got": form}

    made = PlainServer(
        {"": lambda: ("text/html", b"hello"), "none": lambda: None}, obey, host="127.0.0.1", port=0, verb="v"
    )
    yield made
    made.close()
    made.close()


def test_the_server_answers_behind_its_token_alone(server):
    status, data, headers = ask(server.url)
    assert (status, data) == (200, b"hello")
    assert headers["Cache-Control"] == "no-store"
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert ask(server.url, "none")[0] == ask(server.url, "other")[0] == 404
    other = server.url.replace(server.url.split("/")[3], "0" * 32)
    status, data, _ = ask(other)
    assert status == 403
    assert b"open the address printed by v, with its token" in data
    assert ask(other, "do", body=b"{}")[0] == 403


@pytest.mark.parametrize(
    ("asked", "status", "part", "where"),
    [
        ("bytes=1-3", 206, b"ell", "bytes 1-3/5"),
        ("bytes=0-", 206, b"hello", "bytes 0-4/5"),
        ("bytes=3-99", 206, b"lo", "bytes 3-4/5"),
        ("bytes=-2", 206, b"lo", "bytes 3-4/5"),
        ("bytes=-99", 206, b"hello", "bytes 0-4/5"),
        ("bytes=5-", 416, b"", "bytes */5"),
        ("bytes=-0", 416, b"", "bytes */5"),
        ("bytes=3-1", 200, b"hello", None),
        ("bytes=-", 200, b"hello", None),
        ("bytes=0-1,3-4", 200, b"hello", None),
        ("lines=0-1", 200, b"hello", None),
    ],
)
def test_a_part_of_an_answer_can_be_requested(server, asked, status, part, where):
    """Chromium seeks in a film only if the server answers ranges."""
    found, data, headers = ask(server.url, Range=asked)
    assert (found, data, headers["Content-Range"]) == (status, part, where)
    assert headers["Content-Length"] == str(len(part))


def test_requests_of_other_sites_are_refused(server):
    assert ask(server.url, Host="evil.example")[0] == 403
    assert ask(server.url, "do", body=b"{}", Origin="http://evil.example")[0] == 403


def test_commands_are_json_objects_of_bounded_size(server):
    def sent(body):
        return json.loads(ask(server.url, "do", body=body)[1])

    assert sent(b'{"a": 1}') == {"got": {"a": 1}}
    assert sent(b'{"bad": 1}') == {"error": "page: it is bad. Be good."}
    assert sent(b"[1]") == {"error": "Expected a JSON object."}
    assert "error" in sent(b"{")
    assert ask(server.url, "do", body=b"x" * (1 << 17))[0] == 400
    assert ask(server.url, "elsewhere", body=b"{}")[0] == 400


def test_a_ghost_is_transparent_beside_its_objects_and_outlined():
    mask = np.zeros((20, 30), bool)
    mask[5:15, 8:20] = True
    picture = np.asarray(Image.open(io.BytesIO(ghost_png(np.full((20, 30, 3), 90, np.uint8), [mask]))))
    assert picture.shape == (20, 30, 4)
    assert (picture[~mask, 3] == 0).all()
    assert picture[10, 12].tolist() == [90, 90, 90, 110]
    assert picture[5, 10, 3] == picture[10, 8, 3] == 255


@pytest.mark.render
@pytest.mark.physics
def test_the_page_shows_pictures_and_steps_and_no_names(tmp_path):
    write_plan(tmp_path, make_plan((RealPolicy("secret", SCRIPTED),), conditions=["T3"], time_limit_s=1.0))
    from betterbench.real.plan import read_plan

    robot = MockRobot(read_plan(tmp_path), cameras=("front", "wrist"), size=(160, 120))
    with RealSession(tmp_path, robot, person="ada", apart=False, size=(160, 120)) as session:
        page = OperatorPage(session, host="127.0.0.1", port=0)
        try:
            session.begin()
            session._look()
            status, data, _ = ask(page.server.url, "state")
            state = json.loads(data)
            assert (status, state["stage"], state["cloth"]) == (200, "setup", "blue")
            assert state["agreement"]["accepted"]
            assert [s["text"] for s in state["steps"]][-1] == "mangosteen: take it away"
            assert b"secret" not in data
            assert b"T3" not in data
            for name, kind in (
                ("front.jpg", "JPEG"),
                ("wrist.jpg", "JPEG"),
                ("twin.jpg", "JPEG"),
                ("ghost.png", "PNG"),
            ):
                image = Image.open(io.BytesIO(ask(page.server.url, name)[1]))
                assert (image.format, image.size) == (kind, (160, 120))
            html = ask(page.server.url)[1] + ask(page.server.url, "page.js")[1]
            assert b"page.css" in html
            ask(page.server.url, "do", body=b'{"name": "arm"}')
            session.obey(session._commands.get(timeout=5)[1])
            assert session.view.armed
            ask(page.server.url, "do", body=b'{"name": "stop"}')
            assert not session.view.armed
            told = json.loads(ask(page.server.url, "do", body=b'{"name": "dance"}')[1])
            assert "name" in told["error"]
        finally:
            page.server.close()


def raw(server, text):
    """Send bytes as they are, and return the status of the answer and what follows on the connection."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=20) as connection:
        connection.sendall(text)
        connection.shutdown(socket.SHUT_WR)
        data = b""
        while part := connection.recv(1 << 16):
            data += part
    return [int(each) for each in re.findall(rb"HTTP/1\.1 (\d{3})", data)]


@pytest.mark.parametrize(
    "length", ["\u00b2", "\u00b9\u00b3", "-1", "+3", "1e3", "", " ", "9" * 5000, "0x10", "99999999"]
)
def test_a_length_that_is_no_number_is_refused_without_a_traceback(server, length, capsys):
    """The superscript two is a digit to Python's isdigit and not to int: the thread died with a traceback."""
    token = server.url.split("/")[3]
    head = f"POST /{token}/do HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\n"
    assert raw(server, head.encode("latin-1")) == [400]
    assert "Traceback" not in capsys.readouterr().err


def test_a_refused_body_is_not_read_as_the_next_request(server):
    token = server.url.split("/")[3]
    inner = f"GET /{token}/ HTTP/1.1\r\nHost: localhost\r\n\r\n"
    head = f"POST /{token}/elsewhere HTTP/1.1\r\nHost: localhost\r\nContent-Length: {len(inner)}\r\n\r\n"
    assert raw(server, (head + inner).encode()) == [400]


def test_deep_and_broken_bodies_are_told(server):
    for body in (b"[" * 60000, b'{"a":' * 12000, b"\xff\xfe", b'{"a": 1, "a": 2}', b""):
        status, data, _ = ask(server.url, "do", body=body)
        assert (status, "error" in json.loads(data)) == (200, True), body[:10]


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "localhost.evil.example"},
        {"Host": "evil.example:8080"},
        {"Host": "127.0.0.1.nip.io"},
        {"Host": "192.168.0.9"},
        {"Host": ""},
        {"Origin": "null"},
        {"Origin": "https://localhost"},
        {"Origin": "http://localhost:1"},
    ],
)
def test_names_that_resolve_to_this_machine_are_refused(server, headers):
    assert ask(server.url, **headers)[0] == 403
    assert ask(server.url, "do", body=b"{}", **headers)[0] == 403


def test_an_answer_that_fails_is_told_and_the_server_goes_on(capsys):
    def fails():
        raise InvalidInputError("film 1", "its file is missing", "Go on")

    def gone():
        raise FileNotFoundError("front.mp4")

    made = PlainServer({"a": fails, "b": gone}, lambda _: {}, host="127.0.0.1", port=0, verb="v")
    try:
        assert ask(made.url, "a")[:2] == (500, b"film 1: its file is missing. Go on.\n")
        assert ask(made.url, "b")[0] == 500
    finally:
        made.close()
    assert "Traceback" not in capsys.readouterr().err


def test_a_closed_tab_leaves_no_traceback(server, capsys):
    """A browser resets its idle connections when a tab is closed."""
    parts = urllib.parse.urlsplit(server.url)
    with socket.create_connection(("127.0.0.1", parts.port), timeout=20) as connection:
        connection.sendall(f"GET {parts.path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        answer = b""
        while not answer.endswith(b"hello"):
            answer += connection.recv(1 << 16)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset, not an end
    deadline = time.monotonic() + 10
    while any("process_request" in thread.name for thread in threading.enumerate()) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(COMMAND is None, reason="no Chromium is installed")
@pytest.mark.parametrize("name", ["page", "judge"])
def test_the_pages_fit_a_phone(tmp_path, name):
    with browser(tmp_path) as chromium:
        chromium.open(Path(real.__file__).parent / f"{name}.html", 390, 844)
        chromium.value("document.body.dataset.stage = 'setup'; 1")
        assert chromium.value("document.documentElement.scrollWidth") <= 390
        chromium.value("window.scrollTo({top: 9999, behavior: 'instant'}); 1")
        assert chromium.value("(document.querySelector('#stop')?.getBoundingClientRect().top ?? 0) >= 0"), "STOP stays"
        assert chromium.value("Math.max(...[...document.querySelectorAll('section')].map(s => s.clientWidth))") > 300
