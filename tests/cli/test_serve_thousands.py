"""`better serve` under a thousand connections: opened, used and dropped, and its memory and threads are back."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import msgpack
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from betterbench.policies.wire import encode_openpi

pytestmark = pytest.mark.slow

CONNECTIONS = 1000
AT_ONCE = 100
MORE_BYTES = 100 << 20
"""How much more memory may be in use afterwards than after the first connection [byte]."""

PATIENCE_S = 60.0

POLICY = """
import numpy as np
from betterbench.interface import PolicyInfo

class Large:
    info = PolicyInfo("large", needs_images=False)
    def __init__(self):
        self.weights = np.ones(1_000_000)
    def reset(self, start):
        pass
    def act(self, observation):
        return np.zeros((4, 7))
"""
QUESTION = {
    "prompt": "Pack the apple.",
    "observation/state": np.zeros(8),
    "observation/image": np.zeros((64, 64, 3), np.uint8),
}


def status(pid):
    text = Path(f"/proc/{pid}/status").read_text()
    return {name: int(re.search(rf"{name}:\s+(\d+)", text).group(1)) for name in ("VmRSS", "Threads")}


def descriptors(pid):
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


@contextlib.contextmanager
def serving(*words):
    process = subprocess.Popen(
        [sys.executable, "-m", "betterbench.cli", "serve", *words, "--port", "0", "--log-level", "error"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        line = process.stdout.readline()
        yield process, int(re.search(r"127\.0\.0\.1:(\d+) ", line).group(1))
    finally:
        process.terminate()
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert "Traceback" not in said, said[-2000:]


def dropped(link):
    """Ends a connection without a word, by a reset."""
    link.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    link.socket.close()


def wave(port, number, draw):
    """Opens many connections, uses most, leaves some half-way, and drops or closes all; returns how many answered."""
    links, answers = [], 0
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.suppress(ConnectionClosed, OSError))
        for _ in range(number):
            with contextlib.suppress(OSError, InvalidStatus, EOFError):
                at = connect(f"ws://127.0.0.1:{port}", compression=None, close_timeout=1.0, ping_interval=None)
                links.append(link := stack.enter_context(at))
                link.recv(timeout=PATIENCE_S)
        for link in links:
            kind = draw.uniform()
            with contextlib.suppress(ConnectionClosed, OSError):
                if kind < 0.7:
                    link.send(encode_openpi(QUESTION))
                    answers += "actions" in msgpack.unpackb(link.recv(timeout=PATIENCE_S), strict_map_key=False)
                elif kind < 0.8:
                    link.send(b"\xc1garbage")
                elif kind < 0.9:
                    link.socket.sendall(b"\x82\xff\x00\x00\x00\x00\x03\xff\xff\xff1234half a frame")
        for link in links:
            with contextlib.suppress(ConnectionClosed, OSError):
                dropped(link) if draw.uniform() < 0.5 else link.close()
    return len(links), answers


@pytest.mark.parametrize("at_once", [AT_ONCE, CONNECTIONS])
def test_a_thousand_connections_leave_nothing_behind(at_once, tmp_path):
    (tmp_path / "large.py").write_text(POLICY)
    draw = np.random.default_rng(1000)
    with serving(f"python:{tmp_path / 'large.py'}:Large") as (process, port):
        assert wave(port, 1, np.random.default_rng(1))[0] == 1
        time.sleep(1.0)
        before, files = status(process.pid), descriptors(process.pid)
        opened = answered = 0
        for _ in range(CONNECTIONS // at_once):
            got, answers = wave(port, at_once, draw)
            opened, answered = opened + got, answered + answers
        # Of a thousand at once the server takes 128 and sends the others away.
        assert opened >= (CONNECTIONS if at_once == AT_ONCE else 128)
        assert answered > opened // 2
        until = time.monotonic() + 20.0
        while time.monotonic() < until:
            after = status(process.pid)
            if after["Threads"] <= before["Threads"] + 2 and descriptors(process.pid) <= files + 4:
                break
            time.sleep(0.2)
        assert after["Threads"] <= before["Threads"] + 2
        assert descriptors(process.pid) <= files + 4
        assert 1024 * (after["VmRSS"] - before["VmRSS"]) < MORE_BYTES, (before, after)
        assert wave(port, 1, np.random.default_rng(1))[0] == 1, "it still serves"


def test_the_expert_gives_its_simulations_back():
    """Each connection of the expert has a simulation of its own."""
    with serving("expert", "--task", "morning_coffee", "--condition", "T1") as (process, port):
        assert wave(port, 1, np.random.default_rng(1))[0] == 1
        time.sleep(1.0)
        before = status(process.pid)
        for number in range(3):
            wave(port, 10, np.random.default_rng(number))
        time.sleep(5.0)
        after = status(process.pid)
        assert after["Threads"] <= before["Threads"] + 2
        assert 1024 * (after["VmRSS"] - before["VmRSS"]) < MORE_BYTES, (before, after)
