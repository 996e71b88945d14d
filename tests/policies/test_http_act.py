"""The client of ``POST /act`` against an independent minimal server, written from the protocol's description."""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import json
import socket
import struct
import threading
import time

import numpy as np
import pytest

from betterbench.errors import HandshakeError, InvalidInputError, PolicyError, PolicyUnavailableError, UnknownNameError
from betterbench.evaluation import evaluate, make_plan
from betterbench.interface import EpisodeStart, Execution, Observation, observation_spec
from betterbench.policies.clients.http_act import HttpActClient
from betterbench.policies.kinds import make_policy, read_address
from betterbench.policies.protocols import json_wire
from betterbench.policies.protocols.json_wire import decode_body, encode_body

QUICK = "timeout=30&retries=1&patience=30"

# Bytes written down from the description: what OpenVLA answers (one action), what OFT answers (a chunk), the same as a
# JSON text, and what X-VLA answers.
ONE = (
    b'{"__numpy__":"AAAAAAAA0D8AAAAAAADgvwAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAANA/AAAAAAAA8D8=",'
    b'"dtype":"<f8","shape":[7]}'
)
TWO = (
    b'{"__numpy__":"AAAAAAAAAAAAAAAAAADgPwAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA=",'
    b'"dtype":"<f8","shape":[7]}'
)
CHUNK = b"[" + ONE + b"," + TWO + b"]"
CHUNK_VALUES = [[0.25, -0.5, 0, 0, 0, 0.25, 1], [0, 0.5, 0, 0, 0, 0, 0]]
PIXELS = '{"__numpy__": "AAECAwQFBgcICQoL", "dtype": "|u1", "shape": [2, 2, 3]}'
"""An image of 2 x 2 pixels with the values 0 to 11."""


def plain(status=200, body=ONE, **headers):
    """Return the bytes of an answer."""
    lines = [f"HTTP/1.1 {status} Word", f"Content-Length: {len(body)}", *(f"{k}: {v}" for k, v in headers.items())]
    return "\r\n".join([*lines, "", ""]).encode() + body


def arrays(thing):
    """Read the arrays of a body as json-numpy's description says."""
    if "__numpy__" in thing:
        return np.frombuffer(base64.b64decode(thing["__numpy__"]), thing["dtype"]).reshape(thing["shape"])
    return thing


class Server:
    """Answers each request with the bytes of a script, or with one action; knows no library of the web."""

    def __init__(self, script=(), *, port=0):
        self.script, self.heads, self.bodies = list(script), [], []
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(10)

    def address(self, options, path="/act"):
        return read_address(f"http://127.0.0.1:{self.port}{path}?{options}")

    def body(self, i=-1):
        return json.loads(self.bodies[i], object_hook=arrays)

    def _serve(self):
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            with connection, contextlib.suppress(OSError):
                self._talk(connection)

    def _talk(self, connection):
        data = b""
        while b"\r\n\r\n" not in data:
            got = connection.recv(65536)
            if not got:
                return  # somebody looked whether there is a server
            data += got
        head, _, body = data.partition(b"\r\n\r\n")
        fields = dict(line.split(": ", 1) for line in head.decode().split("\r\n")[1:])
        while len(body) < int(fields["Content-Length"]):
            body += connection.recv(65536)
        self.heads.append(head.decode())
        self.bodies.append(body)
        step = self.script.pop(0) if self.script else plain()
        if callable(step):
            step(connection)
        else:
            connection.sendall(step)


@pytest.fixture
def client():
    """Connect to a server and close whatever the test connected."""
    with contextlib.ExitStack() as stack:

        def connected(server, options=f"{QUICK}&preset=openvla", path="/act"):
            made = HttpActClient(server.address(options, path))
            stack.callback(made.close)
            return made

        yield connected


def seen(**changes):
    given = {
        "instruction": "pack the apple",
        "step": 0,
        "images": {n: np.full((256, 256, 3), i, np.uint8) for i, n in enumerate(("front", "wrist"))},
        "joint_positions": np.zeros(7),
        "joint_velocities": np.zeros(7),
        "ee_position": np.array([0.4, 0.0, 0.3]),
        "ee_quaternion": np.array([0.0, 1.0, 0.0, 0.0]),
        "gripper_width": 0.05,
        "depth": {},
        "masks": {},
    }
    return Observation(**{**given, **changes})


