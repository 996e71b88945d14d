"""Dexbotic's server, by a stand-in written from the protocol's facts: ``/v1/infer`` and ``/process_frame``."""

from __future__ import annotations

import base64
import contextlib
import email.parser
import email.policy
import io
import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from PIL import Image

from betterbench.errors import HandshakeError, InvalidInputError, PolicyError
from betterbench.interface import EpisodeStart, Observation
from betterbench.policies.conventions.adapter import Adapter, InstructionRule
from betterbench.policies.conventions.presets import PRESETS
from betterbench.policies.conventions.request import read_layout_request
from betterbench.policies.kinds import make_policy

CHUNK = [[0.25, 0, 0, 0, 0, 0, 1.0], [0, 0.5, 0, 0, 0, 0, -1.0]]
START = EpisodeStart("pack the apple", 7, "ee_delta")
CAPABILITIES = {
    "model_family": "Pi0InferenceConfig",
    "vla": True,
    "modalities": {
        "images": {
            "slots": [
                {"slot": 1, "name": "front", "required": True},
                {"slot": 2, "name": "left_wrist", "required": True},
                {"slot": 3, "name": None, "required": False},
            ]
        },
        "state": {"used": True, "required": True, "dim": 8},
    },
    "action_spec": {"action_dim": 7, "chunk_size": None, "action_mode": "absolute"},
}


class Server:
    """Both APIs of Dexbotic with an answer that is always the same; what it is sent is kept by path."""

    def __init__(self, *, capabilities=CAPABILITIES, answer=CHUNK, status=200, v1=True):
        self.capabilities, self.answer, self.status, self.v1 = capabilities, answer, status, v1
        self.seen = []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                self._say(outer.v1 and outer.capabilities is not None, outer.capabilities)

            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"]))
                outer.seen.append((self.path, self.headers["Content-Type"], body))
                if self.path.endswith("/v1/reset"):
                    self._say(outer.v1, {"status": "ok"})
                elif outer.status != 200:
                    self._say(found=True, form={"error": "observation must contain state"}, status=outer.status)
                elif self.path.endswith("/v1/infer"):
                    self._say(outer.v1, {"actions": outer.answer, "metadata": {"latency_ms": 58.2}})
                else:
                    self._say(self.path.endswith("/process_frame"), {"response": outer.answer})

            def _say(self, found, form, status=200):
                data = json.dumps(form if found else {}).encode()
                self.send_response(status if found else 404)
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def log_message(self, *_):
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,))

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(10)

    def client(self, path="/v1/infer", query="preset=dexbotic"):
        port = self._server.server_address[1]
        made = make_policy(f"http://127.0.0.1:{port}{path}?{query}&timeout=5&patience=2&retries=0")
        made.reset(START)
        return contextlib.closing(made)

    def asked(self, path):
        return [(kind, body) for where, kind, body in self.seen if where.endswith(path)]


def seen():
    images = {"front": np.full((256, 256, 3), 7, np.uint8), "wrist": np.full((256, 256, 3), 9, np.uint8)}
    images["front"][:128, :, 0] = 200
    return Observation(
        instruction="pack the apple",
        step=0,
        images=images,
        joint_positions=np.zeros(7),
        joint_velocities=np.zeros(7),
        ee_position=np.array([0.4, 0.1, 0.3]),
        ee_quaternion=np.array([0.0, 1.0, 0.0, 0.0]),
        gripper_width=0.06,
        depth={},
        masks={},
    )


def pixels(data):
    return np.asarray(Image.open(io.BytesIO(data), formats=["PNG"]))


STATE = [0.4, 0.1, 0.3, np.pi, 0, 0, 0.03, -0.03]


def test_v1_gets_what_its_own_client_sends():
    with Server() as server, server.client() as policy:
        assert policy.act(seen()).tolist() == CHUNK
        assert "Pi0InferenceConfig" in policy.info.metadata["server: model_family"]
    assert len(server.asked("/v1/reset")) == 1
    ((kind, body),) = server.asked("/v1/infer")
    assert kind == "application/json"
    form = json.loads(body)
    assert set(form) == {"observation"}
    observation = form["observation"]
    assert set(observation) == {"prompt", "images", "state"}
    assert observation["prompt"] == "pack the apple"
    assert np.allclose(observation["state"], STATE, atol=1e-6)
    images = {slot: pixels(base64.b64decode(data, validate=True)) for slot, data in observation["images"].items()}
    assert set(images) == {"1", "2"}
    assert np.array_equal(images["1"], seen().images["front"])
    assert np.array_equal(images["2"], seen().images["wrist"])


