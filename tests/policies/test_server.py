"""Our server of the openpi protocol, talked to in raw frames: greeting, answers, errors, keys, health, shutdown."""

from __future__ import annotations

import contextlib
import errno
import http.client
import math
import socket
import threading
import time

import msgpack
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from betterbench.errors import InvalidInputError, PolicyError
from betterbench.policies.batching import BatchCollector
from betterbench.policies.serving.listener import Listener
from betterbench.policies.serving.server import PolicyServer

PATIENCE_S = 20


class Echo:
    """Answers the number it is sent, and knows how many it has answered on its own connection."""

    closed = 0

    def __init__(self):
        self.answered = 0

    def answer(self, request):
        if request.get("fault") == "clean":
            raise PolicyError("the oven is cold. Light it")
        if request.get("fault") == "bug":
            raise ZeroDivisionError("a bug")
        self.answered += 1
        return {"actions": np.full((2, 7), float(request["number"])), "answered": self.answered}

    def close(self):
        type(self).closed += 1


@pytest.fixture
def server():
    Echo.closed = 0
    with PolicyServer(Echo, metadata={"what": "echo"}, port=0) as made:
        yield made


def client(server, **options):
    return connect(f"ws://127.0.0.1:{server.port}", compression=None, max_size=None, **options)


def ask(link, **request):
    link.send(msgpack.packb(request))
    return msgpack.unpackb(link.recv(timeout=PATIENCE_S), strict_map_key=False)


def array(form):
    return np.frombuffer(form[b"data"], dtype=form[b"dtype"]).reshape(form[b"shape"])


def test_the_server_speaks_first_and_answers_frame_by_frame(server):
    with client(server) as link:
        assert msgpack.unpackb(link.recv(timeout=PATIENCE_S)) == {"what": "echo"}
        first, second = ask(link, number=1), ask(link, number=2)
    np.testing.assert_array_equal(array(first["actions"]), np.full((2, 7), 1.0))
    np.testing.assert_array_equal(array(second["actions"]), np.full((2, 7), 2.0))
    assert set(first["server_timing"]) == {"infer_ms"}
    assert set(second["server_timing"]) == {"infer_ms", "prev_total_ms"}


def test_every_connection_has_a_session_of_its_own(server):
    with client(server) as one, client(server) as two:
        one.recv(timeout=PATIENCE_S), two.recv(timeout=PATIENCE_S)
        assert [ask(one, number=1)["answered"], ask(two, number=1)["answered"], ask(one, number=1)["answered"]] == [
            1,
            1,
            2,
        ]


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (b"\xc1garbage", "frame"),
        (b"", "frame"),
        (msgpack.packb([1, 2]), "list"),
        ("a text frame", "binary"),
        (msgpack.packb({"number": 1, "x": {b"__ndarray__": True, b"data": b"1", b"dtype": "|O", b"shape": [1]}}), ""),
        (msgpack.packb({"fault": "clean"}), "the oven is cold. Light it"),
        (msgpack.packb({"fault": "bug"}), "ZeroDivisionError: a bug"),
    ],
)
def test_a_bad_frame_is_answered_with_its_reason_and_harms_nobody_else(server, frame, text):
    with client(server) as good, client(server) as bad:
        good.recv(timeout=PATIENCE_S), bad.recv(timeout=PATIENCE_S)
        bad.send(frame)
        answer = bad.recv(timeout=PATIENCE_S)
        assert isinstance(answer, str)
        assert text in answer
        with pytest.raises(ConnectionClosed) as closed:
            bad.recv(timeout=PATIENCE_S)
        assert closed.value.rcvd.code == 1011
        assert ask(good, number=3)["answered"] == 1


def test_a_deliberate_error_is_one_line_and_a_bug_a_traceback(server):
    texts = []
    for fault in ("clean", "bug"):
        with client(server) as link:
            link.recv(timeout=PATIENCE_S)
            link.send(msgpack.packb({"fault": fault}))
            texts.append(link.recv(timeout=PATIENCE_S))
    assert texts[0].count("\n") == 0
    assert texts[1].startswith("Traceback")


def test_health_is_told_without_a_websocket(server):
    talk = http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE_S)
    talk.request("GET", "/healthz")
    answer = talk.getresponse()
    assert (answer.status, answer.read().strip()) == (200, b"OK")
    talk.close()