def small(tmp_path, name="openvla", **changes):
    """Return the options of an adapter that sends one image as it is."""
    form = {
        "views": [{"key": "image", "camera": "front"}],
        "states": [],
        "instruction": {"key": "instruction"},
        **changes,
    }
    file = tmp_path / f"{name}.json"
    file.write_text(json.dumps(form), encoding="utf-8")
    return f"{QUICK}&adapter={file}"


# -------------------------------------------------------------------------------------------------- golden bytes


def test_openvla_gets_these_bytes_and_answers_one_action(client, tmp_path):
    image = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    with Server() as server:
        actions = client(server, small(tmp_path)).act(seen(images={"front": image}, instruction="go"))
        body = f'{{"image": {PIXELS}, "instruction": "go"}}'
        assert server.bodies == [body.encode()]
        assert server.heads[0].split("\r\n") == [
            "POST /act HTTP/1.1",
            f"Host: 127.0.0.1:{server.port}",
            "Content-Type: application/json",
            "Accept: application/json",
            "Accept-Encoding: identity",
            "Connection: close",
            f"Content-Length: {len(body)}",
        ]
    assert actions.tolist() == [CHUNK_VALUES[0]]


def test_arrays_may_go_out_as_texts_and_the_body_as_one_text(client, tmp_path):
    image = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    with Server([plain(body=json.dumps(CHUNK.decode()).encode())] * 2) as server:
        for options in ("arrays=text", "encoded=true"):
            policy = client(server, f"{small(tmp_path)}&{options}")
            assert policy.act(seen(images={"front": image}, instruction="go")).tolist() == CHUNK_VALUES
    assert json.loads(server.bodies[0]) == {"image": PIXELS, "instruction": "go"}
    assert list(json.loads(server.bodies[1])) == ["encoded"]
    assert json.loads(json.loads(server.bodies[1])["encoded"]) == {"image": json.loads(PIXELS), "instruction": "go"}


# ------------------------------------------------------------------------------------------------------- presets


def test_openvla_counts_an_open_gripper_as_one(client):
    with Server([plain(body=ONE), plain(body=TWO)]) as server:
        policy = client(server, f"{QUICK}&preset=openvla&send.unnorm_key=bridge_orig")
        policy.reset(EpisodeStart("pack the apple", 1, "ee_delta"))
        assert [policy.act(seen())[0, 6] for _ in range(2)] == [-1.0, 1.0]
        body = server.body()
    assert set(body) == {"image", "instruction", "unnorm_key"}
    assert (body["image"].shape, body["image"].dtype) == ((224, 224, 3), np.uint8)
    assert (body["instruction"], body["unnorm_key"]) == ("pack the apple", "bridge_orig")


def test_oft_gets_two_images_and_the_state_and_answers_a_chunk(client):
    with Server([plain(body=CHUNK)]) as server:
        actions = client(server, f"{QUICK}&preset=openvla_oft&horizon=8").act(seen())
        body = server.body()
    assert set(body) == {"full_image", "wrist_image", "state", "instruction"}
    assert (body["full_image"][0, 0, 0], body["wrist_image"][0, 0, 0]) == (0, 1)
    assert np.allclose(body["state"], [0.4, 0, 0.3, np.pi, 0, 0, 0.025, -0.025])
    assert actions.tolist() == [[*CHUNK_VALUES[0][:6], -1.0], [*CHUNK_VALUES[1][:6], 1.0]]


def test_x_vla_answers_poses(client):
    pose = [0.4, 0.1, 0.3, 1, 0, 0, 0, -1, 0, 0.9, *[0.0] * 10]
    with Server([plain(body=json.dumps({"action": [pose, pose]}).encode())]) as server:
        policy = client(server, f"{QUICK}&preset=x_vla&send.domain_id=3")
        policy.reset(EpisodeStart("pack the apple", 1, "ee_pose"))
        actions = policy.act(seen())
        body = server.body()
    assert np.allclose(actions, [[0.4, 0.1, 0.3, 0, 1, 0, 0, 1.0]] * 2)
    assert (body["language_instruction"], body["domain_id"], body["steps"]) == ("pack the apple", 3, 10)
    image, proprio = (json.loads(body[key], object_hook=arrays) for key in ("image0", "proprio"))
    assert image.shape == (256, 256, 3)
    assert np.allclose(proprio, [0.4, 0, 0.3, 1, 0, 0, 0, -1, 0, *[0.0] * 11])


