"""The operator's page over HTTP: behind its token, without names, with pictures; and the server's refusals."""

import http.client
import io
import json
import urllib.parse
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

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
