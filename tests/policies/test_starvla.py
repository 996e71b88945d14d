"""The client of starVLA's websocket against an independent minimal server, written from the protocol's description."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from dataclasses import replace

import msgpack
import numpy as np
import pytest
from websockets.asyncio.server import serve

from betterbench.errors import HandshakeError, InvalidInputError, PolicyError, PolicyUnavailableError, UnknownNameError
from betterbench.evaluation import evaluate, make_plan
from betterbench.interface import BatchPolicy, EpisodeStart, Execution, Observation, observation_spec
from betterbench.policies.clients.starvla import StarVlaClient
from betterbench.policies.kinds import make_policy, read_address

START = EpisodeStart("pack the apple", 3, "ee_delta")
QUICK = "timeout=30&retries=1&patience=30"

# Frames written down from the description, not by our encoder: {"action_chunk_size": 2}, which the server says first; a
# request with an image of 2 x 2 pixels; and the answer to it, a chunk of two actions in float32.
METADATA = bytes.fromhex("81b1616374696f6e5f6368756e6b5f73697a6502")
REQUEST = bytes.fromhex(
    "83a474797065a5696e666572aa726571756573745f6964ad62657474657262656e63682d31a77061796c6f616481a865"
    "78616d706c65739182a5696d6167659184c40b5f5f6e6461727261795f5fc3c40464617461c40c000102030405060708"
    "090a0bc4056474797065a37c7531c405736861706593020203a46c616e67a2676f"
)
REPLY = bytes.fromhex(
    "85a6737461747573a26f6ba26f6bc3a474797065b0696e666572656e63655f726573756c74aa726571756573745f6964"
    "ad62657474657262656e63682d31a46461746181a7616374696f6e7384c40b5f5f6e6461727261795f5fc3c404646174"
    "61c4380000803e000000bf0000000000000000000000000000803e0000803f000000000000003f000000000000000000"
    "00000000000000000080bfc4056474797065a33c6634c405736861706593010207"
)


def array(values, dtype="<f4"):
    """Return an array as the protocol codes it."""
    values = np.asarray(values, dtype)
    return {b"__ndarray__": True, b"data": values.tobytes(), b"dtype": values.dtype.str, b"shape": list(values.shape)}


def decoded(thing):
    if b"__ndarray__" in thing:
        return np.frombuffer(thing[b"data"], thing[b"dtype"]).reshape(thing[b"shape"])
    return thing


def answer(request, **data):
    """Return what a server answers to a request, with actions that tell how many examples were asked about."""
    count = len(request.get("payload", request)["examples"])
    data = data or {"actions": array(np.full((count, 8, 7), 0.25))}
    told = {
        "status": "ok",
        "ok": True,
        "type": "inference_result",
        "request_id": request.get("request_id"),
        "data": data,
    }
    return msgpack.packb(told)


def refusal(request, message="boom"):
    told = {"status": "error", "ok": False, "type": "inference_result", "request_id": request.get("request_id")}
    return msgpack.packb({**told, "error": {"message": message}})


class Server:
    """Says its metadata, then answers each request by a script: bytes, a text, a list of frames or a function."""

    def __init__(self, script=(), *, metadata=METADATA, key=None, port=0):
        self.script, self.metadata, self.key, self.port = list(script), metadata, key, port
        self.raw, self.requests = [], []
        self._loop, self._ready = asyncio.new_event_loop(), threading.Event()
        self._thread = threading.Thread(target=lambda: self._loop.run_until_complete(self._main()))

    def __enter__(self):
        self._thread.start()
        assert self._ready.wait(10)
        return self

    def __exit__(self, *_):
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(10)
        self._loop.close()

    def address(self, options=QUICK):
        return read_address(f"starvla://127.0.0.1:{self.port}?{options}")

    async def _main(self):
        self._stop = asyncio.Event()
        options = {"compression": None, "max_size": None, "process_request": self._admit, "close_timeout": 0.2}
        async with serve(self._talk, "127.0.0.1", self.port, **options) as server:
            self.port = server.sockets[0].getsockname()[1]
            self._ready.set()
            await self._stop.wait()

    def _admit(self, connection, request):
        given = request.headers.get("Authorization")
        return connection.respond(401, "no") if self.key is not None and given != f"Api-Key {self.key}" else None

    async def _talk(self, connection):
        with contextlib.suppress(Exception):
            await connection.send(self.metadata)
            async for frame in connection:
                self.raw.append(frame)
                self.requests.append(msgpack.unpackb(frame, object_hook=decoded))
                step = self.script.pop(0) if self.script else answer
                step = step(self.requests[-1]) if callable(step) else step
                for part in step if isinstance(step, list) else [step]:
                    await connection.send(part)
                    if isinstance(part, str):
                        await connection.close(1011, "Internal server error.")


@pytest.fixture
def client():
    """Connect to a server and close whatever the test connected."""
    with contextlib.ExitStack() as stack:

        def connected(server, options=QUICK):
            made = StarVlaClient(server.address(options))
            stack.callback(made.close)
            return made

        yield connected


def seen(step=0, **changes):
    given = {
        "instruction": "pack the apple",
        "step": step,
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


def test_a_request_and_its_answer_are_these_bytes(client):
    with Server([REPLY]) as server:
        policy = client(server)
        # One image as it is rendered, so that the bytes can be written down.
        view = replace(policy.adapter.views[0], width=None, height=None)
        policy.adapter = replace(policy.adapter, views=(view,))
        image = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
        actions = policy.act(seen(images={"front": image}, instruction="go"))
    assert server.raw == [REQUEST]
    assert actions.tolist() == [[0.25, -0.5, 0, 0, 0, 0.25, 1], [0, 0.5, 0, 0, 0, 0, -1]]


def test_images_go_out_as_a_list_front_first_and_without_a_state(client):
    with Server() as server:
        policy = client(server)
        policy.reset(START)
        assert policy.act(seen()).shape == (8, 7)
        request = server.requests[0]
    assert (request["type"], set(request)) == ("infer", {"type", "request_id", "payload"})
    (example,) = request["payload"]["examples"]
    assert set(example) == {"image", "lang"}
    assert [(i.shape, i.dtype, i[0, 0, 0]) for i in example["image"]] == [((224, 224, 3), np.uint8, k) for k in (0, 1)]
    assert example["lang"] == "pack the apple"


def test_a_state_is_sent_where_it_is_asked_for(client):
    with Server() as server:
        client(server, f"{QUICK}&preset=starvla_state").act(seen())
        (example,) = server.requests[0]["payload"]["examples"]
    assert example["state"].shape == (1, 8)
    assert np.allclose(example["state"][0], [0.4, 0, 0.3, np.pi, 0, 0, 0.025, -0.025])


def test_many_environments_are_one_batch(client):
    def each(request):
        words = [example["lang"] for example in request["payload"]["examples"]]
        return answer(request, actions=array([[[len(word)] * 7] for word in words]))

    with Server([each]) as server:
        policy = client(server)
        assert isinstance(policy, BatchPolicy)
        actions = policy.act_batch([seen(instruction=word) for word in ("a", "bcd", "ef")])
    assert [a.tolist() for a in actions] == [[[n] * 7] for n in (1, 3, 2)]
    assert len(server.requests) == 1


def test_an_older_server_takes_the_examples_beside_the_type(client):
    def old(request):
        missing = "predict_action() missing 1 required positional argument: 'examples'"
        return answer(request) if "examples" in request else refusal(request, missing)

    with Server([old, old]) as server:
        with pytest.raises(PolicyError, match=r"argument: 'examples' Older servers need layout=flat"):
            client(server).act(seen())
        assert client(server, f"{QUICK}&layout=flat").act(seen()).shape == (8, 7)
        assert set(server.requests[1]) == {"type", "request_id", "examples"}


def test_constants_stand_beside_the_examples(client):
    with Server() as server:
        client(server, f"{QUICK}&send.unnorm_key=franka&send.use_ddim=true").act(seen())
        payload = server.requests[0]["payload"]
    assert (payload["unnorm_key"], payload["use_ddim"]) == ("franka", True)
    assert set(payload["examples"][0]) == {"image", "lang"}


def test_what_the_server_declares_is_stored_and_what_it_does_not_is_told(client):
    with Server() as server:
        info = client(server, f"{QUICK}&horizon=2").info
        named = client(server, f"{QUICK}&preset=starvla").info
    assert info.metadata["server: action_chunk_size"] == "2"
    assert "does not declare its action conventions" in info.metadata["assumed"]
    assert "assumed" not in named.metadata
    assert info.execution == Execution(horizon=2)


def test_the_run_is_compared_before_it_starts(client):
    with Server() as server:
        policy = client(server)
        policy.check(space="ee_delta", observation=observation_spec("default"), rate_hz=20.0)
        with pytest.raises(HandshakeError, match="front, wrist"):
            policy.check(space="ee_delta", observation=observation_spec("state_only"), rate_hz=20.0)
        with pytest.raises(HandshakeError, match="ee_pose"):
            policy.reset(EpisodeStart("pack", 1, "ee_pose"))


@pytest.mark.parametrize(
    ("step", "text"),
    [
        (refusal, "reports an error: boom"),
        (lambda r: refusal(r, None), "reports an error: no message"),
        ("Traceback:\n  File x\nKeyError: 'image'", "reports an error: KeyError: 'image'"),
        ("", "reports an error: no message"),
        (lambda r: answer({**r, "request_id": "somebody-else"}), "answered request betterbench-1 with 'somebody-else'"),
        (lambda r: answer(r, normalized_actions=array(np.zeros((1, 8, 7)))), "returns normalized actions"),
        (lambda r: answer(r, action=array(np.zeros((1, 8, 7)))), "the reply has no 'actions'. It has: action"),
        (
            lambda r: answer(r, actions=array(np.zeros((8, 7)))),
            r"'actions' has shape \(8, 7\). Send \(1, chunk, action\)",
        ),
        (lambda r: answer(r, actions=array(np.zeros((2, 8, 7)))), r"'actions' has shape \(2, 8, 7\)"),
        (lambda r: answer(r, actions=array(np.zeros((1, 8, 6)))), r"has shape \(8, 6\)"),
        (lambda r: answer(r, actions=array(np.zeros((1, 0, 7)))), "empty chunk"),
        (lambda r: answer(r, actions=[[[1, 2], [3]]]), "'actions' has shape"),
        (lambda r: answer(r, actions="none"), "'actions' has shape"),
        (lambda r: answer(r, actions=array([[["a"] * 7]], "<U1")), "not an array of real numbers"),
        (lambda r: msgpack.packb({"status": "ok", "request_id": r["request_id"]}), "reports an error: no message"),
        (lambda r: refusal(r, array(np.ones(2))), r"reports an error: \[1. 1.\]"),
        (
            lambda r: msgpack.packb({"status": array(np.ones(2)), "request_id": r["request_id"], "data": {}}),
            "reports an error: no message",
        ),
        (lambda r: answer({**r, "request_id": array(np.ones(2))}), r"answered request betterbench-1 with '\[1. 1.\]'"),
        (lambda _: msgpack.packb([1]), "expected a map, got list"),
        (lambda _: b"\xc1", "cannot be read"),
    ],
)
def test_bad_answers_end_the_trial_with_a_reason_and_the_next_one_is_asked(client, step, text):
    with Server([step]) as server:
        policy = client(server)
        with pytest.raises(PolicyError, match=text) as caught:
            policy.act(seen())
        assert not isinstance(caught.value, PolicyUnavailableError)
        assert str(caught.value).startswith(policy.server.who)
        assert "\n" not in str(caught.value)
        assert policy.act(seen()).shape == (8, 7)


def test_an_answer_that_is_sent_twice_is_not_taken_for_the_next_one(client):
    def twice(request):
        return [answer(request, actions=array(np.full((1, 1, 7), len(server.requests) / 10)))] * 2

    with Server([twice, twice, twice]) as server:
        policy = client(server)
        assert [round(float(policy.act(seen())[0, 0]), 3) for _ in range(3)] == [0.1, 0.2, 0.3]


def test_numbers_that_are_not_finite_arrive_as_such(client):
    with Server([lambda r: answer(r, actions=array(np.full((1, 1, 7), np.nan)))]) as server:
        assert np.isnan(client(server).act(seen())).all()


def test_a_server_that_comes_back_is_asked_again_and_another_one_is_not(client):
    with Server() as server:
        policy = client(server, "timeout=30&retries=3&patience=30")
        port = server.port
        policy.act(seen())
    with Server(port=port):
        assert policy.act(seen()).shape == (8, 7)
        assert policy.figures["policy_reconnects"] == 1
    other = msgpack.packb({"action_chunk_size": 4})
    with Server(port=port, metadata=other), pytest.raises(HandshakeError, match="has changed after a restart"):
        policy.act(seen())


def test_the_key_comes_from_the_environment(client, monkeypatch):
    monkeypatch.setenv("MY_KEY", "open-sesame")
    with Server(key="open-sesame") as server:
        with pytest.raises(HandshakeError, match="api_key_env"):
            client(server)
        assert client(server, f"{QUICK}&api_key_env=MY_KEY").act(seen()).shape == (8, 7)


@pytest.mark.slow
@pytest.mark.physics
def test_trials_are_evaluated_in_batches(tmp_path):
    blind = {"name": "blind", "views": [], "states": [{"key": "state", "parts": ["ee_position"]}]}
    blind |= {"instruction": {"key": "lang"}, "answer": {"parts": [{"key": "actions", "kind": "action"}]}}
    file = tmp_path / "blind.json"
    file.write_text(json.dumps(blind), encoding="utf-8")

    def still(request):
        return answer(request, actions=array(np.full((len(request["payload"]["examples"]), 16, 7), 0.01)))

    with Server([still] * 1000) as server:
        plan = make_plan(
            f"{server.address()}&adapter={file}",
            tasks=["morning_coffee"],
            variations=["T1"],
            trials=2,
            observation="state_only",
            quality="fast",
        )
        plan = replace(plan, trials=tuple(t for t in plan.trials if t.variation == "T1"))
        run = evaluate(plan, tmp_path / "run", envs=2)
        counts = {len(request["payload"]["examples"]) for request in server.requests}
    assert [(entry.status, entry.message) for entry in run.entries()] == [("done", None)] * 2
    for trial in plan.trials:
        assert np.allclose(run.read_record(trial.task, trial.condition, trial.seed).applied[1:], 0.01)
    assert counts <= {1, 2}


def test_the_address_leads_to_this_client_and_its_options_are_checked():
    with Server() as server:
        policy = make_policy(str(server.address()))
        assert isinstance(policy, StarVlaClient)
        policy.close()
        with pytest.raises(UnknownNameError, match="Did you mean 'flat'"):
            StarVlaClient(server.address("layout=flatt"))
    with pytest.raises(UnknownNameError, match="option of starvla"):
        read_address("starvla://host?images=png")
    with pytest.raises(InvalidInputError, match="host with a port"):
        read_address("starvla://host:port")
    with pytest.raises(PolicyUnavailableError, match=r"starvla://127.0.0.1:9 could not be reached"):
        StarVlaClient(read_address("starvla://127.0.0.1:9?patience=0.2"))
