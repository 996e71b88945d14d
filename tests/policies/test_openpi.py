"""The openpi client against a server that was written from the protocol's facts alone, and against its faults."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
from dataclasses import replace

import msgpack
import numpy as np
import pytest
from tests.looping import each
from websockets.asyncio.server import serve

from betterbench.errors import (
    BetterError,
    HandshakeError,
    InvalidInputError,
    PolicyError,
    PolicyUnavailableError,
    UnknownNameError,
)
from betterbench.interface import EpisodeStart, Observation, observation_spec
from betterbench.interface.actions import EE_DELTA, JOINT_DELTA
from betterbench.policies.clients.openpi import OpenpiClient
from betterbench.policies.clients.remote import plain_text
from betterbench.policies.kinds import make_policy, read_address
from betterbench.tasks import TrialId

# {"server": "minimal"}, and {"actions": float32 array of shape (2, 7), "server_timing": {"infer_ms": 2.5}}: bytes as
# openpi's server sends them, written down once and not by the code under test.
METADATA = bytes.fromhex("81a6736572766572a76d696e696d616c")
CHUNK = bytes.fromhex(
    "82a7616374696f6e7384c40b5f5f6e6461727261795f5fc3c40464617461c438"
    "0000803e000000bf0000000000000000000000000000803e0000803f"
    "000000000000003f000000000000000000000000000000000000"
    "80bfc4056474797065a33c6634c40573686170659202"
    "07ad7365727665725f74696d696e6781a8696e6665725f6d73cb4004000000000000"
)
CHUNK_VALUES = [[0.25, -0.5, 0, 0, 0, 0.25, 1], [0, 0.5, 0, 0, 0, 0, -1]]
START = EpisodeStart("pack the apple", 7, "ee_delta")
TRIAL = TrialId("fruit_lunch", "L3", 7)


def array(values, dtype="<f4"):
    """Return an array as openpi writes it, by hand."""
    a = np.asarray(values, dtype=dtype)
    return {b"__ndarray__": True, b"data": a.tobytes(), b"dtype": a.dtype.str, b"shape": list(a.shape)}


def reply(values, dtype="<f4", **more):
    return msgpack.packb({"actions": array(values, dtype), **more})


class Server:
    """Greets, then plays one scripted answer per request: bytes, text, or a function of (connection, request)."""

    def __init__(self, script=(), *, greeting=METADATA, key=None, port=0, deaf=False, only_at=None, absent=404):
        self.only_at, self.absent = only_at, absent
        self.script, self.greeting, self.key, self.port = list(script), greeting, key, port
        self.requests, self.headers, self.paths, self.deaf = [], [], [], deaf
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run)
        self._ready = threading.Event()

    def __enter__(self):
        self._thread.start()
        assert self._ready.wait(10)
        return self

    def __exit__(self, *_):
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(10)
        assert not self._thread.is_alive()

    @property
    def address(self):
        return f"openpi://127.0.0.1:{self.port}"

    def _run(self):
        self._loop.run_until_complete(self._main())
        self._loop.close()

    async def _main(self):
        self._stop = asyncio.Event()
        async with serve(
            self._talk,
            "127.0.0.1",
            self.port,
            compression=None,
            max_size=None,
            process_request=self._admit,
            close_timeout=0.2,
        ) as server:
            self.port = server.sockets[0].getsockname()[1]
            self._ready.set()
            await self._stop.wait()

    async def hang(self, _):
        await self._stop.wait()

    def _admit(self, connection, request):
        self.paths.append(request.path)
        if self.only_at is not None and request.path != self.only_at:
            return connection.respond(self.absent, "no")
        self.headers.append(request.headers.get("Authorization"))
        if self.key is not None and self.headers[-1] != f"Api-Key {self.key}":
            return connection.respond(401, "no")
        return None

    async def _talk(self, connection):
        if self.greeting is not None:
            await connection.send(self.greeting)
        if self.deaf:
            connection.transport.pause_reading()
            await self._stop.wait()
            connection.transport.abort()
        with contextlib.suppress(Exception):
            async for frame in connection:
                self.requests.append(msgpack.unpackb(frame))
                step = self.script.pop(0) if self.script else CHUNK
                if callable(step):
                    step = await step(connection)
                if isinstance(step, str):
                    await connection.send(step)
                    await connection.close(1011, "see above")
                elif step is not None:
                    await connection.send(step)


async def drop(connection):
    connection.transport.abort()


def late(seconds):
    async def wait(_):
        await asyncio.sleep(seconds)
        return CHUNK

    return wait


@pytest.fixture
def observation():
    front = np.zeros((256, 256, 3), np.uint8)
    front[:128, :, 0] = 200
    return Observation(
        instruction="pack the apple",
        step=3,
        images={"front": front, "wrist": np.full((256, 256, 3), 9, np.uint8)},
        joint_positions=np.arange(7) / 10,
        joint_velocities=np.zeros(7),
        ee_position=np.array([0.4, 0.1, 0.3]),
        ee_quaternion=np.array([0.0, 1.0, 0.0, 0.0]),
        gripper_width=0.06,
        depth={},
        masks={},
    )


@contextlib.contextmanager
def client(server, query="preset=openpi_libero&timeout=5&patience=5", **options):
    made = OpenpiClient(read_address(f"{server.address}?{query}"), **options)
    made.reset(START)
    try:
        yield made
    finally:
        made.close()


def test_bytes_of_the_protocol_are_read_and_an_independent_server_reads_ours(observation):
    with Server() as server, client(server) as policy:
        actions = policy.act(observation)
    assert actions.dtype == np.float64
    assert actions.tolist() == CHUNK_VALUES
    assert policy.last_reply == {"server_timing": {"infer_ms": 2.5}}
    assert policy.figures["policy_server_s"] == 0.0025
    (seen,) = server.requests
    assert set(seen) == {"observation/image", "observation/wrist_image", "observation/state", "prompt"}
    assert seen["prompt"] == "pack the apple"
    state = seen["observation/state"]
    assert (state[b"dtype"], state[b"shape"]) == ("<f4", [8])
    expected = [0.4, 0.1, 0.3, np.pi, 0, 0, 0.03, -0.03]
    assert np.allclose(np.frombuffer(state[b"data"], "<f4"), expected, atol=1e-6)
    image = seen["observation/image"]
    assert (image[b"dtype"], image[b"shape"]) == ("|u1", [224, 224, 3])
    pixels = np.frombuffer(image[b"data"], np.uint8).reshape(224, 224, 3)
    assert pixels[0, 0].tolist() == [200, 0, 0]
    assert pixels[-1, 0].tolist() == [0, 0, 0]


OMNI = "/v1/realtime/robot/openpi"
"""Where vLLM-Omni serves openpi's protocol."""

