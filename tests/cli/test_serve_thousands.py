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
from websockets.client import ClientProtocol
from websockets.frames import Frame, Opcode
from websockets.protocol import State
from websockets.uri import parse_uri

from betterbench.policies.protocols.wire import encode_openpi

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
    found = {name: int(re.search(rf"{name}:\s+(\d+)", text).group(1)) for name in ("VmRSS", "Threads")}
    return {**found, "VmRSS": 1024 * found["VmRSS"]}


def settled(pid, before):
    """Returns the status of a server when its threads and memory are back, or when they have had time enough."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        after = status(pid)
        if after["Threads"] <= before["Threads"] and after["VmRSS"] - before["VmRSS"] < MORE_BYTES:
            break
        time.sleep(0.2)
    return after


def descriptors(pid):
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


@contextlib.contextmanager
def serving(folder, *words):
    # What the server says goes to a file: it would wait for whoever does not read a pipe.
    with (folder / "said").open("w+", encoding="utf-8") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "betterbench.cli", "serve", *words, "--port", "0", "--log-level", "error"],
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        try:
            line = process.stdout.readline()
            yield process, int(re.search(r"127\.0\.0\.1:(\d+)$", line).group(1))
        finally:
            process.terminate()
            process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0
        said.seek(0)
        text = said.read()
        assert "Traceback" not in text, text[-2000:]


class Link:
    """A client without threads, so that a thousand cost little, and whose socket can be reset."""

    def __init__(self, port):
        self.protocol = ClientProtocol(parse_uri(f"ws://127.0.0.1:{port}"))
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        self._frames = []
        self.protocol.send_request(self.protocol.connect())
        while self.protocol.state is State.CONNECTING and self.protocol.handshake_exc is None:
            self._exchange()
        self.taken = self.protocol.handshake_exc is None

    def _exchange(self):
        """Sends what is to be sent, and takes what comes; TimeoutError if nothing does."""
        for data in self.protocol.data_to_send():
            self.socket.sendall(data)
        data = self.socket.recv(1 << 16)
        self.protocol.receive_data(data) if data else self.protocol.receive_eof()
        self._frames += [e for e in self.protocol.events_received() if isinstance(e, Frame)]

    def recv(self):
        """Returns the next message, which every server of ours sends as one frame; None if the server has closed."""
        while not self._frames:
            if self.protocol.state is not State.OPEN:
                return None
            self._exchange()
        frame = self._frames.pop(0)
        return frame.data if frame.opcode is not Opcode.CLOSE else None

    def send(self, data):
        self.protocol.send_binary(data)
        for piece in self.protocol.data_to_send():
            self.socket.sendall(piece)

    def reset(self):
        """Ends the connection without a word."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.socket.close()

    def close(self):
        """Ends the connection as the protocol wants it."""
        if self.protocol.state is State.OPEN:
            self.protocol.send_close()
        while self.protocol.state is not State.CLOSED:
            self._exchange()
        self.socket.close()


def wave(port, number, draw):
    """Opens many connections, uses most, leaves some half-way, and drops or closes all; returns how many answered."""
    links, halves, answers = [], [], 0
    for _ in range(number):
        link = Link(port)
        if link.taken:
            assert link.recv() is not None
            links.append(link)
        else:
            assert "503" in str(link.protocol.handshake_exc)
            link.reset()
    for link in links:
        kind = draw.uniform()
        if kind < 0.7:
            link.send(encode_openpi(QUESTION))
            answers += "actions" in msgpack.unpackb(link.recv(), strict_map_key=False)
        elif kind < 0.8:
            link.send(b"\xc1garbage")
        elif kind < 0.9:
            link.socket.sendall(b"\x82\xff\x00\x00\x00\x00\x03\xff\xff\xff1234half a frame")
            halves.append(link)
    for link in links:
        if draw.uniform() < 0.5:
            link.reset()
        elif link in halves:
            link.socket.close()
        else:
            link.close()
    return len(links), answers


@pytest.mark.parametrize("at_once", [AT_ONCE, CONNECTIONS])
def test_a_thousand_connections_leave_nothing_behind(at_once, tmp_path):
    (tmp_path / "large.py").write_text(POLICY)
    draw = np.random.default_rng(1000)
    with serving(tmp_path, f"python:{tmp_path / 'large.py'}:Large") as (process, port):
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
        after = settled(process.pid, before)
        assert after["Threads"] <= before["Threads"] + 2
        assert after["VmRSS"] - before["VmRSS"] < MORE_BYTES, (before, after)
        until = time.monotonic() + PATIENCE_S
        while descriptors(process.pid) > files + 4 and time.monotonic() < until:
            time.sleep(0.2)
        assert descriptors(process.pid) <= files + 4
        assert wave(port, 1, np.random.default_rng(1))[0] == 1, "it still serves"


def test_the_expert_gives_its_simulations_back(tmp_path):
    """Each connection of the expert has a simulation of its own."""
    with serving(tmp_path, "expert", "--task", "morning_coffee", "--condition", "T1") as (process, port):
        assert wave(port, 1, np.random.default_rng(1))[0] == 1
        time.sleep(1.0)
        before = status(process.pid)
        for number in range(3):
            wave(port, 10, np.random.default_rng(number))
        after = settled(process.pid, before)
        assert after["Threads"] <= before["Threads"] + 2
        assert after["VmRSS"] - before["VmRSS"] < MORE_BYTES, (before, after)
