"""Many clients that stay within a message: what they hold together is bounded, and nobody who is honest waits long."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import subprocess
import sys
import threading
import time

import msgpack
import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from betterbench.policies.serving.frame_budget import FrameBudget, MessageMeter
from betterbench.policies.serving.server import PolicyServer

PATIENCE_S = 20.0
MIB = 1 << 20


class Echo:
    def answer(self, request):
        return {"actions": np.full((1, 7), float(request["number"]))}

    def close(self):
        pass


def frame(size, *, sent, last=True, opcode=2, key=b"\0\0\0\0"):
    """Return the head of a frame of a client, and the first bytes of its content."""
    head = bytes([(0x80 if last else 0) | opcode])
    if size < 126:
        head += bytes([0x80 | size])
    elif size < 1 << 16:
        head += bytes([0x80 | 126]) + struct.pack(">H", size)
    else:
        head += bytes([0x80 | 127]) + struct.pack(">Q", size)
    return head + key + b"\0" * sent


def raw(port, greet=True):
    """Return a plain socket, after the greetings of the websocket and of the server if wanted: then it is counted."""
    link = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    if greet:
        head = f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        link.sendall(f"{head}Sec-WebSocket-Key: {'A' * 22}==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
        seen = b""
        while not seen.partition(b"\r\n\r\n")[2]:
            seen += (more := link.recv(4096))
            assert more, seen
        assert b" 101 " in seen
    return link


def asked(port, number):
    with connect(f"ws://127.0.0.1:{port}", compression=None, open_timeout=PATIENCE_S) as link:
        link.recv(timeout=PATIENCE_S)
        link.send(msgpack.packb({"number": number}))
        return msgpack.unpackb(link.recv(timeout=PATIENCE_S), strict_map_key=False)


@pytest.mark.parametrize("step", [1, 2, 7, 1000])
def test_the_meter_counts_what_is_not_whole_however_it_comes(step):
    meter = MessageMeter()
    stream = b"GET / HTTP/1.1\r\nHost: a\r\n\r\n" + frame(5, sent=5) + frame(0, sent=0) + frame(4, sent=4, opcode=9)
    stream += frame(300, sent=300, last=False) + frame(3, sent=3, opcode=9) + frame(70_000, sent=70_000, opcode=0)
    stream += frame(100_000, sent=6)
    for at in range(0, len(stream), step):
        meter.feed(stream[at : at + step])
    assert list(meter.queued) == [5, 0, 70_300]
    assert meter.unfinished == 6
    assert meter.is_within
    for _ in range(4):
        meter.taken()
    assert meter.held == 6


def test_many_unfinished_messages_stay_within_the_budget_and_the_honest_are_served():
    budget = FrameBudget(4 * MIB, stuck_s=0.5)
    with PolicyServer(Echo, metadata={}, port=0, budget=budget) as server, contextlib.ExitStack() as stack:
        most, over = [0], threading.Event()

        def watch():
            while not over.wait(0.005):
                most[0] = max(most[0], budget.held)

        def greedy():
            with contextlib.suppress(OSError):
                link = stack.enter_context(contextlib.closing(raw(server.port)))
                link.sendall(frame(3 * MIB, sent=3 * MIB - 1))
                link.recv(1)

        workers = [threading.Thread(target=watch), *(threading.Thread(target=greedy, daemon=True) for _ in range(12))]
        for worker in workers:
            worker.start()
        time.sleep(0.3)
        began = time.monotonic()
        for number in range(3):
            assert asked(server.port, number)["actions"] is not None
        assert time.monotonic() - began < 10.0
        over.set()
        workers[0].join()
        assert MIB < most[0] <= 4 * MIB + 3 * MIB + 13 * (1 << 16)


def test_clients_that_are_stuck_make_room_for_others_and_stay_where_nobody_waits():
    with PolicyServer(Echo, metadata={}, port=0, clients=2, budget=FrameBudget(stuck_s=0.4)) as server:
        stuck = [raw(server.port) for _ in range(2)]
        for link in stuck:
            link.sendall(frame(1000, sent=10))
        with pytest.raises(InvalidStatus, match="503"):  # not at once
            asked(server.port, 1)
        drip_until = time.monotonic() + 0.8
        while time.monotonic() < drip_until:  # a byte now and then does not help
            for link in stuck:
                link.sendall(b"\0")
            time.sleep(0.1)
        assert asked(server.port, 2)["actions"] is not None
        for link in stuck:
            link.close()


def test_a_client_that_thinks_between_its_questions_is_not_stuck():
    budget = FrameBudget(stuck_s=0.1)
    with PolicyServer(Echo, metadata={}, port=0, clients=1, budget=budget) as server, contextlib.ExitStack() as stack:
        link = stack.enter_context(connect(f"ws://127.0.0.1:{server.port}", compression=None))
        link.recv(timeout=PATIENCE_S)
        for number in range(2):
            time.sleep(0.4)
            with pytest.raises(InvalidStatus, match="503"):
                asked(server.port, 1)
            link.send(msgpack.packb({"number": number}))
            link.recv(timeout=PATIENCE_S)


def test_connections_that_say_nothing_do_not_block_others():
    with PolicyServer(Echo, metadata={}, port=0, clients=1, budget=FrameBudget(stuck_s=0.3)) as server:
        silent = [raw(server.port, greet=False) for _ in range(60)]  # more than may be greeted at once
        for link in silent:
            link.sendall(b"GET / HT")
        began = time.monotonic()
        assert asked(server.port, 3)["actions"] is not None
        assert time.monotonic() - began < 8.0
        for link in silent:
            link.close()


def test_a_server_stops_while_clients_are_stuck():
    with PolicyServer(Echo, metadata={}, port=0, budget=FrameBudget(1000, stuck_s=60.0)) as server:
        links = [raw(server.port) for _ in range(4)]
        for link in links:
            link.sendall(frame(100_000, sent=5000))
        time.sleep(0.3)
        began = time.monotonic()
    assert time.monotonic() - began < 7.0, "each of the four is waited for, but all at once"
    for link in links:
        link.close()


_SERVER = """
import resource, sys, time
from tests.policies.test_frame_budget import Echo, MIB
from betterbench.policies.serving.server import PolicyServer
with PolicyServer(Echo, metadata={}, port=0) as server:
    print(server.port, flush=True)
    sys.stdin.readline()
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024, flush=True)
"""


@pytest.mark.slow
def test_the_memory_of_a_server_that_24_clients_fill_is_bounded():
    # glibc would keep freed blocks of up to 32 MiB in each thread's heap, 250 to 1,200 MiB in all, by chance
    environment = {**os.environ, "MALLOC_MMAP_THRESHOLD_": "131072"}
    process = subprocess.Popen(
        [sys.executable, "-c", _SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    )
    try:
        port = int(process.stdout.readline())

        def fill():
            with contextlib.suppress(OSError), contextlib.closing(raw(port)) as link:
                for _ in range(63):
                    link.sendall(frame(64 * MIB - 1, sent=MIB) if _ == 0 else b"\0" * MIB)
                link.recv(1)

        for _ in range(24):
            threading.Thread(target=fill, daemon=True).start()
        time.sleep(4.0)
        peak_mib = int(process.communicate("\n", timeout=30)[0])
        assert peak_mib < 400, peak_mib  # the budget, one message and the process itself: about 190
    finally:
        process.kill()