# {"image_resolution": int64 array [224, 224], "action_dim": int64 7}, and {"actions": the chunk above}: bytes of
# msgpack-numpy 0.4.8, written down once.
ND_METADATA = bytes.fromhex(
    "82b0696d6167655f7265736f6c7574696f6e85c4026e64c3c40474797065a33c6938c4046b696e64c400c40573686170659102c404646174"
    "61c410e000000000000000e000000000000000aa616374696f6e5f64696d83c4026e64c2c40474797065a33c6938c40464617461c4080700"
    "000000000000"
)
ND_CHUNK = bytes.fromhex(
    "81a7616374696f6e7385c4026e64c3c40474797065a33c6634c4046b696e64c400c4057368617065920207c40464617461c4380000803e00"
    "0000bf0000000000000000000000000000803e0000803f000000000000003f00000000000000000000000000000000000080bf"
)


@pytest.mark.parametrize(
    ("path", "asked"),
    [
        ("", "/"),
        ("/", "/"),
        (OMNI, OMNI),
        (f"{OMNI}/", f"{OMNI}/"),
        ("/robots/arm%20one/openpi", "/robots/arm%20one/openpi"),
    ],
)
def test_a_server_is_reached_at_the_path_of_its_address(observation, path, asked):
    with Server() as server:
        policy = make_policy(f"{server.address}{path}?preset=openpi_libero&timeout=5&patience=5")
        policy.reset(START)
        assert policy.act(observation).tolist() == CHUNK_VALUES
        policy.close()
    assert server.paths == [asked]
    assert policy.info.name == f"{server.address}{path}?preset=openpi_libero&timeout=5&patience=5"


def test_messages_name_the_path():
    with pytest.raises(
        PolicyUnavailableError, match=rf"policy server openpi://127\.0\.0\.1:9{OMNI} could not be reached"
    ):
        make_policy(f"openpi://127.0.0.1:9{OMNI}?preset=openpi_libero&patience=0.2")


