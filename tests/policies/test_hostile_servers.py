"""Servers that attack their client: floods, answers given twice, redirects, texts that steer a terminal."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import http.server
import json
import socket
import struct
import threading
import time

import msgpack
import numpy as np
import pytest
import zmq
from pydantic import TypeAdapter
from tests.looping import each
from websockets.sync.server import serve

from betterbench.errors import (
    BetterError,
    HandshakeError,
    InvalidInputError,
    PolicyError,
    last_line,
    one_line,
    printable,
)
from betterbench.interface import EpisodeStart, Observation, observation_spec
from betterbench.interface.actions import action_space
from betterbench.json_form import dump_json, read_form
from betterbench.policies.clients.request_client import RequestClient
from betterbench.policies.description import describe_policy
from betterbench.policies.factory import PolicyFactory, close_policy
from betterbench.policies.kinds import make_policy, read_address
from betterbench.policies.protocols.json_wire import decode_body
from betterbench.policies.protocols.websocket import WebSocket
from betterbench.policies.protocols.wire import MAX_DECLARED_BYTES
from betterbench.records import RunFolder

PATIENCE_S = 20.0


def seen(step=0):
    return Observation("go", step, {}, np.zeros(7), np.zeros(7), np.zeros(3), np.array([1.0, 0, 0, 0]), 0.04, {}, {})


def frame(opcode, payload, *, fin=True):
    length = bytes([len(payload)]) if len(payload) < 126 else b"\x7e" + struct.pack("!H", len(payload))
    return bytes([(0x80 if fin else 0) | opcode]) + length + payload


class RawServer:
    """Accepts websockets by hand, and then does what it is told with each socket, in a thread."""

    def __init__(self, behave):
        self._behave, self.port, self._links = behave, 0, []
        self._over = threading.Event()

    def __enter__(self):
        self._listening = socket.create_server(("127.0.0.1", 0))
        self._listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.port = self._listening.getsockname()[1]
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        for link in self._links:
            with contextlib.suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join(PATIENCE_S)

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                self._threads.append(
                    threading.Thread(target=self._talk, args=(self._listening.accept()[0],), daemon=True)
                )
                self._threads[-1].start()

    def _talk(self, link):
        with link, contextlib.suppress(OSError):
            asked = b""
            while b"\r\n\r\n" not in asked:
                asked += link.recv(4096)
            key = next(line for line in asked.split(b"\r\n") if line.lower().startswith(b"sec-websocket-key"))[19:]
            token = hashlib.sha1(key.strip() + b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11", usedforsecurity=False).digest()
            link.sendall(
                b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                b"Sec-WebSocket-Accept: " + base64.b64encode(token) + b"\r\n\r\n"
            )
            self._links.append(link)
            while not self._over.is_set():
                self._behave(link)


def pings(link):
    link.sendall(frame(9, b"x" * 100) * 500)  # and reads no pong


def fragments(link):
    link.sendall(frame(0, b"", fin=False) * 500)


@pytest.mark.parametrize("flood", [pings, fragments])
def test_a_flood_hangs_nobody_past_a_deadline(flood):
    with RawServer(flood) as server:
        link = WebSocket(read_address(f"openpi://127.0.0.1:{server.port}"), timeout_s=2.0)
        time.sleep(1.5)  # until nobody takes our pongs any more
        began = time.monotonic()
        with pytest.raises((OSError, PolicyError)):
            link.receive(0.3)
        with pytest.raises((OSError, PolicyError)):
            link.send(b"x" * 100_000_000, 0.3)
        link.close()
        assert time.monotonic() - began < 6.0


def numbered(value):
    array = np.full((1, 7), value)
    form = {b"__ndarray__": True, b"data": array.tobytes(), b"dtype": "<f8", b"shape": [1, 7]}
    return msgpack.packb({"actions": form})


@contextlib.contextmanager
def websocket_server(talk, **options):
    with serve(talk, "127.0.0.1", 0, compression=None, **options) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield server.socket.getsockname()[1]
        server.shutdown()
        thread.join()


def steps_of(link):
    for message in link:
        yield float(msgpack.unpackb(message)["better/step"])


def test_an_answer_sent_twice_shifts_no_other():
    def talk(link):
        link.send(msgpack.packb({}))
        for step in steps_of(link):
            link.send(numbered(step / 100))
            link.send(numbered(step / 100))

    with websocket_server(talk) as port:
        with contextlib.closing(make_policy(f"openpi://127.0.0.1:{port}?preset=native&timeout=5&retries=1")) as policy:
            policy.reset(EpisodeStart("go", 1, "ee_delta"))
            assert [round(100 * float(policy.act(seen(i))[0, 0])) for i in range(5)] == [0, 1, 2, 3, 4]
            assert policy.figures["policy_reconnects"] == 4
        with contextlib.closing(make_policy(f"openpi://127.0.0.1:{port}?preset=native&timeout=5&retries=0")) as policy:
            policy.reset(EpisodeStart("go", 1, "ee_delta"))
            policy.act(seen(0))
            with pytest.raises(PolicyError, match="an unexpected answer"):
                policy.act(seen(1))


def test_an_answer_sent_twice_over_zeromq_is_refused():
    context = zmq.Context()
    server = context.socket(zmq.ROUTER)
    port = server.bind_to_random_port("tcp://127.0.0.1")

    def talk():
        for _ in range(2):
            who, empty, question = server.recv_multipart()
            for _ in range(2):
                server.send_multipart([who, empty, question])

    thread = threading.Thread(target=talk, daemon=True)
    thread.start()
    client = RequestClient("127.0.0.1", port, timeout_s=5.0)
    assert client.ask(b"one", 5.0) == b"one"
    with pytest.raises(ConnectionError, match="an unexpected answer"):
        client.ask(b"two", 5.0)
    client.close()
    again = RequestClient("127.0.0.1", port, timeout_s=5.0)
    assert again.ask(b"three", 5.0) == b"three"
    again.close()
    thread.join(PATIENCE_S)
    server.close(linger=0)
    context.term()


class Redirecting(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    target = ""

    def do_GET(self):
        self.send_response(302)
        self.send_header("Location", self.target)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *_):
        pass


@pytest.mark.parametrize("scheme", ["ws", "http"])
def test_a_redirect_is_refused_and_what_it_names_is_not_asked(scheme):
    visited = []

    def talk(link):
        visited.append(link)

    with websocket_server(talk) as elsewhere:
        handler = type("To", (Redirecting,), {"target": f"{scheme}://127.0.0.1:{elsewhere}/"})
        here = http.server.HTTPServer(("127.0.0.1", 0), handler)
        thread = threading.Thread(target=here.serve_forever, daemon=True)
        thread.start()
        began = time.monotonic()
        with pytest.raises(HandshakeError, match=r"redirects this client \(HTTP 302, .*Redirects are not followed"):
            make_policy(f"openpi://127.0.0.1:{here.server_port}?preset=native&patience=5")
        here.shutdown()
        thread.join()
        here.server_close()
    assert not visited
    assert time.monotonic() - began < 4.0


@pytest.mark.parametrize(("first", "was"), [({"checkpoint": "one"}, "one"), ({}, "nothing")])
def test_a_server_that_comes_back_as_another_one_is_noticed(first, was):
    declared = iter([first, first, {"checkpoint": "two"}])

    def talk(link):
        link.send(msgpack.packb(next(declared)))
        for step in steps_of(link):
            link.send(numbered(step / 100))
            return  # which ends the connection

    with (
        websocket_server(talk) as port,
        contextlib.closing(make_policy(f"openpi://127.0.0.1:{port}?preset=native&timeout=5&retries=2")) as policy,
    ):
        policy.reset(EpisodeStart("go", 1, "ee_delta"))
        policy.act(seen(0))
        policy.act(seen(1))
        with pytest.raises(HandshakeError, match=rf"checkpoint was {was} and is now two.*--allow-changed-policy"):
            policy.act(seen(2))


def test_the_error_of_a_server_is_one_line_that_steers_no_terminal():
    def talk(link):
        link.send(msgpack.packb({"name\x1b[2J": "x\x1b]0;pwned\x07"}))
        for _ in steps_of(link):
            link.send("Traceback\n  \x1b[31mred\u202e" + "x" * 100_000 + "\n\n")

    with (
        websocket_server(talk) as port,
        contextlib.closing(make_policy(f"openpi://127.0.0.1:{port}?preset=native&timeout=5&retries=0")) as policy,
    ):
        assert all(text.isprintable() for item in policy.info.metadata.items() for text in item)
        policy.reset(EpisodeStart("go", 1, "ee_delta"))
        with pytest.raises(BetterError, match=r"reports an error: .\[31mred") as raised:
            policy.act(seen(0))
    assert "\x1b" not in str(raised.value)
    assert "\u202e" not in str(raised.value)
    assert len(str(raised.value)) < 700


STEERING = "\x1b[2J\u202e a\nb " + "x" * 200_000
OURS = {"protocol": 1, "preset": "native", "action_space": action_space("ee_delta").to_json()}


@each(
    "declared",
    [
        OURS | {"protocol": STEERING},
        OURS | {"preset": STEERING},
        OURS | {"action_space": OURS["action_space"] | {"name": STEERING}},
        OURS | {"action_space": OURS["action_space"] | {"convention": STEERING}},
        OURS | {"action_space": OURS["action_space"] | {"low": [STEERING] * 7}},
        OURS | {"preset": "openpi_libero", "cameras": {STEERING: [8, 8]}},
        OURS | {"preset": "openpi_libero", "cameras": {f"c{i}\n": [8, 8] for i in range(5000)}},
        OURS | {"execution": {STEERING: 1}},
        {"protocol": {STEERING: STEERING}},
    ],
)
def test_what_a_server_declares_is_told_in_one_short_line(declared):
    with websocket_server(lambda link: link.send(msgpack.packb({"betterbench": declared}))) as port:
        with pytest.raises(BetterError) as caught:
            agree(f"openpi://127.0.0.1:{port}?retries=0&timeout=5")
        assert one_line(caught.value, most=3000) == str(caught.value)


def agree(address):
    with contextlib.closing(make_policy(address)) as policy:
        policy.check(space="ee_delta", observation=observation_spec("default"), rate_hz=20.0)


def test_texts_from_outside_keep_their_words_and_lose_what_steers():
    assert printable("a\tb\nc", most=10) == "a\tb\nc"
    assert printable("\x1b[31m\x9b\x7f\u202e\udc80", most=100) == "\ufffd[31m" + "\ufffd" * 4
    assert printable("x" * 12, most=10) == "x" * 10 + "… (2 more characters)"
    assert one_line("x" * 1000, most=10) == "x" * 10 + "… (990 more characters)"
    assert one_line("  a \n b\r\n") == "a b"
    assert len(one_line("x y " * 1_000_000)) < 600
    assert last_line("one\ntwo\x1b\n\n") == "two\ufffd"
    assert last_line(" \n") == ""
    assert one_line("naïve 机器人 é") == "naïve 机器人 é"


def test_every_client_of_a_run_asks_the_policy_that_the_run_began_with():
    checkpoints = iter(["one", "one", "two", "two"])

    def talk(link):
        link.send(msgpack.packb({"checkpoint": next(checkpoints)}))
        list(link)

    with websocket_server(talk) as port:
        address = f"openpi://127.0.0.1:{port}?preset=native&timeout=5"
        with PolicyFactory(address) as run:
            known = run.info
            close_policy(run.take())
            close_policy(run.take())
            with pytest.raises(HandshakeError, match=r"checkpoint was .one. and is now .two."):
                run.take()
        with (
            PolicyFactory(address, known=known) as worker,
            pytest.raises(HandshakeError, match=r"checkpoint was .one. and is now .two."),
        ):
            worker.check()


# ------------------------------------------------------------------------------------- what declarations may be


def nested(depth):
    value = "x"
    for _ in range(depth):
        value = [value]
    return value


TOO_MUCH = {
    "large": ({"notes": "x" * (MAX_DECLARED_BYTES + 1)}, r"of \d{7} bytes, but the limit is 4194304"),
    "deep": ({"notes": nested(20)}, r"the declaration cannot be read.*nested deeper than 16"),
}


@contextlib.contextmanager
def speaking_first(declared):
    with websocket_server(lambda link: link.send(msgpack.packb(declared))) as port:
        yield f"127.0.0.1:{port}"


@contextlib.contextmanager
def saying_hello(declared):
    def talk(link):
        asked = msgpack.unpackb(link.recv())
        hello = {"protocol_version": 1, **declared}
        link.send(msgpack.packb({"type": "hello", "payload": hello, "seq": asked["seq"], "timestamp": 0.0}))

    with websocket_server(talk) as port:
        yield f"127.0.0.1:{port}"


@contextlib.contextmanager
def over_zeromq(declared):
    context = zmq.Context()
    server = context.socket(zmq.REP)
    port = server.bind_to_random_port("tcp://127.0.0.1")

    over = threading.Event()

    def talk():
        while not over.is_set():
            if server.poll(20):
                asked = msgpack.unpackb(server.recv())["endpoint"]
                server.send(msgpack.packb({"status": "ok"} if asked == "ping" else declared))
        server.close(linger=0)

    thread = threading.Thread(target=talk, daemon=True)
    thread.start()
    yield f"127.0.0.1:{port}"
    over.set()
    thread.join(PATIENCE_S)
    context.term()


@contextlib.contextmanager
def over_http(declared):
    class Declaring(Redirecting):
        def do_GET(self):
            body = json.dumps(declared).encode()
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

    here = http.server.HTTPServer(("127.0.0.1", 0), Declaring)
    thread = threading.Thread(target=here.serve_forever, daemon=True)
    thread.start()
    yield f"127.0.0.1:{here.server_port}"
    here.shutdown()
    thread.join()
    here.server_close()


SERVERS = {
    "openpi://{}?preset=native": speaking_first,
    "starvla://{}": speaking_first,
    "vla-eval://{}?preset=vla_eval": saying_hello,
    "gr00t://{}": over_zeromq,
    "http://{}/v1/infer?preset=dexbotic": over_http,
}


@each("address", SERVERS)
@each("kind", TOO_MUCH)
def test_a_declaration_too_large_or_too_deep_is_one_line(address, kind):
    declared, text = TOO_MUCH[kind]
    if kind == "large" and address.startswith("http"):
        text = "4194304 bytes"  # no body may be larger
    with SERVERS[address](declared) as server:
        target = address.format(server)
        with pytest.raises(BetterError, match=text) as caught:
            make_policy(f"{target}{'&' if '?' in target else '?'}timeout=10&retries=0&patience=0.2")
    assert one_line(caught.value, most=1000) == str(caught.value)


@pytest.mark.parametrize("depth", [40, 900, 100_000])
def test_a_deep_body_is_refused_before_anything_goes_through_it(depth):
    with pytest.raises(PolicyError, match="cannot be read"):
        decode_body(b'{"a":' + b"[" * depth + b"]" * depth + b"}")


def test_half_a_character_in_a_declared_document_ends_no_run():
    document = '{"\\ud800": ["\\udfff\\u009b\\u202e", {"a": "\\ud83d\\ude00"}]}'
    with (
        websocket_server(lambda link: link.send(msgpack.packb({"doc": document}))) as port,
        contextlib.closing(make_policy(f"openpi://127.0.0.1:{port}?preset=native&timeout=5")) as policy,
    ):
        found = describe_policy("a", policy.info)
    assert found["metadata"]["server: doc"] == {"\\ud800": ["\\udfff\x9b\u202e", {"a": "\U0001f600"}]}
    assert json.loads(dump_json(found)) == found


@pytest.mark.parametrize(
    "document",
    [
        '{"n": 123456789012345678901234567890}',
        '{"n": [-18446744073709551616, 1e999]}',
        '["step:12345678901234567890123"]',
    ],
)
def test_a_run_can_be_read_whatever_number_its_server_declared(document, tmp_path):
    with (
        websocket_server(lambda link: link.send(msgpack.packb({"doc": document, "d": f"[{2**80}"}))) as port,
        contextlib.closing(make_policy(f"openpi://127.0.0.1:{port}?preset=native&timeout=5")) as policy,
    ):
        declared = describe_policy("a", policy.info)
    RunFolder.start(tmp_path / "run", {"policy": "a", "trials": []}, context={"policy": declared})
    assert RunFolder.open(tmp_path / "run").context["policy"] == declared


def test_a_number_beyond_64_bits_is_refused_where_it_is_a_number():
    adapter = TypeAdapter(dict[str, str | int])
    told = {"a": f"x:{10**30}", "b": f"[{10**30}", "c": 2**62}
    assert read_form(adapter, dump_json(told), where="f", cure="c") == told
    for number in (10**19, -(10**25)):
        with pytest.raises(InvalidInputError, match="20 digits"):
            read_form(adapter, dump_json({"a": "b", "n": number}), where="f", cure="c")


def modality(keys, steps=(0,)):
    form = {"delta_indices": list(steps), "modality_keys": list(keys)}
    return {"__ModalityConfig_class__": True, "as_json": form}


@pytest.mark.parametrize(
    "declared",
    [
        {"video": modality([STEERING]), "state": modality(["x"])},
        {"video": modality([f"c{i}\x9b" for i in range(20_000)])},
        {"video": modality(["front"], range(-9_000, 3)), "state": modality(["x"])},
        {"language": modality([STEERING, "b"])},
    ],
)
def test_what_a_gr00t_server_wants_is_told_in_one_short_line(declared):
    with over_zeromq(declared) as server:
        with pytest.raises(HandshakeError) as caught:
            make_policy(f"gr00t://{server}?timeout=10&retries=0&patience=0.2")
        assert one_line(caught.value, most=3000) == str(caught.value)