def test_a_key_is_asked_for():
    with PolicyServer(Echo, metadata={}, port=0, api_key="secret") as server:
        for headers in ({}, {"Authorization": "Api-Key wrong"}, {"Authorization": "secret"}):
            with pytest.raises(InvalidStatus) as refused, client(server, additional_headers=headers):
                pass
            assert refused.value.response.status_code == 401
        with client(server, additional_headers={"Authorization": "Api-Key secret"}) as link:
            assert msgpack.unpackb(link.recv(timeout=PATIENCE_S)) == {}


def test_a_port_in_use_is_one_clear_line(server):
    with pytest.raises(InvalidInputError, match=rf"--port: {server.port} is in use on 127.0.0.1\. Use another port"):
        PolicyServer(Echo, metadata={}, port=server.port)


@pytest.mark.parametrize(
    ("host", "port", "text"), [("no.such.host.invalid", 0, "--host"), ("127.0.0.1", 70000, "70000")]
)
def test_where_nobody_can_listen_is_one_clear_line(host, port, text):
    with pytest.raises(InvalidInputError, match=text):
        PolicyServer(Echo, metadata={}, host=host, port=port)


def test_stopping_closes_connections_and_sessions_and_frees_the_port():
    Echo.closed = 0
    stopped = []
    server = PolicyServer(Echo, metadata={}, port=0, on_stop=lambda: stopped.append(True))
    server.start()
    with client(server) as link:
        link.recv(timeout=PATIENCE_S)
        assert ask(link, number=1)["answered"] == 1
        server.stop()
        with pytest.raises(ConnectionClosed):
            link.recv(timeout=PATIENCE_S)
    assert (Echo.closed, stopped) == (1, [True])
    assert not [t for t in threading.enumerate() if t.name == f"serve:{server.port}"]
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S)


def test_stopping_waits_for_the_session_of_a_client_that_has_just_left(caplog):
    closing = threading.Event()

    class ClosesSlowly(Echo):
        def close(self):
            closing.set()
            time.sleep(0.3)
            super().close()

    Echo.closed = ClosesSlowly.closed = 0
    made = PolicyServer(ClosesSlowly, metadata={}, port=0)
    made.start()
    with caplog.at_level("INFO", logger="betterbench.policies.serving.server"):
        with client(made) as link:
            link.recv(timeout=PATIENCE_S)
            ask(link, number=1)
        assert closing.wait(PATIENCE_S)
        made.stop()
        told = [record.getMessage() for record in caplog.records]
    assert ClosesSlowly.closed == 1
    assert any("left after 1 answers" in text for text in told)


def test_a_client_that_breaks_off_is_forgotten(server):
    with client(server) as link:
        link.recv(timeout=PATIENCE_S)
        link.socket.shutdown(socket.SHUT_RDWR)
    with client(server) as other:
        other.recv(timeout=PATIENCE_S)
        assert ask(other, number=1)["answered"] == 1


def test_pages_of_other_sites_are_refused(server):
    for origin in ("https://evil.example", "null", f"http://evil.example:{server.port}", "http://127.0.0.1:1"):
        with pytest.raises(InvalidStatus) as refused, client(server, origin=origin):
            pass
        assert refused.value.response.status_code == 403
    with client(server, origin=f"http://127.0.0.1:{server.port}") as link:
        link.recv(timeout=PATIENCE_S)


def until(check):
    end = time.monotonic() + PATIENCE_S
    while not check() and time.monotonic() < end:
        time.sleep(0.01)
    return check()


def test_an_idle_client_has_no_session_and_is_sent_away(monkeypatch):
    made = []

    def make():
        made.append(Echo())
        return made[-1]

    with PolicyServer(make, metadata={}, port=0) as server:
        with client(server) as idle, client(server) as asking:
            idle.recv(timeout=PATIENCE_S), asking.recv(timeout=PATIENCE_S)
            assert ask(asking, number=1)["answered"] == 1
            assert len(made) == 1
        monkeypatch.setattr("betterbench.policies.serving.server.IDLE_S", 0.05)
        with client(server) as idle:
            idle.recv(timeout=PATIENCE_S)
            with pytest.raises(ConnectionClosed) as closed:
                idle.recv(timeout=PATIENCE_S)
            assert closed.value.rcvd.code == 1001


