"""A process that is asked: its answers, its deadlines, and its end with everything that it has started."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from betterbench.jobs.asked_process import AskedProcess
from betterbench.jobs.frames import FrameEndError, FrameError, FrameTimeoutError

CHILD = """
import os, socket, struct, subprocess, sys, time
from betterbench.jobs.frames import answer_requests, send_frame

link = socket.socket(fileno=int(sys.argv[1]))

def answer(asked, arrays):
    if asked["do"] == "double":
        return {"done": True}, {name: 2 * array for name, array in arrays.items()}
    if asked["do"] == "twice":
        send_frame(link, {"first": True}, {}, number=1)
        return {"second": True}, {}
    if asked["do"] == "early":
        send_frame(link, {}, {}, number=99)
    if asked["do"] == "trickle":
        link.sendall(struct.pack(">IIQQ", 1000, 0, 0, 1))
        while True:
            link.sendall(b"\\0")
            time.sleep(0.01)
    if asked["do"] == "leave a child":
        subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], close_fds=False)
        os.set_inheritable(link.fileno(), True)
        os._exit(7)
    return None

send_frame(link, {"ready": True}, {})
answer_requests(link, answer)
"""


@pytest.fixture
def child():
    process = AskedProcess(
        lambda link: [sys.executable, "-c", CHILD, str(link)], output=subprocess.DEVNULL, environment=dict(os.environ)
    )
    assert process.greeting(limit_s=60.0) == ({"ready": True}, {})
    yield process
    process.end(0.0)


def test_questions_are_answered_until_it_is_hung_up(child):
    for number in range(3):
        document, arrays = child.ask({"do": "double"}, {"a": np.arange(3) + number}, limit_s=60.0)
        assert document == {"done": True}
        assert arrays["a"].tolist() == [2 * (n + number) for n in range(3)]
    assert child.waits
    child.hang_up()
    assert child.end(60.0) == 1, "the loop raises FrameEndError"
    assert child.end(0.0) is not None, "harmless when it has ended"


def test_an_answer_that_is_sent_twice_is_left_out_and_one_that_nobody_asked_for_is_refused(child):
    assert child.ask({"do": "twice"}, {}, limit_s=60.0) == ({"first": True}, {})
    time.sleep(0.1)
    assert not child.waits, "it has sent more than it was asked"
    assert child.ask({"do": "double"}, {}, limit_s=60.0) == ({"done": True}, {})
    with pytest.raises(FrameError, match="expected frame number 3, got 99"):
        child.ask({"do": "early"}, {}, limit_s=60.0)


def test_a_deadline_is_for_the_whole_answer(child):
    with pytest.raises(FrameTimeoutError, match="in time"):
        child.ask({"do": "trickle"}, {}, limit_s=0.5)


def test_an_end_is_seen_and_takes_along_what_it_has_started(child):
    with pytest.raises(FrameEndError):
        child.ask({"do": "leave a child"}, {}, limit_s=60.0)
    assert child.end(10.0) == 7
    until = time.monotonic() + 10.0
    while _in_group(child.pid) and time.monotonic() < until:
        time.sleep(0.05)
    assert not _in_group(child.pid)


def _in_group(leader: int) -> list[str]:
    """Return the states of the living processes of a group."""
    found = []
    for place in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, group, *_ = place.read_bytes().rpartition(b")")[2].split()
        except OSError:
            continue
        if int(group) == leader and state not in b"ZX":
            found.append(place.parent.name)
    return found