@pytest.mark.parametrize(
    ("absent", "text"),
    [
        (404, r"has no websocket at /v1/realtime \(HTTP 404\)\. Correct the path"),
        # What FastAPI answers for a websocket at a path that it does not know.
        (403, r"HTTP 403.*api_key_env=NAME.*does not serve /v1/realtime: correct the path"),
    ],
)
def test_a_wrong_path_is_said_at_once(absent, text):
    begun = time.monotonic()
    with Server(only_at=OMNI, absent=absent) as server, pytest.raises(HandshakeError, match=text):
        make_policy(f"{server.address}/v1/realtime?preset=openpi_libero&patience=30")
    assert time.monotonic() - begun < 10.0


@each("scheme", ["openpi", "vla-eval", "starvla", "http", "https"])
@each(
    "target, server, path",
    [
        ("gpu-box:8001/v1/a", ("gpu-box", 8001), "/v1/a"),
        ("[::1]:8001/v1/a", ("::1", 8001), "/v1/a"),
        ("gpu-box/v1/a%20b", ("gpu-box", None), "/v1/a%20b"),
    ],
)
def test_every_protocol_over_a_websocket_or_http_has_paths(scheme, target, server, path):
    address = read_address(f"{scheme}://{target}?tls=true&horizon=3")
    assert address.server() == (server[0], server[1] or address.form.port)
    assert address.path == path
    assert address.server_name == f"policy server {scheme}://{target}"


@pytest.mark.parametrize("scheme", ["gr00t", "being-h"])
@pytest.mark.parametrize("path", ["/v1/a", "/"])
def test_zeromq_has_no_paths(scheme, path):
    with pytest.raises(InvalidInputError, match=rf"{scheme} uses ZeroMQ\. Write {scheme}://\[::1\]:5555\.") as caught:
        read_address(f"{scheme}://[::1]:5555{path}?horizon=3")
    assert repr(path) in str(caught.value)
    read_address(f"{scheme}://[::1]:5555")


def test_an_ipv6_address_needs_brackets():
    with pytest.raises(InvalidInputError, match=r"openpi://\[::1\]:8000 with the IPv6 address in brackets"):
        read_address("openpi://::1:8000?preset=openpi_libero")
    assert read_address("openpi://[::1]:8000").server() == ("::1", 8000)


@each("scheme", ["openpi", "vla-eval", "starvla", "http"])
@each("path", ["/straße", "/50%", "/a%2", "/%zz", "/a b", "/a\tb", "/a#b", "/a\nb"])
def test_a_path_that_cannot_be_sent_is_refused(scheme, path):
    with pytest.raises(InvalidInputError, match=r"percent-encoding|is not a host with a port") as caught:
        read_address(f"{scheme}://host:8000{path}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("greeting", "query", "ours"),
    [
        (METADATA, "", b"__ndarray__"),
        (METADATA, "&arrays=nd", b"nd"),
        (ND_METADATA, "", b"nd"),
        (ND_METADATA, "&arrays=openpi", b"__ndarray__"),
    ],
)
def test_answers_of_msgpack_numpy_are_read_and_requests_use_what_the_server_does(observation, greeting, query, ours):
    with (
        Server([ND_CHUNK, CHUNK], greeting=greeting) as server,
        client(server, f"preset=openpi_libero&timeout=5{query}") as policy,
    ):
        assert policy.act(observation).tolist() == CHUNK_VALUES
        assert policy.act(observation).tolist() == CHUNK_VALUES
        if greeting is ND_METADATA:
            assert policy.info.metadata["server: action_dim"] == '"7"'
    state = server.requests[0]["observation/state"]
    assert ours in state
    if ours == b"nd":
        assert (state[b"nd"], state[b"type"], state[b"kind"], state[b"shape"]) == (True, "<f4", b"", [8])
    assert np.allclose(np.frombuffer(state[b"data"], "<f4")[:3], [0.4, 0.1, 0.3])


def test_a_dialect_that_does_not_exist_is_named():
    with pytest.raises(UnknownNameError, match=r"Unknown arrays 'ndd'.*Known: nd, openpi"):
        make_policy("openpi://127.0.0.1:9?preset=openpi_libero&arrays=ndd&patience=0")


def test_a_bare_array_is_the_actions_as_vllm_omni_sends_them(observation):
    for frame in (msgpack.packb(array(CHUNK_VALUES)), msgpack.packb(array([CHUNK_VALUES]))):
        with Server([frame]) as server, client(server) as policy:
            assert policy.act(observation).tolist() == CHUNK_VALUES
            assert policy.last_reply == {}
    with (
        Server([msgpack.packb(array(CHUNK_VALUES))]) as server,
        client(server, "preset=being_h_libero&timeout=5") as policy,
        pytest.raises(PolicyError, match=r"returns an array, but adapter being_h_libero reads action\.eef_position, "),
    ):
        policy.act(observation)