def test_the_form_of_older_releases_holds_the_same():
    with Server(v1=False) as server, server.client("/process_frame") as policy:
        for episode in range(2):
            policy.reset(EpisodeStart("pack the apple", episode, "ee_delta"))
            for _ in range(2):
                assert policy.act(seen()).tolist() == CHUNK
    assert server.asked("/v1/reset") == []
    firsts = []
    for kind, body in server.asked("/process_frame"):
        message = email.parser.BytesParser(policy=email.policy.HTTP).parsebytes(
            b"Content-Type: " + kind.encode() + b"\r\n\r\n" + body
        )
        parts = [(p.get_param("name", header="content-disposition"), p) for p in message.iter_parts()]
        assert [name for name, _ in parts] == ["text", "episode_first_frame", "states", "image", "image"]
        fields = {name: part.get_payload(decode=True).decode() for name, part in parts if name != "image"}
        assert fields["text"] == "pack the apple"
        assert np.allclose(json.loads(fields["states"]), STATE, atol=1e-6)
        files = [part for name, part in parts if name == "image"]
        assert all(file.get_filename() for file in files)  # else Flask takes it for a field
        shown = [pixels(file.get_payload(decode=True)) for file in files]
        assert np.array_equal(shown[0], seen().images["front"])
        assert np.array_equal(shown[1], seen().images["wrist"])
        firsts.append(fields["episode_first_frame"])
    assert firsts == ["True", "False", "True", "False"]


@pytest.mark.parametrize("path", ["/v1/infer", "/process_frame"])
def test_cogact_gets_one_image_and_its_sentence(path):
    told = {**CAPABILITIES, "modalities": {"images": {"slots": CAPABILITIES["modalities"]["images"]["slots"][:1]}}}
    with Server(capabilities=told) as server, server.client(path, "preset=dexbotic_cogact") as policy:
        assert policy.act(seen()).tolist() == CHUNK
    ((_, body),) = server.asked(path)
    assert b"What action should the robot take to pack the apple?" in body
    assert b"state" not in body


@pytest.mark.parametrize("answer", [CHUNK[0], [CHUNK], CHUNK])
def test_one_action_and_a_chunk_with_a_batch_are_read(answer):
    with Server(answer=answer) as server, server.client("/process_frame") as policy:
        assert policy.act(seen())[0].tolist() == CHUNK[0]


@pytest.mark.parametrize(
    ("change", "query", "text"),
    [
        (
            {},
            "preset=dexbotic_cogact",
            r"needs slot 2 \(left_wrist\), the adapter sends slot 1; state: the model needs",
        ),
        ({"action_spec": {"action_dim": 14}}, "preset=dexbotic", "returns 14 numbers, the adapter reads 7"),
        ({"vla": False}, "preset=dexbotic", "generates text instead of actions"),
        ({}, "preset=openvla", "the adapter sends no image"),
    ],
)
def test_what_the_server_declares_is_compared(change, query, text):
    with Server(capabilities={**CAPABILITIES, **change}) as server, pytest.raises(HandshakeError, match=text) as caught:
        server.client(query=query)
    assert "Use another preset, or adapter=FILE" in str(caught.value)


@pytest.mark.parametrize(
    "odd", [{}, {"modalities": 1}, {"modalities": {"images": {"slots": [1, {"slot": {}}]}}}, {"action_spec": []}]
)
def test_odd_capabilities_declare_nothing(odd):
    with Server(capabilities=odd) as server, server.client() as policy:
        assert policy.act(seen()).tolist() == CHUNK


@pytest.mark.parametrize("odd", [[], "x", 3])
def test_capabilities_that_are_not_a_map_are_refused(odd):
    with (
        Server(capabilities=odd) as server,
        pytest.raises(HandshakeError, match="expected a map as the description of the server") as caught,
    ):
        server.client()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "path", "query", "error", "text"),
    [
        ({"status": 400}, "/v1/infer", "preset=dexbotic", PolicyError, "HTTP 400: observation must contain state"),
        (
            {"v1": False},
            "/v1/infer",
            "preset=dexbotic",
            HandshakeError,
            r"no POST /v1/infer .*releases .* /process_frame",
        ),
        ({}, "/process_frame", "preset=openvla", PolicyError, "/process_frame requires the layout of preset dexbotic"),
    ],
)
def test_faults_are_one_clear_line(options, path, query, error, text):
    with Server(**options) as server, server.client(path, query) as policy, pytest.raises(error, match=text):
        policy.act(seen())


def test_options_reach_the_server():
    with Server() as server:
        with server.client(query="preset=dexbotic&send.sampling/num_steps=10") as policy:
            policy.act(seen())
        with server.client("/process_frame", query="preset=dexbotic&send.seed=3") as policy:
            policy.act(seen())
    assert json.loads(server.asked("/v1/infer")[0][1])["sampling"] == {"num_steps": 10}
    assert b'name="seed"\r\n\r\n3\r\n' in server.asked("/process_frame")[0][1]


# ----------------------------------------------------------------------------------------------------- the instruction


def test_a_template_is_written_read_and_stored():
    adapter = PRESETS["dexbotic_cogact"]
    assert Adapter.from_json(adapter.to_json()) == adapter
    rule = adapter.instruction
    assert rule.read(rule.write("pack the {} apple?")) == "pack the {} apple?"
    assert rule.read("pack the apple") == "pack the apple"
    message = adapter.request(seen())
    assert read_layout_request(message, adapter).instruction == "pack the apple"
    for bad in ("", "say it", "{} and {}"):
        with pytest.raises(InvalidInputError, match=r"template.*Write \{\} once in the template"):
            InstructionRule(("prompt",), template=bad)