def test_more_clients_than_allowed_are_sent_away_and_those_inside_stay():
    with PolicyServer(Echo, metadata={}, port=0, clients=2) as server, contextlib.ExitStack() as stack:
        one, two = (stack.enter_context(client(server)) for _ in range(2))
        one.recv(timeout=PATIENCE_S), two.recv(timeout=PATIENCE_S)
        for _ in range(3):
            with pytest.raises(InvalidStatus) as refused, client(server):
                pass
            assert refused.value.response.status_code == 503
        assert ask(one, number=1)["answered"] == 1
        two.close()
        assert until(lambda: not server._full())
        with client(server) as three:
            three.recv(timeout=PATIENCE_S)
            assert ask(three, number=1)["answered"] == 1


def test_the_client_that_is_silent_longest_is_let_go_when_another_one_waits():
    with (
        PolicyServer(Echo, metadata={}, port=0, clients=2, idle_while_full_s=1.0) as server,
        contextlib.ExitStack() as stack,
    ):
        silent, talking = (stack.enter_context(client(server)) for _ in range(2))
        silent.recv(timeout=PATIENCE_S), talking.recv(timeout=PATIENCE_S)
        with pytest.raises(InvalidStatus), client(server):  # neither has been silent for long
            pass
        time.sleep(1.2)
        assert ask(talking, number=1)["answered"] == 1
        waiting = stack.enter_context(client(server))
        waiting.recv(timeout=PATIENCE_S)
        assert ask(waiting, number=1)["answered"] == 1
        assert ask(talking, number=1)["answered"] == 2
        with pytest.raises(ConnectionClosed) as gone:
            silent.recv(timeout=PATIENCE_S)
        assert gone.value.rcvd is not None
        assert gone.value.rcvd.code == 1001
        assert "while others were waiting" in gone.value.rcvd.reason


def test_silent_clients_keep_their_slots_while_there_are_others():
    with PolicyServer(Echo, metadata={}, port=0, clients=2, idle_while_full_s=0.0) as server, client(server) as silent:
        silent.recv(timeout=PATIENCE_S)
        with client(server) as other:
            other.recv(timeout=PATIENCE_S)
        assert ask(silent, number=1)["answered"] == 1


def test_a_client_whose_answer_is_under_way_is_not_silent():
    begun, go = threading.Event(), threading.Event()

    class Slow(Echo):
        def answer(self, request):
            begun.set()
            go.wait(PATIENCE_S)
            return super().answer(request)

    with (
        PolicyServer(Slow, metadata={}, port=0, clients=1, idle_while_full_s=0.0) as server,
        client(server) as working,
    ):
        working.recv(timeout=PATIENCE_S)
        working.send(msgpack.packb({"number": 1}))
        assert begun.wait(PATIENCE_S)
        with pytest.raises(InvalidStatus), client(server):
            pass
        go.set()
        assert msgpack.unpackb(working.recv(timeout=PATIENCE_S), strict_map_key=False)["answered"] == 1


def test_a_silent_client_that_answers_no_closing_frame_is_let_go_too():
    with (
        PolicyServer(Echo, metadata={}, port=0, clients=1, idle_while_full_s=0.0) as server,
        socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S) as asleep,
    ):
        asleep.sendall(
            b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        )
        assert until(lambda: bool(server._silent_since))
        with client(server) as waiting:
            waiting.recv(timeout=PATIENCE_S)
            assert ask(waiting, number=1)["answered"] == 1


def test_those_who_say_nothing_are_taken_in_turns_and_the_server_can_still_stop():
    with PolicyServer(Echo, metadata={}, port=0, clients=1) as server, contextlib.ExitStack() as stack:
        for _ in range(60):
            stack.enter_context(socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S))
        threads = [t for t in threading.enumerate() if t is not threading.current_thread()]
        assert len(threads) < 2 * 40
        stack.close()
        with client(server) as link:
            link.recv(timeout=PATIENCE_S)
            assert ask(link, number=1)["answered"] == 1


def test_a_server_that_has_no_descriptor_left_goes_on_when_there_is_one():
    tries = []

    class Poor(Listener):
        def _take(self):
            tries.append(1)
            if len(tries) < 3:
                raise OSError(errno.EMFILE, "Too many open files")
            return super()._take()

    with (
        contextlib.closing(Poor(socket.create_server(("127.0.0.1", 0)), most=1)) as listening,
        socket.create_connection(listening.getsockname()),
    ):
        taken, _ = listening.accept()
        taken.close()
    assert len(tries) == 3
    with pytest.raises(OSError, match="Bad file"):
        listening.accept()