def test_no_layout_is_guessed():
    with pytest.raises(
        InvalidInputError, match=r"neither the address nor the server declares the images and state .*preset=NAME"
    ):
        make_policy("http://127.0.0.1:9/act")
    with pytest.raises(InvalidInputError, match=r"send\.domain_id=VALUE"):
        make_policy("http://127.0.0.1:9/act?preset=x_vla")
    with pytest.raises(UnknownNameError, match="arrays"):
        read_address("http://host/act?array=text")


def test_the_run_is_compared_before_it_starts(client):
    with Server() as server:
        policy = client(server, f"{QUICK}&preset=openvla_oft&horizon=8")
        assert policy.info.execution == Execution(horizon=8)
        assert policy.info.action_space == "ee_delta"
        policy.check(space="ee_delta", observation=observation_spec("default"), rate_hz=20.0)
        with pytest.raises(HandshakeError, match="front, wrist"):
            policy.check(space="ee_delta", observation=observation_spec("state_only"), rate_hz=20.0)
        assert server.bodies == []  # nobody was asked anything yet


@pytest.mark.slow
@pytest.mark.physics
def test_trials_are_evaluated(tmp_path):
    parts = [{"key": "actions", "kind": "action"}]
    options = small(tmp_path, "blind", views=[], answer={"parts": parts})
    with Server([plain(body=json.dumps([[0.01] * 7] * 16).encode())] * 1000) as server:
        plan = make_plan(
            str(server.address(options)),
            tasks=["morning_coffee"],
            variations=["T1"],
            trials=2,
            observation="state_only",
            quality="fast",
        )
        plan = dataclasses.replace(plan, trials=tuple(t for t in plan.trials if t.variation == "T1"))
        run = evaluate(plan, tmp_path / "run", envs=2)
    assert [(entry.status, entry.message) for entry in run.entries()] == [("done", None)] * 2
    for trial in plan.trials:
        assert np.allclose(run.read_record(trial.task, trial.condition, trial.seed).applied[1:], 0.01)


# -------------------------------------------------------------------------------------------------------- faults


@pytest.mark.parametrize(
    ("reply", "text"),
    [
        (b'"error"', "replies 'error', which servers of this kind return for any failure"),
        (b'{"error": "Request failed"}', "reports an error: Request failed"),
        (b"", "cannot be read"),
        (b"<html>", "cannot be read"),
        (b"\xff\xfe\x00", "cannot be read"),
        (ONE[:-20], "cannot be read"),
        (ONE.replace(b"<f8", b"|O"), "not a plain number"),
        (ONE.replace(b"[7]", b"[8]"), "56 bytes do not match"),
        (ONE.replace(b"[7]", b"[-1]"), "not a list of integers"),
        (ONE.replace(b"AAA", b"A*A"), "cannot be read"),
        (b'{"__numpy__": 3, "dtype": "<f8", "shape": [1]}', "expected array data as a base64 string, got int"),
        (b"[" * 100_000, "cannot be read"),
        (b"[" + b"1" * 400 + b"]", "not an array of real numbers"),
        (b"[" + b"1" * 5000 + b"]", "cannot be read"),
        (b"[]", "not an array of real numbers|has shape|empty"),
        (b"[1, 2, 3]", r"has shape \(3,\)"),
        (b"[[1, 2], [3]]", "not an array of real numbers"),
        (b"[true, false, true, true, true, true, true]", "not an array of real numbers"),
        (b"[" + ONE + b", 3]", "not an array of real numbers"),
        (b"null", "not an array of real numbers"),
        (b'{"actions": {}}', "not an array of real numbers"),
        (b'{"action": [1]}', "the reply has no 'actions'. It has: action"),
    ],
)
def test_bad_answers_end_the_trial_with_a_reason_and_the_next_one_is_asked(client, reply, text):
    with Server([plain(body=reply)]) as server:
        policy = client(server)
        with pytest.raises(PolicyError, match=text) as caught:
            policy.act(seen())
        assert not isinstance(caught.value, PolicyUnavailableError)
        assert str(caught.value).startswith(policy.server.who)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 800
        assert policy.act(seen()).shape == (1, 7)


