"""What goes wrong in the process of a stand-in of a simulator, once.

The environment variable ``FAKE_FAULT`` holds lines "KIND:WHERE:FILE": what goes wrong, in which trial, and the file
that says that it has. ``FAKE_RUN`` is the process of the run.
"""

import os
import signal
import struct
import sys
import time
from pathlib import Path

from betterbench.jobs import frames


def fault_due(here):
    """Return what goes wrong now in a trial for which ``here`` is true of the place that the fault names, or None."""
    for line in os.environ.get("FAKE_FAULT", "").splitlines():
        kind, where, file = line.rsplit(":", 2)
        if here(where) and not Path(file).exists():
            Path(file).touch()
            return kind
    return None


def twice(link, frame):
    link.sendall(frame)
    time.sleep(0.5)  # until the first one is read
    link.sendall(frame)


def slowly(link, frame):
    for place in range(len(frame)):
        link.sendall(frame[place : place + 1])
        time.sleep(0.2)


def half(link, frame):
    link.sendall(frame[: len(frame) // 2])
    os._exit(9)


def half_and_waits(link, frame):
    link.sendall(frame[: len(frame) // 2])
    time.sleep(1000.0)


def late(link, frame):
    time.sleep(3.0)
    link.sendall(frame)


def of_another_request(link, frame):
    link.sendall(frame[:16] + struct.pack(">Q", 1) + frame[24:])


def huge(link, frame):
    link.sendall(struct.pack(">IIQQ", 2, 2, 1 << 60, 4) + b"{}{}")


SENT = {f.__name__.replace("_", " "): f for f in (twice, slowly, half, half_and_waits, late, of_another_request, huge)}
"""Ways to send an answer."""


def answer_with(way):
    """Let the next answer be sent in some way."""
    plain = frames.send_frame

    class Kept:
        def __init__(self):
            self.frame = b""

        def sendall(self, frame):
            self.frame += frame

    def send(link, document, arrays, **named):
        frames.send_frame, kept = plain, Kept()
        plain(kept, document, arrays, **named)
        way(link, kept.frame)

    frames.send_frame = send


def fail(kind):
    """Let it go wrong, unless it is a number that is none."""
    if kind == "dies":
        os._exit(9)
    if kind == "hangs":
        time.sleep(1000.0)
    if kind == "raises":
        raise RuntimeError("the cube is gone")
    if kind == "prints much":
        for _ in range(50):
            os.write(1, b"x" * 1_000_000)
        os.write(1, b"\n\x1b[31mthe last word\n")
        os._exit(9)
    if kind == "raises in lines":
        raise RuntimeError("\x1b[31mthe cube\nis gone" + "!" * 100_000)
    if kind in SENT:
        answer_with(SENT[kind])
    if kind == "garbage":
        os.write(int(sys.argv[-1]), b"mujoco says hello, and more than that\n" * 10)
    if kind == "kill the simulator":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "kill the worker":
        os.kill(os.getppid(), signal.SIGKILL)
    if kind == "kill the run":
        os.kill(int(os.environ["FAKE_RUN"]), signal.SIGKILL)
