"""``better teleop`` at the command line: what is missing or wrong is one line, and nothing is written."""

from __future__ import annotations

import importlib
import socket

import pytest

from betterbench.browser import server
from betterbench.cli.main import main
from betterbench.demonstrations.teleop import page
from betterbench.errors import InvalidInputError


def said(capsys, *arguments):
    status = main(["teleop", *arguments])
    captured = capsys.readouterr()
    return status, " ".join(captured.err.split())


def test_without_viser_the_extra_is_named_and_nothing_is_written(capsys, monkeypatch, tmp_path):
    real = importlib.import_module

    def none(name, *rest):
        if name == "viser":
            raise ModuleNotFoundError("No module named 'viser'", name=name)
        return real(name, *rest)

    monkeypatch.setattr(importlib, "import_module", none)
    status, err = said(capsys, "--tasks", "fruit_lunch", "--out", str(tmp_path / "run"))
    assert status != 0
    assert "setup EXTRAS=teleop" in err
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("given", "answer"),
    [
        (("--tasks", "fruit_lunsh"), "fruit_lunch"),
        (("--tasks", "fruit_lunch", "--condition", "T1"), "train1"),
        (("--tasks", "fruit_lunch", "--demos", "0"), "--demos"),
        (("--tasks", "fruit_lunch", "--seed", "5"), "1000000"),
        (("--tasks", "fruit_lunch", "--cameras", "frnt"), "front"),
        (("--tasks", "fruit_lunch", "--name", "two\nlines"), "--name"),
        (("--tasks", "fruit_lunch", "--name", " "), "--name"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(capsys, monkeypatch, tmp_path, given, answer):
    monkeypatch.setattr(server, "load_viser", lambda: None)
    status, err = said(capsys, *given, "--out", str(tmp_path / "run"))
    assert status != 0
    assert answer in err
    assert not (tmp_path / "run").exists()


def test_a_port_that_is_taken_is_named():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InvalidInputError, match=f"cannot listen on 127.0.0.1:{port} .*--port 0"):
            server.free_port("127.0.0.1", port)
    assert server.free_port("127.0.0.1", 0) > 0
    for bad in (-1, 65536):
        with pytest.raises(InvalidInputError, match="1 to 65535, or 0"):
            server.free_port("127.0.0.1", bad)
    with pytest.raises(InvalidInputError, match=r"cannot listen on 203\.0\.113\.9"):
        server.free_port("203.0.113.9", 0)


def test_what_the_panel_shows_is_text_and_never_markup():
    bad = '<script>alert("x")</script>'
    panel = page.PanelState(
        bad, bad, ((bad, True),), 0.5, bad, bad, "go", bad, (bad,), bad, closed=False, can_save=False
    )
    for part in (page._head(panel), page._foot(panel)):
        assert "<script>" not in part
        assert "&lt;script&gt;" in part