def test_numbers_that_are_not_finite_arrive_as_such(client):
    with Server([plain(body=b"[NaN, 0, 0, 0, 0, 0, 1]"), plain(body=b"[1e999, 0, 0, 0, 0, 0, 1]")]) as server:
        policy = client(server)
        assert not np.isfinite(policy.act(seen())).all()
        assert not np.isfinite(policy.act(seen())).all()


@pytest.mark.parametrize(
    ("body", "text"),
    [
        (b"[0.5, true, 0, 0, 0, 0, 1]", "not an array of real numbers"),
        (b"[[0.5, 0, 0, 0, 0, 0, 1], [0.5, 0, 0, false, 0, 0, 1]]", "not an array of real numbers"),
        (b'{"action": [0, 0, 0, 0, 0, 0, 1], "action": [1, 0, 0, 0, 0, 0, 1]}', "action: is given twice"),
    ],
)
def test_a_truth_is_no_number_and_a_key_stands_once(client, body, text):
    with Server([plain(body=body)]) as server, pytest.raises(PolicyError, match=text):
        client(server).act(seen())


@pytest.mark.parametrize(
    ("status", "body", "error", "text"),
    [
        (400, b'{"error": "No valid images found."}', PolicyError, "HTTP 400: No valid images found."),
        (422, b'{"detail": [{"msg": "field required"}]}', PolicyError, "HTTP 422: .*field required"),
        (500, b"Internal\nServer Error", PolicyError, "HTTP 500: Internal Server Error"),
        (500, b"", PolicyError, "HTTP 500: no message"),
        (404, b"", HandshakeError, r"has no POST /act \(HTTP 404\). Correct the path"),
        (405, b"", HandshakeError, "has no POST /act"),
        (401, b"", HandshakeError, "api_key_env=NAME"),
        (307, b"", HandshakeError, r"another address \(HTTP 307, http://127\.0\.0\.1:9/act\)\. Use that address"),
        (
            504,
            b"",
            PolicyError,
            r"failed to answer 2 times. Last reason: the server answered HTTP 504\. See the server's",
        ),
    ],
)
def test_every_status_has_its_meaning(client, status, body, error, text):
    with Server([plain(status, body, Location="http://127.0.0.1:9/act")] * 2) as server:
        with pytest.raises(error, match=text) as caught:
            client(server).act(seen())
        assert "\n" not in str(caught.value)


def test_a_server_behind_a_proxy_that_is_not_ready_is_waited_for_like_one_that_is_away(client):
    with Server([plain(status, b"") for status in (502, 503, 503, 429)]) as server:
        policy = client(server, "retries=0&patience=30&preset=openvla")
        assert policy.act(seen()).shape == (1, 7)
        assert policy.figures["policy_retries"] == 4
    with Server([plain(503, b"")] * 100) as server:
        policy = client(server, "retries=0&patience=0.5&preset=openvla")
        with pytest.raises(
            PolicyUnavailableError, match=r"could not be reached for 0\.5 s .*HTTP 503.*patience=SECONDS"
        ):
            policy.act(seen())


def test_a_tunnel_to_a_server_that_is_down_is_not_taken_for_a_server():
    def close_all():
        with contextlib.suppress(OSError):
            while True:
                tunnel.accept()[0].close()

    with socket.create_server(("127.0.0.1", 0)) as tunnel:
        threading.Thread(target=close_all, daemon=True).start()
        address = read_address(f"http://127.0.0.1:{tunnel.getsockname()[1]}/act?patience=0.2&preset=openvla")
        with pytest.raises(PolicyUnavailableError, match="connections are closed without an answer"):
            HttpActClient(address)


def drip(connection):
    """Send a byte now and then, so that no single read ever waits long."""
    with contextlib.suppress(OSError):
        for byte in plain()[:-1]:
            connection.sendall(bytes([byte]))
            time.sleep(0.3)


def endless(connection):
    """Send a header without end."""
    with contextlib.suppress(OSError):
        connection.sendall(b"HTTP/1.1 200 OK\r\n")
        for _ in range(200):
            connection.sendall(b"X-More: " + b"x" * 1000 + b"\r\n")