def test_an_error_in_a_map_is_an_error(observation):
    error = msgpack.packb({"type": "error", "message": "Internal inference error"})
    with Server([error]) as server, client(server) as policy:
        with pytest.raises(PolicyError, match="reports an error: Internal inference error"):
            policy.act(observation)
        assert policy.act(observation).tolist() == CHUNK_VALUES
    with Server(greeting=error) as server, pytest.raises(HandshakeError, match="reports an error: Internal"):
        make_policy(f"{server.address}?preset=openpi_libero&patience=0")


def test_a_server_with_sessions_is_told_of_each_episode(observation):
    greeting = msgpack.packb({"needs_session_id": True})
    with Server(greeting=greeting) as server, client(server) as one, client(server) as other:
        for policy in (one, one, other):
            policy.act(observation)
        one.reset(START)
        one.act(observation)
    first, again, second, later = (request["session_id"] for request in server.requests)
    assert first == again
    assert len({first, second, later}) == 3
    with Server(greeting=greeting) as server, client(server, "preset=openpi_libero&send.session_id=mine") as policy:
        policy.act(observation)
    assert server.requests[0]["session_id"] == "mine"
    with Server() as server, client(server) as policy:
        policy.act(observation)
    assert "session_id" not in server.requests[0]


def counted(first):
    """Return a reply whose rows are told apart by their first number."""
    rows = np.zeros((8, 7))
    rows[:, 0] = first + np.arange(8) / 100
    return reply(rows)


def test_a_chunk_is_continued_within_an_episode_and_not_beyond(observation):
    script = [counted(0.1 * i) for i in range(5)]
    with Server(script) as server, client(server, "preset=openpi_libero&horizon=5&delay=3&timeout=5") as policy:
        for step in (0, 5, 11):  # after six more steps only two rows are left, fewer than the delay
            policy.act(replace(observation, step=step))
        policy.reset(START)
        for step in (0, 4):
            policy.act(replace(observation, step=step))
    told = [
        None if "prev_action_chunk" not in asked else np.frombuffer(asked["prev_action_chunk"][b"data"], "<f4")
        for asked in server.requests
    ]
    assert [told[0], told[2], told[3]] == [None, None, None]
    assert np.allclose(told[1].reshape(8, 7)[:, 0], [0.05, 0.06, 0.07, 0.07, 0.07, 0.07, 0.07, 0.07])
    assert np.allclose(told[4].reshape(8, 7)[:4, 0], [0.34, 0.35, 0.36, 0.37])
    assert (server.requests[1]["inference_delay"], server.requests[1]["execute_horizon"]) == (3, 5)
    with Server() as server, client(server, "preset=openpi_libero&timeout=5") as policy:
        for step in (0, 1):
            policy.act(replace(observation, step=step))
    assert not {"prev_action_chunk", "inference_delay"} & {key for asked in server.requests for key in asked}


def test_a_bare_array_is_continued_too(observation):
    frames = [msgpack.packb(array([CHUNK_VALUES])), CHUNK]
    with Server(frames) as server, client(server, "preset=openpi_libero&delay=1&timeout=5") as policy:
        for step in (0, 1):
            policy.act(replace(observation, step=step))
    sent = np.frombuffer(server.requests[1]["prev_action_chunk"][b"data"], "<f4").reshape(2, 7)
    assert np.allclose(sent, [CHUNK_VALUES[1]] * 2)
    assert "execute_horizon" in server.requests[1]  # that of the preset


def test_several_arrays_are_not_continued():
    with pytest.raises(InvalidInputError, match=r"delay needs a single action array, .* Omit delay"):
        make_policy("openpi://127.0.0.1:9?preset=being_h_libero&delay=3&patience=0")


def test_a_real_policy_is_told_nothing_of_the_trial(observation):
    with Server() as server, client(server) as policy:
        policy.name_trial(TRIAL)
        policy.act(observation)
    told = msgpack.packb(server.requests[0])
    assert b"fruit_lunch" not in told
    assert b"L3" not in told


