"""Thousands of mutations of what each kind of server answers: refused in one line, or the numbers that it states.

What an answer states is read here by msgpack, json and NumPy alone, and strictly.
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
import socket
import threading
import time

import msgpack
import numpy as np
import pytest
import zmq
from tests.evaluation.mutating import mutated_bytes, mutated_form, nudged
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

from betterbench.errors import BetterError
from betterbench.interface import EpisodeStart, Observation
from betterbench.policies.clients import endpoint_server, http_act, openpi, starvla, vla_eval
from betterbench.policies.clients.http_act import HttpAnswer
from betterbench.policies.kinds import make_policy
from betterbench.policies.protocols.websocket import WebSocket

pytestmark = pytest.mark.slow

COUNT = 5000
"""Mutations of each kind of answer, which the client is handed without a socket."""
OVER_SOCKETS = 200
"""Mutations of each kind of answer that come over a socket."""
GREETINGS = 500
"""Mutations of what a server says before it is asked."""

LONGEST_S = 60.0
"""Longest time of one question [s], on a busy machine."""
OPTIONS = "timeout=2&retries=0&patience=0.2"
START = EpisodeStart("pack the apple", 3, "ee_delta")
ACTIONS = np.random.default_rng(7).uniform(-0.5, 0.5, (8, 7)).astype(np.float32)


class UnstatedError(Exception):
    """An answer states no actions."""


def seen():
    images = {name: np.full((32, 32, 3), i, np.uint8) for i, name in enumerate(("front", "wrist"))}
    return Observation(
        "pack the apple", 0, images, np.zeros(7), np.zeros(7), np.array([0.4, 0.0, 0.3]),
        np.array([0.0, 1.0, 0.0, 0.0]), 0.05, {}, {},
    )  # fmt: skip


# ------------------------------------------------------------------------------------------- what an answer states


def only_pairs(pairs):
    found = {}
    for key, value in pairs:
        name = key.decode("latin-1") if isinstance(key, bytes) else key
        if name in found:
            raise UnstatedError("a key stands twice")
        found[name] = value
    return found


def plain(data, kind, shape):
    dtype = np.dtype(kind)
    if dtype.kind not in "biuf":
        raise UnstatedError("no numbers")
    return np.frombuffer(data, dtype).reshape(shape)


def openpi_array(pairs):
    form = only_pairs(pairs)
    return plain(form["data"], form["dtype"], form["shape"]) if "__ndarray__" in form else form


def gr00t_array(pairs):
    form = only_pairs(pairs)
    if "__ndarray_class__" in form:
        return np.load(io.BytesIO(form["as_npy"]), allow_pickle=False)
    return plain(form["data"], form["type"], form["shape"]) if "nd" in form else form


def json_array(pairs):
    form = only_pairs(pairs)
    return plain(base64.b64decode(form["__numpy__"]), form["dtype"], form["shape"]) if "__numpy__" in form else form


def numbers(thing):
    """Returns the numbers of an array, or of lists of numbers and nothing else, as float64."""

    def check(item):
        if isinstance(item, list):
            for inner in item:
                check(inner)
        elif isinstance(item, np.ndarray):
            if item.dtype.kind not in "iuf":
                raise UnstatedError("no numbers")
        elif isinstance(item, bool) or not isinstance(item, int | float):
            raise UnstatedError("no number")

    check(thing)
    with np.errstate(invalid="ignore"):
        return np.asarray(thing, np.float64)


# --------------------------------------------------------------------------------------------------------- servers


class Talking:
    """A server of websockets: a greeting, then to each frame what a function returns."""

    def __init__(self, answer, greeting=None):
        self.answer, self.greeting = answer, greeting

    def __enter__(self):
        def talk(link):
            with contextlib.suppress(ConnectionClosed, OSError):
                if self.greeting is not None:
                    link.send(self.greeting)
                for frame in link:
                    given = self.answer(frame)
                    if given is not None:
                        link.send(given)

        self._server = serve(talk, "127.0.0.1", 0, compression=None, max_size=None, close_timeout=0.1)
        self.port = self._server.socket.getsockname()[1]
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._server.shutdown()
        self._thread.join()


class Endpoints:
    """A server over ZeroMQ."""

    def __init__(self, answer):
        self.answer = answer

    def __enter__(self):
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self.port = self._socket.bind_to_random_port("tcp://127.0.0.1")
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        return self

    def _serve(self):
        while not self._over.is_set():
            if self._socket.poll(20):
                *route, frame = self._socket.recv_multipart()
                self._socket.send_multipart([*route, self.answer(frame)])

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()
        self._socket.close()
        self._context.term()


class Posts:
    """A server of ``POST /act``."""

    def __init__(self, answer):
        self.answer = answer

    def __enter__(self):
        self._listening = socket.create_server(("127.0.0.1", 0), backlog=64)
        self.port = self._listening.getsockname()[1]
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        return self

    def _serve(self):
        with contextlib.suppress(OSError):
            while True:
                link = self._listening.accept()[0]
                with link, contextlib.suppress(OSError):
                    self._talk(link)

    def _talk(self, link):
        data = b""
        while True:
            while b"\r\n\r\n" not in data:
                got = link.recv(1 << 16)
                if not got:
                    return
                data += got
            head, _, data = data.partition(b"\r\n\r\n")
            length = int(head.lower().partition(b"content-length: ")[2].split(b"\r\n")[0])
            while len(data) < length:
                data += link.recv(1 << 16)
            data = data[length:]
            body = self.answer(b"")
            link.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\n\r\n" % len(body) + body)

    def __exit__(self, *_):
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        self._thread.join()


# ------------------------------------------------------------------------------------------------- without a socket


class DirectFrames:
    """Takes the place of a websocket: each frame is answered at once, by the function of a server."""

    def __init__(self, server):
        self.server, self.waiting = server, [] if server.greeting is None else [server.greeting]

    def send(self, message, _):
        given = self.server.answer(message)
        self.waiting += [] if given is None else [given]

    def receive(self, _):
        if not self.waiting:
            raise TimeoutError("no answer in time")
        return self.waiting.pop(0)

    def refuse_unasked(self):
        assert not self.waiting

    def mark_end_of_answer(self):
        pass

    def close(self):
        pass

    greeting = WebSocket.greeting


class DirectAnswers:
    """Takes the place of a socket of ZeroMQ, and of a server of ``POST /act``."""

    def __init__(self, server):
        self.server = server

    def ask(self, frame, _):
        return self.server.answer(frame)

    def post(self, body, _, **__):
        return HttpAnswer(200, self.server.answer(body))

    def close(self):
        pass


@pytest.fixture
def directly(monkeypatch):
    """Lets clients talk to a server without a socket, from the call on."""

    def patch(server):
        for module in (openpi, starvla, vla_eval):
            monkeypatch.setattr(module, "WebSocket", lambda *_, **__: DirectFrames(server))
        for module, name in ((endpoint_server, "RequestClient"), (http_act, "HttpServer")):
            monkeypatch.setattr(module, name, lambda *_, **__: DirectAnswers(server))

    return patch


# -------------------------------------------------------------------------------------------------------- attack


def map_with_key_twice(form, draw):
    """Returns msgpack of a map in which one key stands twice, with two values."""
    keys = list(form)
    key = keys[draw.integers(len(keys))]
    items = [*form.items(), (key, nudged(form[key], draw))]
    packer = msgpack.Packer()
    return packer.pack_map_header(len(items)) + b"".join(packer.pack(k) + packer.pack(v) for k, v in items)


def mutated_msgpack(form, draw):
    kind = draw.uniform()
    try:
        if kind < 0.1 and isinstance(form, dict):
            return map_with_key_twice(form, draw)
        return msgpack.packb(mutated_form(form, draw)) if kind < 0.6 else mutated_bytes(msgpack.packb(form), draw)
    except (ValueError, TypeError, OverflowError, RecursionError):  # what msgpack cannot say
        return mutated_bytes(msgpack.packb(form), draw)


def mutated_body(form, draw):
    return (
        json.dumps(mutated_form(form, draw)).encode()
        if draw.uniform() < 0.6
        else mutated_bytes(json.dumps(form).encode(), draw)
    )


class Attack:
    """Asks a client again and again; the server mutates each answer, and notes what it states."""

    def __init__(self, seed):
        self.seed, self.number, self.sent, self.wrong, self.refused = seed, 0, None, [], 0

    def draw(self):
        return np.random.default_rng([self.seed, self.number])

    def run(self, server, address, stated, directly):
        """``stated(client, sent)`` returns the actions that an answer states, or raises whatever it likes."""
        self._ask(address, stated, OVER_SOCKETS)
        directly(server)
        return self._ask(address, stated, COUNT)

    def _ask(self, address, stated, count):
        client, self.refused = None, 0
        for self.number in range(count):
            self.sent, began = None, time.monotonic()
            try:
                if client is None:
                    client = make_policy(address)
                    client.reset(START)
                told = client.act(seen())
            except BetterError as problem:
                self.refused += 1
                text = str(problem)
                if "\n" in text.strip() or not text.strip() or len(text) > 1200:
                    self.wrong.append((self.number, "lines", text[:300]))
            except Exception as problem:  # noqa: BLE001 - what is counted here
                self.wrong.append((self.number, type(problem).__name__, str(problem)[:300]))
                client = None
            else:
                self._compare(client, told, stated)
            if time.monotonic() - began > LONGEST_S:
                self.wrong.append((self.number, "slow", f"{time.monotonic() - began:.1f} s"))
        if client is not None:
            client.close()
        assert count > self.refused > count // 4, self.refused
        return self.wrong

    def _compare(self, client, told, stated):
        try:
            wanted = stated(client, self.sent)
        except Exception as problem:  # noqa: BLE001 - it states no actions
            self.wrong.append((self.number, "unstated", repr(problem)[:200]))
            return
        if told.shape != wanted.shape or not np.array_equal(told, wanted, equal_nan=True):
            self.wrong.append((self.number, "other numbers", f"{told.shape} {wanted.shape}"))


def marked(values, dtype="<f4"):
    values = np.asarray(values, dtype)
    return {b"__ndarray__": True, b"data": values.tobytes(), b"dtype": values.dtype.str, b"shape": list(values.shape)}


@pytest.mark.parametrize("preset", ["native", "openpi_libero", "being_h_libero"])
def test_mutated_answers_of_openpi_and_of_the_bridge(preset, directly):
    attack = Attack(31)
    columns = {"native": {"actions": ACTIONS}, "openpi_libero": {"actions": ACTIONS}}.get(preset)
    if columns is None:
        names = ("action.eef_position", "action.eef_rotation", "action.gripper_position")
        columns = dict(zip(names, (ACTIONS[:, :3], ACTIONS[:, 3:6], ACTIONS[:, 6:]), strict=True))
    form = {**{name: marked(values) for name, values in columns.items()}, "server_timing": {"infer_ms": 3.5}}

    def answer(_):
        attack.sent = mutated_msgpack(form, attack.draw())
        return attack.sent

    def stated(client, sent):
        reply = msgpack.unpackb(sent, object_pairs_hook=openpi_array, strict_map_key=False)
        return client.adapter.actions({k: numbers(v) if k in columns else v for k, v in reply.items()}, seen())

    with Talking(answer, msgpack.packb({})) as server:
        address = f"openpi://127.0.0.1:{server.port}?preset={preset}&{OPTIONS}"
        assert attack.run(server, address, stated, directly) == []


def test_mutated_answers_of_starvla(directly):
    attack = Attack(32)

    def answer(frame):
        identifier = msgpack.unpackb(frame)["request_id"]
        data = {"actions": marked(ACTIONS[None])}
        form = {"status": "ok", "ok": True, "type": "inference_result", "request_id": identifier, "data": data}
        attack.sent = mutated_msgpack(form, attack.draw())
        return attack.sent

    def stated(client, sent):
        reply = msgpack.unpackb(sent, object_pairs_hook=openpi_array, strict_map_key=False)
        if reply["status"] != "ok":
            raise UnstatedError
        return client.adapter.actions({"actions": numbers(reply["data"]["actions"])[0]}, seen())

    with Talking(answer, msgpack.packb({"action_chunk_size": 8})) as server:
        assert attack.run(server, f"starvla://127.0.0.1:{server.port}?{OPTIONS}", stated, directly) == []


def test_mutated_answers_of_vla_eval(directly):
    attack = Attack(33)

    def answer(frame):
        asked = msgpack.unpackb(frame)
        told = {"seq": asked["seq"], "timestamp": 1.5}
        if asked["type"] == "hello":
            return msgpack.packb({"type": "hello", "payload": {"protocol_version": 1}, **told})
        if asked["type"] != "observation":
            return None
        array = {"__ndarray__": True, "data": ACTIONS.tobytes(), "dtype": "<f4", "shape": list(ACTIONS.shape)}
        attack.sent = mutated_msgpack({"type": "action", "payload": {"actions": array}, **told}, attack.draw())
        return attack.sent

    def stated(client, sent):
        reply = msgpack.unpackb(sent, object_pairs_hook=openpi_array, strict_map_key=False)
        return client.adapter.actions({"actions": numbers(reply["payload"]["actions"])}, seen())

    with Talking(answer) as server:
        assert attack.run(server, f"vla-eval://127.0.0.1:{server.port}?{OPTIONS}", stated, directly) == []


def npy(values):
    file = io.BytesIO()
    np.save(file, values, allow_pickle=False)
    return {"__ndarray_class__": True, "as_npy": file.getvalue()}


def kinds_of_numpy(values):
    return {
        b"nd": True,
        b"type": values.dtype.str,
        b"kind": b"",
        b"shape": list(values.shape),
        b"data": values.tobytes(),
    }


def modality(keys, steps=(0,)):
    return {
        "__ModalityConfig_class__": True,
        "as_json": {"delta_indices": list(steps), "modality_keys": list(keys)},
    }


@pytest.mark.parametrize("coded", [npy, kinds_of_numpy])
def test_mutated_answers_of_gr00t(coded, directly):
    attack = Attack(34)
    columns = {"ee_position": ACTIONS[:, :3], "ee_rotation": ACTIONS[:, 3:6], "gripper": ACTIONS[:, 6:]}
    modalities = {
        "video": modality(["front", "wrist"]),
        "state": modality(columns),
        "action": modality(columns, range(8)),
        "language": modality(["annotation.human.action.task_description"]),
    }
    form = [{name: coded(np.ascontiguousarray(values[None])) for name, values in columns.items()}, {}]

    def answer(frame):
        endpoint = msgpack.unpackb(frame)["endpoint"]
        if endpoint == "ping":
            return msgpack.packb({"status": "ok", "message": "Server is running"})
        if endpoint == "get_modality_config":
            return msgpack.packb(modalities)
        attack.sent = mutated_msgpack(form, attack.draw())
        return attack.sent

    def stated(client, sent):
        reply = msgpack.unpackb(sent, object_pairs_hook=gr00t_array, strict_map_key=False)
        actions = reply[0] if isinstance(reply, list) else reply
        chunks = {}
        for name, array in actions.items():
            if name.removeprefix("action.") in columns:
                if name.removeprefix("action.") in chunks:
                    raise UnstatedError("twice")
                whole = numbers(array)
                if whole.ndim == 2 and name.endswith("gripper") and whole.shape[1] != 1:
                    whole = whole[:, :, None]  # N1.5 leaves out the axis of a single number
                chunks[name.removeprefix("action.")] = whole[0] if whole.ndim == 3 else whole
        told = {}
        for key in client.adapter.answer.columns:
            told[key[0]] = chunks.get(key[-1]) if len(key) == 1 else {**told.get(key[0], {}), key[1]: chunks[key[-1]]}
        return client.adapter.actions(told, seen())

    with Endpoints(answer) as server:
        assert attack.run(server, f"gr00t://127.0.0.1:{server.port}?{OPTIONS}", stated, directly) == []


@pytest.mark.parametrize("coded", ["array", "list", "map"])
def test_mutated_answers_of_post_act(coded, directly):
    attack = Attack(35)
    first = ACTIONS[0].astype(np.float64)
    array = {"__numpy__": base64.b64encode(first.tobytes()).decode(), "dtype": "<f8", "shape": [7]}
    form = {"array": array, "list": ACTIONS.astype(np.float64).tolist(), "map": [array, array]}[coded]

    def answer(_):
        attack.sent = mutated_body(form, attack.draw())
        return attack.sent

    def stated(client, sent):
        reply = json.loads(sent, object_pairs_hook=json_array)
        if isinstance(reply, str):
            reply = json.loads(reply, object_pairs_hook=json_array)
        name = next(iter(client.adapter.answer.columns))[0]
        return client.adapter.actions({name: numbers(reply[name] if isinstance(reply, dict) else reply)}, seen())

    with Posts(answer) as server:
        preset = "openvla" if coded == "array" else "openvla_oft"
        assert (
            attack.run(server, f"http://127.0.0.1:{server.port}/act?preset={preset}&{OPTIONS}", stated, directly) == []
        )


def test_mutated_greetings():
    """What a server says before it is asked: a client or one line, and never a hang."""
    declared = {
        "betterbench": {"action_space": "ee_delta", "needs_images": True, "control_rate_hz": 20.0},
        "n": [1, {}],
    }
    hello = {"protocol_version": 1, "action_spec": {"position": {"format": "delta_xyz", "dims": 3}}, "capabilities": {}}
    wrong = []
    for scheme, form in (("openpi", declared), ("starvla", {"action_chunk_size": 8}), ("vla-eval", hello)):
        told = [b""]

        def answer(frame, told=told):
            asked = msgpack.unpackb(frame)
            message = {"type": "hello", "payload": told[0], "seq": asked["seq"], "timestamp": 1.5}
            try:
                return msgpack.packb(message)
            except (ValueError, OverflowError, RecursionError):
                return b"\xc1"

        with Talking(answer) as server:
            for number in range(GREETINGS):
                draw = np.random.default_rng([36, number])
                if scheme == "vla-eval":
                    told[0] = mutated_form(form, draw)
                else:
                    server.greeting = mutated_msgpack(form, draw)
                began = time.monotonic()
                try:
                    make_policy(f"{scheme}://127.0.0.1:{server.port}?{OPTIONS}").close()
                except BetterError as problem:
                    if "\n" in str(problem).strip():
                        wrong.append((scheme, number, "lines", str(problem)[:300]))
                except Exception as problem:  # noqa: BLE001 - what is counted here
                    wrong.append((scheme, number, type(problem).__name__, str(problem)[:300]))
                if time.monotonic() - began > LONGEST_S:
                    wrong.append((scheme, number, "slow"))
    assert wrong == []