def test_what_waits_is_answered_together_and_nothing_waits_for_company():
    sizes, begun, go_on = [], threading.Event(), threading.Event()

    def answer(questions):
        sizes.append(len(questions))
        begun.set()
        assert go_on.wait(PATIENCE_S)
        return [q + 1 for q in questions]

    collector = BatchCollector(answer, limit=3)
    answers = {}
    threads = [threading.Thread(target=lambda i=i: answers.update({i: collector.ask(i)})) for i in range(6)]
    threads[0].start()
    assert begun.wait(PATIENCE_S)
    for thread in threads[1:]:
        thread.start()
    for _ in range(5000):
        if collector._waiting.qsize() == 5:
            break
        threading.Event().wait(0.001)
    go_on.set()
    for thread in threads:
        thread.join(PATIENCE_S)
    collector.close()
    assert answers == {i: i + 1 for i in range(6)}
    assert sizes == [1, 3, 2]


@pytest.mark.parametrize(("expected", "sizes"), [(4, [1, 4]), (5, [1, 4]), (1, [1, 1, 3])])
def test_a_call_waits_for_questions_that_are_expected_but_not_for_longer_than_a_call_takes(expected, sizes):
    found, answers = [], {}

    def answer(questions):
        found.append(len(questions))
        time.sleep(0.5)
        return questions

    collector = BatchCollector(answer, expected=lambda: expected if found else 1)
    assert collector.ask(0) == 0
    threads = [threading.Thread(target=lambda i=i: answers.update({i: collector.ask(i)})) for i in range(4)]
    for i, thread in enumerate(threads):
        thread.start()
        time.sleep(0.1 if i == 0 else 0.0)
    for thread in threads:
        thread.join(PATIENCE_S)
    collector.close()
    assert (found, answers) == (sizes, {i: i for i in range(4)})


def test_a_call_does_not_wait_for_questions_that_are_expected_no_longer():
    expected, ended = [1], []
    collector = BatchCollector(lambda questions: time.sleep(1.0) or questions, expected=lambda: expected[0])
    collector.ask(0)
    expected[0] = 2
    thread = threading.Thread(target=lambda: ended.append((collector.ask(1), time.perf_counter())))
    began = time.perf_counter()
    thread.start()
    time.sleep(0.1)
    expected[0] = 1  # its trial has ended without a further question
    thread.join(PATIENCE_S)
    collector.close()
    assert ended[0][0] == 1
    assert ended[0][1] - began < 1.8


def test_a_batch_that_fails_is_asked_one_by_one():
    begun, go_on, sizes, outcomes = threading.Event(), threading.Event(), [], {}

    def answer(questions):
        sizes.append(len(questions))
        begun.set()
        assert go_on.wait(PATIENCE_S)
        if "bad" in questions:
            raise ValueError("bad question")
        return [q.upper() for q in questions]

    collector = BatchCollector(answer)

    def work(question):
        try:
            outcomes[question] = collector.ask(question)
        except ValueError as error:
            outcomes[question] = str(error)

    threads = [threading.Thread(target=work, args=(q,)) for q in ("first", "one", "bad", "two")]
    threads[0].start()
    assert begun.wait(PATIENCE_S)
    for thread in threads[1:]:
        thread.start()
    for _ in range(5000):
        if collector._waiting.qsize() == 3:
            break
        threading.Event().wait(0.001)
    go_on.set()
    for thread in threads:
        thread.join(PATIENCE_S)
    collector.close()
    assert outcomes == {"first": "FIRST", "one": "ONE", "bad": "bad question", "two": "TWO"}
    assert sizes == [1, 3, 1, 1, 1]


def test_the_time_of_an_answer_begins_when_it_can_be_given():
    go_on, ready, outcomes = threading.Event(), [math.inf], []
    collector = BatchCollector(lambda questions: go_on.wait(PATIENCE_S) and questions)

    def ask():
        with pytest.raises(TimeoutError):
            collector.ask(1, timeout_s=0.01, ready_at=lambda: ready[0])
        outcomes.append("late")

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join(0.3)
    assert outcomes == []
    ready[0] = time.perf_counter()
    thread.join(PATIENCE_S)
    assert outcomes == ["late"]
    go_on.set()
    collector.close()


def test_too_few_answers_are_an_error_and_a_closed_gatherer_answers_nobody():
    collector = BatchCollector(lambda _: [])
    with pytest.raises(ValueError, match="0 answers to 1"):
        collector.ask(1)
    collector.close()
    with pytest.raises(RuntimeError, match="shut down"):
        collector.ask(1)