@pytest.mark.parametrize("expert", [True, False])
def test_native_servers_are_found_by_what_they_declare_and_only_an_expert_is_told_the_trial(observation, expert):
    greeting = msgpack.packb(
        {
            "betterbench": {
                "protocol": 1,
                "preset": "native",
                "policy": "expert",
                "expert": expert,
                "needs_images": False,
                "action_space": EE_DELTA.to_json(),
                "cameras": {},
                "control_rate_hz": 20.0,
            }
        }
    )
    with Server(greeting=greeting) as server, client(server, "timeout=5") as policy:
        assert not policy.info.needs_images
        assert policy.info.action_space == "ee_delta"
        policy.name_trial(TRIAL)
        policy.act(observation)
    (seen,) = server.requests
    told = {"episode": 7, "action_space": "ee_delta", "instruction": "pack the apple"}
    trial = {"task": "fruit_lunch", "condition": "L3", "seed": 7}
    assert seen["better/episode"] == {**told, **(trial if expert else {})}
    assert seen["better/step"] == 3
    assert seen["better/gripper_width"] == 0.06
    for name, value in (("ee_quaternion", observation.ee_quaternion), ("joint_positions", observation.joint_positions)):
        sent = seen[f"better/{name}"]
        assert sent[b"dtype"] == "<f8"
        assert np.frombuffer(sent[b"data"]).tolist() == value.tolist()
    assert (
        np.frombuffer(seen["better/images/front"][b"data"], np.uint8).tobytes() == observation.images["front"].tobytes()
    )


def test_the_space_of_a_native_server_is_taken_over():
    space = JOINT_DELTA.to_json()
    greeting = msgpack.packb({"betterbench": {"protocol": 1, "preset": "native", "action_space": space}})
    with Server(greeting=greeting) as server:
        policy = make_policy(server.address)
        try:
            assert policy.info.action_space == "joint_delta"
            with pytest.raises(HandshakeError, match=r"'ee_delta'.*returns actions in 'joint_delta'"):
                policy.reset(START)
        finally:
            policy.close()


@each(
    "change, query, text",
    [
        ({"control_rate_hz": 15.0}, "", "rate hz: this side declares 20, .* declares 15"),
        ({"preset": "other"}, "preset=openpi_libero", "preset: .*'openpi_libero', .* declares 'other'"),
        ({"action_space": {**EE_DELTA.to_json(), "scale": [1.0] * 7}}, "", r"action scale: .*0\.05.* declares \(1, 1"),
        ({"action_space": EE_DELTA.to_json()}, "action_space=ee_pose", "action space: .*'ee_pose', .* 'ee_delta'"),
        ({"protocol": 2}, "", "version 2"),
        ({"action_space": {"name": "x"}}, "", "cannot be read"),
        ({"action_space": 3}, "", "action_space: is not a JSON object"),
        ({"execution": {"horizon": 0}}, "", "invalid settings for executing chunks .*must be"),
        ({"execution": {"speed": 2}}, "", "the declared settings for executing chunks are malformed"),
        ({"execution": {"horizon": True}}, "", "the declared settings for executing chunks are malformed"),
    ],
)
def test_conventions_that_differ_are_named_with_both_sides(change, query, text):
    declared = {"protocol": 1, "preset": "native", "action_space": EE_DELTA.to_json(), **change}
    with Server(greeting=msgpack.packb({"betterbench": declared})) as server:
        with pytest.raises(HandshakeError, match=text) as caught:
            make_policy(f"{server.address}?{query}" if query else server.address)
        assert "\n" not in str(caught.value)


def test_the_run_is_compared_before_it_starts():
    with Server() as server, client(server) as policy:
        policy.check(space="ee_delta", observation=observation_spec("default"), rate_hz=20.0)
        with pytest.raises(HandshakeError, match=r"the run uses 'ee_pose'.*returns actions in 'ee_delta'"):
            policy.check(space="ee_pose", observation=observation_spec("default"), rate_hz=20.0)
        with pytest.raises(HandshakeError, match=r"needs front, wrist .* the run renders none"):
            policy.check(space="ee_delta", observation=observation_spec("state_only"), rate_hz=20.0)
        with pytest.raises(HandshakeError, match="the run uses 15 Hz"):
            policy.check(space="ee_delta", observation=observation_spec("default"), rate_hz=15.0)


def test_a_droid_policy_runs_on_the_cameras_made_for_it():
    with Server() as server, contextlib.closing(make_policy(f"{server.address}?preset=openpi_droid")) as policy:
        policy.check(space="joint_delta", observation=observation_spec("droid"), rate_hz=20.0)
        with pytest.raises(HandshakeError, match=r"needs left_shoulder \(adapter openpi_droid\)"):
            policy.check(space="joint_delta", observation=observation_spec("default"), rate_hz=20.0)


