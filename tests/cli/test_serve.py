"""`better serve`: one line with the address, connections in the log, and a clean end."""

from __future__ import annotations

import logging
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
from pathlib import Path

import msgpack
import pytest
from websockets.sync.client import connect

from betterbench import evaluation
from betterbench.cli.main import main
from betterbench.cli.verbs import serve as serve_module
from betterbench.errors import BetterError
from betterbench.evaluation.serving.server import DEFAULT_CHUNK
from betterbench.policies.batching import MAX_BATCH
from betterbench.policies.protocols.wire import encode_openpi
from betterbench.tasks.user_files import VARIABLE

PATIENCE_S = 60


@pytest.fixture
def serve():
    started = []
    without_task_files = {name: value for name, value in os.environ.items() if name != VARIABLE}  # of other tests

    def start(*arguments, **environment):
        process = subprocess.Popen(
            [sys.executable, "-m", "betterbench.cli", "serve", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**without_task_files, **environment, "PYTHONUNBUFFERED": "1"},
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
    found = re.match(r"serving noop at openpi://127\.0\.0\.1:(\d+)$", line)
    assert found, line + process.stderr.read()
    port = found.group(1)
    advised = shlex.split(process.stdout.readline().removeprefix("evaluate"))
    assert Path(advised[0]).name == "better"
    assert advised[1:] == ["eval", "--policy", f"openpi://127.0.0.1:{port}", "--trials", "3"]
    assert f"WebsocketClientPolicy(host='127.0.0.1', port={port})" in process.stdout.readline()
    assert process.stdout.readline() == "Ctrl-C stops.\n"
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


@pytest.mark.parametrize(("level", "logged"), [(logging.WARNING, True), (logging.ERROR, False)])
def test_who_comes_is_logged_unless_only_errors_are_wanted(level, logged):
    everything, ours = logging.getLogger("betterbench"), logging.getLogger("betterbench.policies.serving.server")
    before = everything.level
    everything.setLevel(level)
    try:
        with serve_module._connections_logged():
            assert ours.isEnabledFor(logging.INFO) == logged
    finally:
        everything.setLevel(before)


HANGS = """
import time
from betterbench.interface import PolicyInfo
class Hangs:
    info = PolicyInfo("hangs", needs_images=False)
    def reset(self, start): ...
    def act(self, observation):
        print("asked", flush=True)
        time.sleep(3600)
    def act_batch(self, observations):
        self.act(observations[0])
"""


def test_a_second_signal_ends_a_server_whose_policy_hangs(serve, tmp_path):
    (tmp_path / "hangs.py").write_text(HANGS, encoding="utf-8")
    process = serve(f"python:{tmp_path / 'hangs.py'}:Hangs", "--port", "0")
    port = re.search(r"127\.0\.0\.1:(\d+)$", process.stdout.readline()).group(1)
    question = {"prompt": "Go.", "observation/state": [0.0] * 8}
    with connect(f"ws://127.0.0.1:{port}", compression=None) as link:
        link.send(encode_openpi(question))
        assert any(line == "asked\n" for line in process.stdout)
        process.send_signal(signal.SIGTERM)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(timeout=1)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=PATIENCE_S) == 128 + signal.SIGTERM


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("exprt",), "Did you mean 'expert'"),
        (("replay:runs/x",), "so it cannot be served. Evaluate it with"),
        (("expert", "--condition", "T1"), "Add --task TASK"),
        (("expert", "--task", "fast_food", "--condition", "T11"), "T1"),
        (("expert", "--task", "fast_food", "--seed", "-1"), "--seed"),
        (("expert", "--chunk", "0"), "--chunk"),
        (("expert", "--seed", "0"), "--seed: this option applies only with --task. Add --task TASK"),
        (("expert", "--batch", "16"), "--batch: expert does not support batches"),
        (("noop", "--batch", "2"), "--batch: noop does not support batches"),
        (("noop", "--chunk", "8"), "--chunk: noop is not an expert"),
        (("openpi://127.0.0.1:1", "--chunk", "8"), "Leave out --chunk"),
        (("exprt", "--chunk", "8"), "Did you mean 'expert'"),
        (("exprt", "--batch", "8"), "Did you mean 'expert'"),
        (("expert", "--port", "99999"), "99999 is not a port"),
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


MINE = """
import numpy as np
from betterbench.interface import PolicyInfo

class One:
    info = PolicyInfo("one", needs_images=False)
    def reset(self, start): pass
    def act(self, observation): return np.zeros(7)
    def close(self): print("closed")

class Many(One):
    def act_batch(self, observations): return [np.zeros(7) for _ in observations]
"""


def test_a_policy_without_batches_is_closed_and_refused(capsys, tmp_path):
    (tmp_path / "mine.py").write_text(MINE, encoding="utf-8")
    address = f"python:{tmp_path / 'mine.py'}:One"
    assert main(["serve", address, "--batch", "4"]) == 2
    out, err = capsys.readouterr()
    assert out == "closed\n"
    assert "does not support batches. Leave out --batch" in err.replace("\n", " ")


def test_options_that_have_an_effect_are_taken(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(MINE, encoding="utf-8")
    many = f"python:{tmp_path / 'mine.py'}:Many"
    opened = []

    def enough(policy, **options):
        opened.append(options)
        raise BetterError("enough")

    monkeypatch.setattr(evaluation, "open_server", enough)
    for arguments in (
        (many, "--batch", "4"),
        ("expert", "--chunk", "4", "--task", "fast_food", "--seed", "3"),
        ("expert", "--task", "fast_food"),
    ):
        assert main(["serve", *arguments]) == 2
    batch, chunk, usual = opened
    assert (batch["batch"], batch["made"].info.name, batch["chunk"]) == (4, "one", DEFAULT_CHUNK)
    assert (chunk["chunk"], chunk["made"], chunk["batch"]) == (4, None, MAX_BATCH)
    assert (chunk["trial"].seed, usual["trial"].seed) == (3, 0)


def test_the_help_names_the_usual_numbers(capsys):
    with pytest.raises(SystemExit):
        main(["serve", "--help"])
    shown = " ".join(re.sub(r"[^\w.;]+", " ", capsys.readouterr().out).split())
    assert f"per expert answer; default {DEFAULT_CHUNK}." in shown
    assert f"policies that implement it; default {MAX_BATCH}." in shown


def test_a_port_in_use_is_one_clear_error(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        status = main(["serve", "noop", "--port", str(taken.getsockname()[1])])
    assert status == 2
    assert "is in use on 127.0.0.1" in capsys.readouterr().err.replace("\n", " ")
