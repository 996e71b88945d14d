"""`better serve`: one line with the address, connections in the log, and a clean end."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys

import msgpack
import pytest
from websockets.sync.client import connect

from betterbench.cli.main import main

PATIENCE_S = 60


@pytest.fixture
def serve():
    started = []

    def start(*arguments, **environment):
        process = subprocess.Popen(
            [sys.executable, "-m", "betterbench.cli", "serve", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **environment, "PYTHONUNBUFFERED": "1"},
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate(timeout=PATIENCE_S)


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)])
def test_it_says_where_it_is_logs_who_comes_and_ends_cleanly(serve, number):
    process = serve("noop", "--port", "0", "--api-key-env", "BETTER_TEST_KEY", BETTER_TEST_KEY="secret")
    line = process.stdout.readline()
    found = re.match(r"serving noop at openpi://127\.0\.0\.1:(\d+) ", line)
    assert found, line + process.stderr.read()
    port = found.group(1)
    assert f"better eval --policy openpi://127.0.0.1:{port}" in line
    assert f"WebsocketClientPolicy(host='127.0.0.1', port={port})" in line
    key = {"Authorization": "Api-Key secret"}
    with connect(f"ws://127.0.0.1:{port}", additional_headers=key, compression=None) as link:
        assert msgpack.unpackb(link.recv(timeout=PATIENCE_S))["betterbench"]["policy"] == "noop"
    process.send_signal(number)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert not out
    assert re.search(r"127\.0\.0\.1:\d+ connected", err)
    assert re.search(r"127\.0\.0\.1:\d+ left after 0 answers", err)
    assert err.rstrip().endswith("stopped")
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("exprt",), "Did you mean 'expert'"),
        (("replay:runs/x",), "Evaluate it directly"),
        (("expert", "--condition", "T1"), "Give --task too"),
        (("expert", "--task", "fast_food", "--condition", "T11"), "T1"),
        (("expert", "--task", "fast_food", "--seed", "-1"), "--seed"),
        (("expert", "--chunk", "0"), "--chunk"),
        (("expert", "--port", "99999"), "99999 is no port"),
        (("expert", "--api-key-env", "BETTER_NO_SUCH_KEY"), "BETTER_NO_SUCH_KEY is empty"),
    ],
)
def test_bad_input_is_one_clear_error_with_status_2(capsys, arguments, text):
    status = main(["serve", *arguments])
    err = capsys.readouterr().err.replace("\n", " ")
    assert status == 2
    assert "error:" in err
    assert text in err
    assert "Traceback" not in err


def test_a_port_in_use_is_one_clear_error(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        status = main(["serve", "noop", "--port", str(taken.getsockname()[1])])
    assert status == 2
    assert "is in use on 127.0.0.1" in capsys.readouterr().err.replace("\n", " ")