def test_nothing_is_guessed_where_the_server_declares_nothing():
    with Server() as server, pytest.raises(InvalidInputError, match=r"neither .* Add \?preset=NAME"):
        make_policy(server.address)


@pytest.mark.parametrize(
    ("script", "text"),
    [
        (["Traceback (most recent call last):\n  File\nRuntimeError: out of memory\n"], "error: RuntimeError: out of"),
        ([""], "no message"),
        ([b"\xc1"], "cannot be read"),
        ([b""], "cannot be read"),
        ([msgpack.packb([1])], "list"),
        ([msgpack.packb({"action": 1})], "no 'actions'. It has: action"),
        ([msgpack.packb({"act\nions": 1})], "no 'actions'. It has: act ions"),
        ([reply(np.zeros((4, 6)))], r"shape \(4, 6\).*\(7,\) or \(horizon, 7\)"),
        ([reply(np.zeros((0, 7)))], "empty chunk"),
        ([reply(np.zeros((4, 7)), "|b1")], "not an array of real numbers"),
        ([msgpack.packb({"actions": "left"})], "not an array of real numbers"),
        ([msgpack.packb({"actions": [[0.0] * 7, [0.0]]})], "not an array of real numbers"),
        ([reply(np.zeros((2, 2, 7)))], r"shape \(2, 2, 7\)"),
    ],
)
def test_a_bad_reply_is_one_clear_policy_error_and_the_next_episode_goes_on(observation, script, text):
    with Server(script) as server, client(server) as policy:
        with pytest.raises(PolicyError, match=text) as caught:
            policy.act(observation)
        assert not isinstance(caught.value, PolicyUnavailableError)
        assert str(caught.value).startswith(policy.server.who)
        assert "\n" not in str(caught.value)
        policy.reset(START)
        assert policy.act(observation).tolist() == CHUNK_VALUES


def test_a_number_that_is_a_signaling_nan_is_one_like_others(observation):
    values = np.zeros((1, 7), np.float32)
    values.view(np.uint32)[0, 2] = 0x7F800001
    with Server([reply(values)]) as server, client(server) as policy:
        assert np.isnan(policy.act(observation)).tolist() == [[False, False, True, False, False, False, False]]


def test_what_follows_a_bad_reply_is_never_taken_for_an_answer(observation):
    async def twice(connection):
        await connection.send(b"\xc1")
        return reply(np.full((1, 7), 0.9))

    with Server([twice]) as server, client(server) as policy:
        with pytest.raises(PolicyError, match="cannot be read"):
            policy.act(observation)
        assert policy.act(observation).tolist() == CHUNK_VALUES


def test_numbers_that_are_not_finite_pass_to_the_action_space_which_names_them(observation):
    values = np.zeros((2, 7))
    values[1, 2] = np.nan
    with Server([reply(values)]) as server, client(server) as policy:
        actions = policy.act(observation)
    assert np.isnan(actions[1, 2])
    assert actions[0].tolist() == [0.0] * 7


def test_a_dropped_connection_is_made_again_and_counted(observation):
    with Server([drop, drop]) as server, client(server) as policy:
        assert policy.act(observation).tolist() == CHUNK_VALUES
        figures = policy.figures
        assert (figures["policy_requests"], figures["policy_retries"], figures["policy_reconnects"]) == (1, 2, 2)
        policy.reset(START)
        assert policy.figures["policy_retries"] == 0


def test_a_connection_that_drops_each_time_ends_the_trial(observation):
    with Server([drop] * 3) as server, client(server, "preset=openpi_libero&retries=2&patience=5") as policy:
        with pytest.raises(PolicyError, match=r"failed to answer 3 times\. Last reason: .* dropped") as caught:
            policy.act(observation)
        assert not isinstance(caught.value, PolicyUnavailableError)
        assert policy.act(observation).tolist() == CHUNK_VALUES


def test_a_late_reply_is_asked_for_again_and_never_taken_for_the_next(observation):
    with (
        Server([late(1.0), reply(np.full((1, 7), 0.5))]) as server,
        client(server, "preset=openpi_libero&timeout=0.3&patience=5") as policy,
    ):
        assert policy.act(observation).tolist() == [[0.5] * 7]
        assert policy.figures["policy_retries"] == 1