@pytest.mark.parametrize(
    "step", [drip, lambda _: time.sleep(1.0), lambda c: c.sendall(plain()[:-3]), b"", b"SSH-2.0\r\n", endless]
)
def test_whatever_a_server_does_a_deadline_holds_and_the_next_try_counts(client, step):
    with Server([step]) as server:
        policy = client(server, "timeout=0.5&retries=20&patience=30&preset=openvla")
        began = time.monotonic()
        assert policy.act(seen()).shape == (1, 7)
        assert time.monotonic() - began < 30.0
        assert policy.figures["policy_retries"] >= 1


def test_chunked_answers_are_read(client):
    parts = b"".join(f"{len(p):x}\r\n".encode() + p + b"\r\n" for p in (ONE[:30], ONE[30:], b""))
    with Server([b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n" + parts]) as server:
        assert client(server).act(seen()).tolist()[0][:2] == [0.25, -0.5]


def test_an_answer_that_is_too_large_is_not_taken(client, monkeypatch):
    monkeypatch.setattr("betterbench.policies.clients.http_act.MAX_BODY_BYTES", 1000)
    with Server([plain(body=b" " * 2000)]) as server, pytest.raises(PolicyError, match="more than 1000 bytes"):
        client(server).act(seen())


def test_the_key_comes_from_the_environment_and_the_path_from_the_address(client, monkeypatch):
    monkeypatch.setenv("MY_KEY", "open-sesame")
    with Server() as server:
        policy = client(server, f"{QUICK}&preset=openvla&api_key_env=MY_KEY", path="/v1/predict")
        policy.act(seen())
        assert "open-sesame" not in str(policy.info)
    assert server.heads[0].startswith("POST /v1/predict HTTP/1.1\r\n")
    assert "Authorization: Bearer open-sesame" in server.heads[0]


def test_a_server_that_comes_back_is_asked_again(client):
    with Server() as server:
        policy = client(server, "timeout=30&retries=3&patience=30&preset=openvla")
        port = server.port
        policy.act(seen())
    with Server(port=port):
        assert policy.act(seen()).shape == (1, 7)


def test_a_server_that_is_never_there_is_one_clear_line():
    with pytest.raises(PolicyUnavailableError, match=r"http://127.0.0.1:9/act could not be reached for 0.2 s"):
        HttpActClient(read_address("http://127.0.0.1:9/act?patience=0.2&preset=openvla"))


def test_an_unencrypted_server_is_not_spoken_to_where_encryption_was_asked_for():
    with Server() as server:
        address = read_address(f"https://127.0.0.1:{server.port}/act?timeout=0.3&retries=1&preset=openvla")
        with pytest.raises(PolicyError, match="failed to answer 2 times"):
            HttpActClient(address).act(seen())
        assert server.bodies == []


def test_any_bytes_give_a_value_or_one_clear_error():
    draw = np.random.default_rng(5)
    bodies = [ONE, CHUNK, json.dumps(CHUNK.decode()).encode(), b'{"action": [[1, -2.5e3, null, true]], "error": "x"}']
    for i in range(2000):
        data = bytearray(bodies[i % len(bodies)])
        for _ in range(int(draw.integers(1, 5))):
            at = int(draw.integers(0, len(data)))
            if draw.random() < 0.5:
                data[at] = int(draw.integers(0, 256))
            else:
                data[at : at + int(draw.integers(0, 9))] = draw.bytes(int(draw.integers(0, 4)))
        text = ""
        try:
            decode_body(bytes(data))
        except PolicyError as problem:
            text = str(problem)
        assert "\n" not in text
        assert len(text) < 400


def test_what_has_no_form_in_json_is_not_sent():
    for thing in ({"x": object()}, {"x": np.array(["a"])}, {"x": float("nan")}):
        with pytest.raises(InvalidInputError, match="cannot be sent"):
            encode_body(thing)
    assert json.loads(encode_body({"x": np.float32(0.5), "y": np.int64(3)})) == {"x": 0.5, "y": 3}


def test_the_size_of_a_body_is_bounded():
    with pytest.raises(PolicyError, match="larger than"):
        decode_body(b" " * (json_wire.MAX_BODY_BYTES + 1))
    assert struct.unpack("<7d", base64.b64decode(json.loads(ONE)["__numpy__"])) == tuple(CHUNK_VALUES[0])
