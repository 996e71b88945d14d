"""The vla-eval client against the real model server of vla-evaluation-harness, and against scripted faults."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from dataclasses import replace

import anyio
import msgpack
import numpy as np
import pytest
from tests.looping import each
from vla_eval.model_servers.oft import OFTModelServer
from vla_eval.model_servers.openvla import OpenVLAModelServer
from vla_eval.model_servers.predict import PredictModelServer
from vla_eval.model_servers.serve import serve_async
from vla_eval.protocol.messages import Message, MessageType, pack_message, unpack_message
from vla_eval.specs import (
    GRIPPER_CLOSE_NEG,
    GRIPPER_CLOSE_POS,
    IMAGE_RGB,
    LANGUAGE,
    POSITION_ABSOLUTE,
    POSITION_DELTA,
    RAW,
    ROTATION_AA,
    ROTATION_EULER,
    STATE_EEF_POS_AA_GRIP,
    STATE_EEF_POS_QUAT_GRIP,
)
from websockets.asyncio.server import serve

from betterbench.errors import BetterError, HandshakeError, PolicyError, PolicyUnavailableError, UnknownNameError
from betterbench.evaluation import evaluate, make_plan
from betterbench.evaluation.preflight.check import policy_conventions
from betterbench.interface import EpisodeStart, Observation, observation_spec
from betterbench.interface.actions import EE_DELTA
from betterbench.policies.clients.vla_eval import declare_specs
from betterbench.policies.conventions.answers import AnswerPart, AnswerRule
from betterbench.policies.conventions.handshake import compare_declarations
from betterbench.policies.conventions.presets import VLA_EVAL
from betterbench.policies.kinds import make_policy
from betterbench.policies.protocols.wire import decode_vla_eval, encode_vla_eval
from betterbench.tasks import TrialId

START = EpisodeStart("pack the apple", 7, "ee_delta")
TRIAL = TrialId("fruit_lunch", "L3", 7)
TWIST = {"position": POSITION_DELTA, "rotation": ROTATION_AA, "gripper": GRIPPER_CLOSE_POS}
SEEN = {"image": IMAGE_RGB, "language": LANGUAGE, "state": STATE_EEF_POS_AA_GRIP}


class Scripted(PredictModelServer):
    """A model that answers with the number of the question; it remembers what it was shown."""

    def __init__(self, *, action=None, seen=None, params=None, fail_at=None, chunk=None):
        super().__init__()
        self.action, self.seen, self.params, self.fail_at = action, seen, params or {}, fail_at
        self.chunk = chunk
        self.shown, self.events = [], []

    def predict(self, obs, ctx):  # noqa: ARG002 - the harness calls it so
        self.shown.append(obs)
        if self.fail_at == len(self.shown):
            raise RuntimeError("the model fell over")
        value = 0.01 * len(self.shown)
        actions = np.array([value, 0, 0, 0, 0, 0, -1], np.float32)
        return {"actions": actions if self.chunk is None else np.tile(actions, (self.chunk, 1))}

    async def on_episode_start(self, config, ctx):
        self.events.append(("start", config))
        await super().on_episode_start(config, ctx)

    async def on_episode_end(self, result, ctx):
        self.events.append(("end", result))
        await super().on_episode_end(result, ctx)

    def get_action_spec(self):
        if self.action is None:
            raise NotImplementedError
        return self.action

    def get_observation_spec(self):
        return self.seen or {}

    def get_observation_params(self):
        return self.params


@contextlib.contextmanager
def running(main):
    """Run an asynchronous server, main(ready, stop), in a thread; ready is called with its port."""
    port, loops = [], []
    ready = threading.Event()

    def told(number):
        port.append(number)
        ready.set()

    async def whole():
        stop = asyncio.Event()
        loops.append((asyncio.get_running_loop(), stop))
        await main(told, stop)

    thread = threading.Thread(target=lambda: asyncio.run(whole()))
    thread.start()
    try:
        assert ready.wait(20)
        yield f"vla-eval://127.0.0.1:{port[0]}"
    finally:
        loop, stop = loops[0]
        loop.call_soon_threadsafe(stop.set)
        thread.join(20)
        assert not thread.is_alive()


def real(model):
    async def main(ready, stop):
        class Status:
            def started(self, port):
                ready(port)

        async with anyio.create_task_group() as group:

            async def served():
                await serve_async(model, "127.0.0.1", 0, task_status=Status())

            group.start_soon(served)
            await stop.wait()
            group.cancel_scope.cancel()

    return running(main)


def scripted(answer):
    """Run a bare server that answers each message by what the function returns, a list of messages or None to drop."""

    async def talk(connection):
        with contextlib.suppress(Exception):
            async for frame in connection:
                said = answer(unpack_message(frame))
                if said is None:
                    connection.transport.abort()
                    return
                for message in said:
                    await connection.send(message if isinstance(message, (bytes, str)) else pack_message(message))

    async def main(ready, stop):
        async with serve(talk, "127.0.0.1", 0, close_timeout=0.2, max_size=None) as server:
            ready(server.sockets[0].getsockname()[1])
            await stop.wait()

    return running(main)


def hello(message):
    return Message(MessageType.HELLO, {"protocol_version": 1, "harness_version": "test"}, message.seq)


def action(message, value=0.5):
    return Message(MessageType.ACTION, {"actions": np.full(7, value, np.float32)}, message.seq)


@contextlib.contextmanager
def client(address, query="timeout=5&patience=5"):
    made = make_policy(f"{address}?{query}")
    try:
        yield made
    finally:
        made.close()


def observation(step=0):
    draw = np.random.default_rng(5)
    return Observation(
        instruction="pack the apple",
        step=step,
        images={name: draw.integers(0, 256, (48, 64, 3)).astype(np.uint8) for name in ("front", "wrist")},
        joint_positions=np.zeros(7),
        joint_velocities=np.zeros(7),
        ee_position=np.array([0.4, 0.1, 0.3]),
        ee_quaternion=np.array([0.0, 1.0, 0.0, 0.0]),
        gripper_width=0.06,
        depth={},
        masks={},
    )


@pytest.mark.parametrize("images", ["raw", "png"])
def test_a_real_model_server_is_asked_and_answers(images):
    model = Scripted(action=TWIST, seen=SEEN)
    with real(model) as address, client(address, f"preset=vla_eval&timeout=20&images={images}") as policy:
        assert policy.info.action_space == "ee_delta"
        assert policy.info.metadata["server: model_server"] == "Scripted"
        for episode in range(2):
            policy.reset(START)
            for step in range(3):
                actions = policy.act(observation(step))
                assert actions.shape == (1, 7)
                assert np.allclose(actions[0, 0], 0.01 * (3 * episode + step + 1))
        # The last episode ends with the client.
    assert [kind for kind, _ in model.events] == ["start", "end", "start", "end"]
    assert model.events[0][1] == {"task": {"name": "pack the apple"}}
    assert model.events[1][1] == {"steps": 3}
    shown = model.shown[0]
    assert shown["task_description"] == "pack the apple"
    assert list(shown["images"]) == ["agentview", "wrist"]
    assert np.array_equal(shown["images"]["agentview"], observation().images["front"])
    assert np.allclose(shown["states"], [0.4, 0.1, 0.3, np.pi, 0, 0, 0.03, -0.03], atol=1e-6)


def test_the_policy_is_told_nothing_of_the_trial():
    model = Scripted()
    with real(model) as address, client(address) as policy:
        policy.reset(START)
        policy.act(observation())
    told = str(model.events) + str(list(model.shown[0]))
    assert "L3" not in told
    assert "fruit_lunch" not in told


def test_an_error_of_the_model_ends_the_trial_and_the_next_one_goes_on():
    with real(Scripted(fail_at=2)) as address, client(address) as policy:
        policy.reset(START)
        policy.act(observation())
        with pytest.raises(PolicyError, match="observation_failed: RuntimeError: the model fell over"):
            policy.act(observation(1))
        policy.reset(START)
        assert policy.act(observation()).shape == (1, 7)


@pytest.mark.parametrize(
    ("model", "text"),
    [
        (Scripted(action={**TWIST, "rotation": ROTATION_EULER}), "rotation: .* declares 'axis_angle', .*euler_xyz"),
        (Scripted(action={**TWIST, "gripper": GRIPPER_CLOSE_NEG}), "gripper: .*close_positive.*close_negative"),
        (Scripted(action={**TWIST, "position": POSITION_ABSOLUTE}), "position: .*delta_xyz.*absolute_xyz"),
        (Scripted(action=TWIST, seen={**SEEN, "state": STATE_EEF_POS_QUAT_GRIP}), "state: .*axisangle3.*quat4"),
        (
            Scripted(action=TWIST, seen={"a": IMAGE_RGB, "b": IMAGE_RGB, "c": IMAGE_RGB}),
            "camera c: .* needs this image, but this side provides images/agentview, images/wrist",
        ),
        (Scripted(params={"absolute_action": True}), "absolute poses"),
    ],
)
def test_specs_that_differ_stop_with_both_sides_named(model, text):
    with real(model) as address, pytest.raises(HandshakeError, match=text) as caught:
        make_policy(address)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("model", "query"),
    [
        (Scripted(action={"actions": RAW}, seen={"image": IMAGE_RGB, "state": RAW}), ""),
        (Scripted(action={**TWIST, "rotation": ROTATION_EULER}), "?rotation=rpy"),
        (Scripted(action={**TWIST, "gripper": GRIPPER_CLOSE_NEG}), "?gripper=open_positive"),
        (Scripted(), ""),
    ],
)
def test_specs_that_agree_or_promise_nothing_pass(model, query):
    with real(model) as address:
        policy = make_policy(f"{address}{query}")
        policy.check(space="ee_delta", observation=observation_spec("default"), rate_hz=20.0)
        with pytest.raises(HandshakeError, match="the run uses 'ee_pose'"):
            policy.check(space="ee_pose", observation=observation_spec("default"), rate_hz=20.0)
        policy.close()


@pytest.mark.parametrize(
    ("model", "query"),
    [
        (Scripted(action=TWIST, seen=SEEN), ""),
        (Scripted(action={**TWIST, "gripper": GRIPPER_CLOSE_NEG}), "?gripper=open_positive"),
        (Scripted(action={**TWIST, "rotation": ROTATION_EULER}), "?rotation=rpy"),
    ],
)
def test_the_doctor_reports_no_difference_for_a_server_that_agrees(model, query):
    with real(model) as address:
        policy = make_policy(f"{address}{query}")
        told = {c.name: c for c in policy_conventions(policy, address, policy.info, EE_DELTA)}
        policy.close()
    assert not [c for c in told.values() if c.differs]
    for name in ("gripper", "rotation", "position"):
        assert told[name].ours == told[name].theirs == model.action[name].format


@pytest.mark.parametrize("model", [OpenVLAModelServer, OFTModelServer])
def test_servers_of_the_harness_itself_agree(model):
    server = object.__new__(model)  # what it declares, without its weights
    server.use_proprio, server.num_images_in_input = True, 2
    hello = {
        "action_spec": {key: spec.to_dict() for key, spec in server.get_action_spec().items()},
        "observation_spec": {key: spec.to_dict() for key, spec in server.get_observation_spec().items()},
    }
    theirs, ours = declare_specs("the server", hello, VLA_EVAL)
    assert theirs.gripper == "binary_close_positive"
    compare_declarations(ours, theirs)


@pytest.mark.parametrize(
    ("params", "query", "images", "state"),
    [
        ({}, "", ["agentview"], False),
        ({"send_wrist_image": False, "send_state": True}, "", ["agentview"], True),
        ({"send_wrist_image": True, "send_state": True}, "", ["agentview", "wrist"], True),
        ({}, "preset=vla_eval", ["agentview", "wrist"], True),
        ({"send_wrist_image": False, "send_state": False}, "preset=vla_eval", ["agentview"], False),
    ],
)
def test_a_server_is_sent_what_the_harness_would_send_it_or_what_the_address_chose(params, query, images, state):
    model = Scripted(params=params)
    with real(model) as address, client(address, query) as policy:
        policy.reset(START)
        policy.act(observation())
    assert list(model.shown[0]["images"]) == images
    assert ("states" in model.shown[0]) is state


def test_answers_to_earlier_questions_are_passed_over():
    def answer(message):
        if message.type == MessageType.HELLO:
            return [hello(message)]
        if message.type != MessageType.OBSERVATION:
            return []
        stale = action(message, 0.1)
        stale.seq -= 1
        return [stale, action(message, 0.9)]

    with scripted(answer) as address, client(address) as policy:
        policy.reset(START)
        assert np.allclose(policy.act(observation()), 0.9)


def test_a_broken_connection_starts_the_episode_again():
    heard = []

    def answer(message):
        heard.append(message.type.value)
        if message.type == MessageType.HELLO:
            return [hello(message)]
        if message.type != MessageType.OBSERVATION:
            return []
        return None if heard.count("observation") == 1 else [action(message)]

    with scripted(answer) as address, client(address) as policy:
        policy.reset(START)
        assert np.allclose(policy.act(observation()), 0.5)
        assert policy.figures["policy_reconnects"] == 1
    assert heard[:6] == ["hello", "episode_start", "observation", "hello", "episode_start", "observation"]


@each(
    "reply, text",
    [
        (lambda _: [b"garbage"], "cannot be read"),
        (lambda _: ["text"], "not a message"),
        (lambda _: [msgpack.packb({"type": "action"})], "not a message"),
        (lambda m: [Message(MessageType.ACTION, {"actions": np.zeros(7)}, m.seq + 1)], "answered message"),
        (lambda m: [Message(MessageType.HELLO, {}, m.seq)], "answered message"),
        (lambda m: [msgpack.packb({"type": [1], "payload": {}, "seq": m.seq})], "without a type"),
        (lambda _: [msgpack.packb({"type": "action", "payload": {}, "seq": "1"})], "without a type"),
        (lambda m: [Message(MessageType.ACTION, {"action": np.zeros(7)}, m.seq)], "no 'actions'"),
        (lambda m: [Message(MessageType.ACTION, {"actions": np.zeros(6)}, m.seq)], r"shape \(6,\)"),
        (lambda _: [action(Message(MessageType.ACTION, {}, 0))] * 100, "none of which answers the request"),
    ],
)
def test_a_bad_answer_is_one_clear_policy_error(reply, text):
    def answer(message):
        if message.type == MessageType.HELLO:
            return [hello(message)]
        return reply(message) if message.type == MessageType.OBSERVATION else []

    with scripted(answer) as address, client(address) as policy:
        policy.reset(START)
        with pytest.raises(PolicyError, match=text) as caught:
            policy.act(observation())
        assert str(caught.value).startswith(policy.server.who)
        assert "\n" not in str(caught.value)


ODD = [None, 3, 2.5, "text", [1], {"a": 1}, np.zeros(2), True, [np.zeros(2)], {"format": np.zeros(2), "accepts": [1]}]


@pytest.mark.parametrize("odd", ODD, ids=repr)
def test_whatever_a_server_declares_gives_a_client_or_one_clear_line(odd):
    hellos = [
        {"protocol_version": odd},
        {"protocol_version": 1, "action_spec": odd, "capabilities": odd},
        {"protocol_version": 1, "action_spec": {"position": odd, "gripper": odd}},
        {"protocol_version": 1, "observation_spec": {"state": odd, "image": odd}},
        {"protocol_version": 1, "observation_params": odd},
        {"protocol_version": 1, "observation_params": dict.fromkeys(("absolute_action", "send_state"), odd)},
    ]
    said, told = [], {}
    with scripted(lambda m: [Message(MessageType.HELLO, told["hello"], m.seq)]) as address:
        for hello in hellos:
            told["hello"] = hello
            try:
                make_policy(address).close()
            except BetterError as problem:
                said.append(str(problem))
    assert not any("\n" in text for text in said)


def test_other_versions_and_other_servers_are_refused():
    with (
        scripted(lambda m: [Message(MessageType.HELLO, {"protocol_version": 9}, m.seq)]) as address,
        pytest.raises(HandshakeError, match="version 9 of the protocol, but betterbench uses version 1"),
    ):
        make_policy(address)
    with (
        scripted(lambda _: []) as address,
        pytest.raises(PolicyUnavailableError, match="may not be a vla-eval server"),
    ):
        make_policy(f"{address}?timeout=0.2&patience=0.1")
    with pytest.raises(UnknownNameError, match="Did you mean 'images'"):
        make_policy("vla-eval://127.0.0.1:1?image=png")


@pytest.mark.physics
def test_a_run_is_evaluated_through_the_real_server(tmp_path):
    adapter = replace(VLA_EVAL, views=())  # the state alone, so that nothing is rendered
    file = tmp_path / "blind.json"
    file.write_text(json.dumps(adapter.to_json()), encoding="utf-8")
    model = Scripted(action=TWIST, seen={"language": LANGUAGE, "state": STATE_EEF_POS_AA_GRIP}, chunk=100)
    with real(model) as address:
        plan = make_plan(
            f"{address}?adapter={file}&timeout=20",
            tasks=["morning_coffee"],
            variations=["T1"],
            trials=2,
            observation="state_only",
            quality="fast",
        )
        plan = replace(plan, trials=tuple(t for t in plan.trials if t.variation == "T1"))
        run = evaluate(plan, tmp_path / "run")
    assert [e.status for e in run.entries()] == ["done", "done"]
    for record, entry in zip(run.records(), run.entries(), strict=True):
        assert record.outcome.termination == "step_limit"
        assert entry.wall["policy_requests"] >= 2
        assert entry.wall["policy_retries"] == 0
        answered = 0.01 * np.arange(1, len(model.shown) + 1)
        assert np.isclose(record.applied[1:, 0][:, None], answered).any(axis=1).all()
        assert (record.applied[1:, 1:] == [0, 0, 0, 0, 0, -1]).all()
    assert [kind for kind, _ in model.events].count("start") == 2
    assert [kind for kind, _ in model.events].count("end") == 2


def test_their_codec_reads_ours_and_ours_reads_theirs():
    draw = np.random.default_rng(1)
    image = draw.integers(0, 256, (16, 24, 3)).astype(np.uint8)
    payload = {"images": {"a": image}, "states": np.arange(3.0), "flag": np.True_, "n": 3, "text": "ü"}
    form = {"type": "observation", "payload": payload, "seq": 3, "timestamp": time.time()}
    for images in ("raw", "png"):
        theirs = unpack_message(encode_vla_eval(form, images=images))
        assert np.array_equal(theirs.payload["images"]["a"], image)
        assert theirs.payload["states"].tolist() == [0.0, 1.0, 2.0]
        assert theirs.payload["flag"] is True
    # Theirs codes images as PNG unless told otherwise.
    ours = decode_vla_eval(pack_message(Message(MessageType.OBSERVATION, payload, 3)))
    assert b"PNG" in pack_message(Message(MessageType.OBSERVATION, payload, 3))
    assert np.array_equal(ours["payload"]["images"]["a"], image)
    assert ours["payload"]["states"].tolist() == [0.0, 1.0, 2.0]


JOINT_STEPS = replace(
    VLA_EVAL,
    answer=AnswerRule("joint_delta", (AnswerPart(("actions",), "joints"), AnswerPart(("actions",), "gripper"))),
)


@pytest.mark.parametrize(
    ("adapter", "joints", "fits"),
    [
        (VLA_EVAL, "joint_delta_pos", False),
        (VLA_EVAL, "joint_positions", False),
        (VLA_EVAL, "raw", True),
        (JOINT_STEPS, "joint_delta_pos", True),
        (JOINT_STEPS, "joint_positions", False),
    ],
)
def test_a_server_that_answers_joints_is_not_read_as_something_else(adapter, joints, fits):
    hello = {"action_spec": {"joints": {"name": "joints", "dims": 7, "format": joints}}}
    if fits:
        theirs, ours = declare_specs("the server", hello, adapter)
        compare_declarations(ours, theirs)
        return
    with pytest.raises(HandshakeError, match=joints):
        declare_specs("the server", hello, adapter)


@pytest.mark.parametrize(
    ("query", "spec", "assumed"),
    [("", None, True), ("preset=vla_eval&", None, False), ("", {"gripper": {"name": "gripper", "dims": 1}}, False)],
    ids=["nobody says", "the address says", "the server declares"],
)
def test_what_nobody_declares_is_said_to_be_assumed(query, spec, assumed):
    def answer(message):
        payload = {**hello(message).payload, **({"action_spec": spec} if spec else {})}
        return [Message(MessageType.HELLO, payload, message.seq)]

    with scripted(answer) as address, client(address, f"{query}timeout=5&patience=5") as policy:
        text = policy.info.metadata.get("assumed", "")
    assert bool(text) is assumed
    if assumed:
        assert text.startswith("policy server vla-eval://127.0.0.1:")
        assert "ee_delta" in text
        assert "close_positive" in text