def test_the_first_reply_may_take_longer_because_servers_compile_their_model(observation):
    script = [late(0.6), late(0.6)]
    with (
        Server(script) as server,
        client(server, "preset=openpi_libero&timeout=0.2&warmup=10&retries=0") as policy,
    ):
        assert policy.act(observation).tolist() == CHUNK_VALUES
        with pytest.raises(PolicyError, match=r"no answer within 0\.2 s"):
            policy.act(observation)


def test_late_without_retries_is_a_policy_error(observation):
    with (
        Server([late(0.8)]) as server,
        client(server, "preset=openpi_libero&timeout=0.2&retries=0") as policy,
        pytest.raises(PolicyError, match=r"once\. Last reason: no answer within 0\.2 s"),
    ):
        policy.act(observation)


def test_an_oversized_frame_is_refused(observation):
    with Server([b"\x00" * 20_000]) as server, client(server, max_bytes=10_000) as policy:
        with pytest.raises(PolicyError, match="more than 10000 bytes"):
            policy.act(observation)
        assert policy.act(observation).tolist() == CHUNK_VALUES


def test_a_server_that_restarts_is_waited_for(observation):
    first = Server()
    with contextlib.ExitStack() as stack:
        with first:
            policy = stack.enter_context(client(first, "preset=openpi_libero&timeout=5&patience=20"))
            policy.act(observation)
        second = Server(port=first.port)
        timer = threading.Timer(0.5, lambda: stack.enter_context(second))
        timer.start()
        assert policy.act(observation).tolist() == CHUNK_VALUES
        timer.join()
        assert policy.figures["policy_reconnects"] == 1


def test_a_server_that_comes_back_as_another_one_stops_the_run(observation):
    first = Server()
    other = msgpack.packb({"betterbench": {"protocol": 1, "preset": "native", "action_space": EE_DELTA.to_json()}})
    with contextlib.ExitStack() as stack:
        with first:
            policy = stack.enter_context(client(first, "preset=openpi_libero&timeout=5&patience=20"))
        stack.enter_context(Server(port=first.port, greeting=other))
        with pytest.raises(HandshakeError, match=r"preset: this side declares 'openpi_libero'.*'native'"):
            policy.act(observation)


def test_a_server_that_is_never_there_is_one_clear_line():
    with Server() as server:
        address = server.address
    began = time.monotonic()
    with pytest.raises(PolicyUnavailableError, match=r"could not be reached for 0\.5 s \(.*refused") as caught:
        make_policy(f"{address}?preset=openpi_libero&patience=0.5")
    assert time.monotonic() - began < 30
    assert "\n" not in str(caught.value)


def test_what_is_no_openpi_server_is_named():
    with (
        Server(greeting=None) as server,
        pytest.raises(PolicyUnavailableError, match="may not be an openpi server"),
    ):
        make_policy(f"{server.address}?preset=openpi_libero&patience=0.1&timeout=0.2")
    with (
        Server(greeting="who are you\nValueError: go away") as server,
        pytest.raises(HandshakeError, match="ValueError: go away"),
    ):
        make_policy(f"{server.address}?preset=openpi_libero")


@pytest.mark.parametrize("said", [b"SSH-2.0-OpenSSH_9.6\r\n", b"HTTP/1.1 503 Busy\r\n\r\n", b"", b"\x00" * 5000, None])
def test_whatever_else_listens_there_is_one_clear_line(said):
    listener = socket.create_server(("127.0.0.1", 0))
    done = threading.Event()

    def talk():
        with contextlib.suppress(OSError):
            while True:
                connection, _ = listener.accept()
                with connection:
                    if said is None:
                        done.wait(5)
                    else:
                        connection.sendall(said)

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        port = listener.getsockname()[1]
        with pytest.raises(PolicyUnavailableError, match="could not be reached") as caught:
            make_policy(f"openpi://127.0.0.1:{port}?preset=openpi_libero&patience=0.1&timeout=1")
        assert "\n" not in str(caught.value)
        if said == b"":  # as behind a tunnel
            assert "not a websocket server" not in str(caught.value)
    finally:
        done.set()
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join(10)
        assert not thread.is_alive()


@pytest.mark.parametrize("host", ["a" * 300, "a..b", "xn--a"])
def test_hosts_that_cannot_be_names_are_one_clear_line(host):
    with pytest.raises((HandshakeError, PolicyUnavailableError)) as caught:
        make_policy(f"openpi://{host}:8000?preset=openpi_libero&patience=0")
    assert "\n" not in str(caught.value)


def test_a_server_that_stops_reading_is_given_up_at_the_deadline(observation):
    large = replace(observation, images={n: np.zeros((2048, 2048, 3), np.uint8) for n in observation.images})
    with (
        Server(deaf=True) as server,
        client(server, "preset=openpi_libero&size=2048&timeout=0.4&retries=0") as policy,
        pytest.raises(PolicyError, match=r"failed to answer once\. Last reason: no answer within 0\.4 s"),
    ):
        policy.act(large)


def test_keys_come_from_the_environment(monkeypatch, observation):
    monkeypatch.setenv("OUR_KEY", "s3cret")
    with Server(key="s3cret") as server:
        with client(server, "preset=openpi_libero&api_key_env=OUR_KEY") as policy:
            policy.act(observation)
            assert "s3cret" not in str(policy.info)
        with pytest.raises(HandshakeError, match=r"rejects this client .HTTP 401.*api_key_env"):
            make_policy(f"{server.address}?preset=openpi_libero")
    monkeypatch.delenv("OUR_KEY")
    with pytest.raises(InvalidInputError, match="OUR_KEY contains no key"):
        make_policy("openpi://127.0.0.1:1?preset=openpi_libero&api_key_env=OUR_KEY")


def test_closing_ends_a_wait_in_another_thread(observation):
    with Server() as server, client(server) as policy:
        server.script = [server.hang]
        problems = []

        def ask():
            try:
                policy.act(observation)
            except PolicyError as problem:
                problems.append(str(problem))

        thread = threading.Thread(target=ask)
        thread.start()
        while not server.requests:
            time.sleep(0.01)
        policy.close()
        thread.join(10)
        assert not thread.is_alive()
        assert "was closed" in problems[0]


def test_metadata_of_strangers_are_kept_as_short_texts():
    greeting = {f"k{i}": i for i in range(1000)} | {"long": "x" * 9000, "a": {b"y": array([1.0])}, "b" * 500: None}
    with Server(greeting=msgpack.packb(greeting)) as server, client(server) as policy:
        told = policy.info.metadata
    assert len(told) == 101
    assert all(isinstance(v, str) and len(v) <= 3000 and len(k) <= 120 for k, v in told.items())
    assert "server: a" in told


@pytest.mark.parametrize("odd", [None, 3, 2.5, "text", [1], {"a": 1}, array([1.0, 2.0]), [array([1.0, 2.0])]], ids=repr)
def test_whatever_a_server_declares_gives_a_client_or_one_clear_line(odd):
    whole = {"protocol": 1, "preset": "native", "action_space": EE_DELTA.to_json()}
    declared = [odd, {**whole, "layouts": odd}, {**whole, "cameras": odd}, {**whole, "cameras": {"front": odd}}]
    declared += [{**whole, key: odd} for key in (*whole, "control_rate_hz", "needs_images", "execution")]
    declared += [{**whole, "execution": {key: odd}} for key in ("horizon", "ahead", "ensemble")]
    declared += [{**whole, "action_space": {**EE_DELTA.to_json(), key: odd}} for key in EE_DELTA.to_json()]
    said = []
    with Server() as server:
        for form in declared:
            server.greeting = msgpack.packb({"betterbench": form})
            try:
                make_policy(f"{server.address}?timeout=5").close()
            except BetterError as problem:
                said.append(str(problem))
    assert len(said) > 5
    assert not any("\n" in text for text in said)


def test_execution_is_taken_from_the_address():
    with Server() as server, client(server, "preset=openpi_libero&horizon=5&ahead=2") as policy:
        assert (policy.info.execution.horizon, policy.info.execution.ahead) == (5, 2)
        assert '"name": "openpi_libero"' in policy.info.metadata["adapter"]
        assert policy.info.metadata["server: server"] == "minimal"


def test_unknown_schemes_and_options_get_the_closest():
    with pytest.raises(UnknownNameError, match="Did you mean 'openpi'"):
        make_policy("openpy://127.0.0.1:8000")
    with pytest.raises(UnknownNameError, match="Did you mean 'preset'"):
        make_policy("openpi://127.0.0.1:8000?preste=openpi_libero")
    with pytest.raises(UnknownNameError, match="Did you mean 'openpi_libero'"):
        make_policy("openpi://127.0.0.1:8000?preset=openpi_lbero&patience=0")


def test_a_change_beyond_what_is_kept_of_a_declaration_is_seen():
    first, second = (plain_text("x" * 5000 + end) for end in "ab")
    assert len(first) < 2200
    assert first != second
    assert plain_text("x" * 5000 + "a") == first
