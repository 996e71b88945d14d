"""The client of GR00T's servers against an independent minimal server, written from the protocol's description."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import logging
import threading
import time

import msgpack
import numpy as np
import pytest
import zmq

from betterbench.errors import (
    HandshakeError,
    InvalidInputError,
    PolicyError,
    PolicyUnavailableError,
    UnknownNameError,
)
from betterbench.evaluation import evaluate, make_plan
from betterbench.interface import BatchPolicy, EpisodeStart, Execution, Observation, observation_spec
from betterbench.policies.clients import request_client
from betterbench.policies.clients.gr00t import connect_gr00t
from betterbench.policies.conventions.presets import GR00T_NEW_EMBODIMENT
from betterbench.policies.kinds import read_address

START = EpisodeStart("pack the apple", 3, "ee_delta")
QUICK = "timeout=5&retries=1&patience=1"
ACTIONS = {"ee_position": 3, "ee_rotation": 3, "gripper": 1}

# Frames written down from the description, not by our encoder: what the client sends, and what a server answers.
PING = bytes.fromhex("81a8656e64706f696e74a470696e67")
PONG = bytes.fromhex("82a6737461747573a26f6ba76d657373616765b15365727665722069732072756e6e696e67")
UNAUTHORIZED = bytes.fromhex("81a56572726f72bf556e617574686f72697a65643a20496e76616c69642041504920746f6b656e")
CLOSE_NOW = bytes.fromhex(
    # [{"gripper": {"__ndarray_class__": true, "as_npy": the .npy file of ((1.0,),) float32, shape (1, 1, 1)}}, {}]
    "9281a76772697070657282b15f5f6e6461727261795f636c6173735f5fc3a661735f6e7079c484934e554d5059010076"
    "007b276465736372273a20273c6634272c2027666f727472616e5f6f72646572273a2046616c73652c20277368617065"
    "273a2028312c20312c2031292c207d202020202020202020202020202020202020202020202020202020202020202020"
    "202020202020202020202020202020202020202020200a0000803f80"
)


# What N1.7 answers: [{"ee_position": ((0.25, -0.5, 0),), "ee_rotation": ((0, 0, 0.125),), "gripper": ((1,),)}, {}] with
# float32 arrays in msgpack-numpy's maps, whose keys are bytes; and the modalities, marked "__ModalityConfig__".
N1_7_CHUNK = bytes.fromhex(
    "9283ab65655f706f736974696f6e85c4026e64c3c40474797065a33c6634c4046b696e64c400c4057368617065930101"
    "03c40464617461c40c0000803e000000bf00000000ab65655f726f746174696f6e85c4026e64c3c40474797065a33c66"
    "34c4046b696e64c400c405736861706593010103c40464617461c40c00000000000000000000003ea767726970706572"
    "85c4026e64c3c40474797065a33c6634c4046b696e64c400c405736861706593010101c40464617461c4040000803f80"
)
N1_7_MODALITIES = bytes.fromhex(
    "84a5766964656f82b25f5f4d6f64616c697479436f6e6669675f5fc3a761735f6a736f6e83ad64656c74615f696e6469"
    "6365739100ad6d6f64616c6974795f6b65797392a566726f6e74a57772697374b673696e5f636f735f656d6265646469"
    "6e675f6b657973c0a5737461746582b25f5f4d6f64616c697479436f6e6669675f5fc3a761735f6a736f6e83ad64656c"
    "74615f696e64696365739100ad6d6f64616c6974795f6b65797393ab65655f706f736974696f6eab65655f726f746174"
    "696f6ea767726970706572b673696e5f636f735f656d62656464696e675f6b657973c0a6616374696f6e82b25f5f4d6f"
    "64616c697479436f6e6669675f5fc3a761735f6a736f6e83ad64656c74615f696e64696365739100ad6d6f64616c6974"
    "795f6b65797393ab65655f706f736974696f6eab65655f726f746174696f6ea767726970706572b673696e5f636f735f"
    "656d62656464696e675f6b657973c0a86c616e677561676582b25f5f4d6f64616c697479436f6e6669675f5fc3a76173"
    "5f6a736f6e83ad64656c74615f696e64696365739100ad6d6f64616c6974795f6b65797391d928616e6e6f746174696f"
    "6e2e68756d616e2e616374696f6e2e7461736b5f6465736372697074696f6eb673696e5f636f735f656d62656464696e"
    "675f6b657973c0"
)


def array(values, dtype="<f4"):
    """Return an array as the protocol codes it: the bytes of a .npy file in a marked map."""
    file = io.BytesIO()
    np.save(file, np.asarray(values, dtype), allow_pickle=False)
    return {"__ndarray_class__": True, "as_npy": file.getvalue()}


def modality(keys, steps=(0,), *, text=False):
    """Return a modality config as a server sends it; N1.5 sends JSON text."""
    form = {"delta_indices": list(steps), "modality_keys": list(keys)}
    return {"__ModalityConfig_class__": True, "as_json": json.dumps(form) if text else form}


def modalities(video=("front", "wrist"), state=("ee_position", "ee_rotation", "gripper"), steps=(0,), **other):
    """Return the modalities of the preset."""
    return {
        "video": modality(video, steps),
        "state": modality(state),
        "action": modality(ACTIONS, range(8)),
        "language": modality(["annotation.human.action.task_description"]),
        **other,
    }


def chunk(batch=1, horizon=8, value=0.25):
    """Return [action, info] with (batch, horizon, size) arrays."""
    return [{name: array(np.full((batch, horizon, size), value)) for name, size in ACTIONS.items()}, {}]


def decoded(thing):
    """Read the arrays of a question."""
    if isinstance(thing, dict) and "__ndarray_class__" in thing:
        return np.load(io.BytesIO(thing["as_npy"]), allow_pickle=False)
    return thing


class Server:
    """Answers REQ sockets in a thread: with what a script says for an endpoint (None for never), or with the usual.

    It listens with a ROUTER socket, which is a REP socket that may leave a question without an answer.
    """

    def __init__(self, script=None, *, modalities_=None, token=None, port=0):
        self.script, self.token = dict(script or {}), token
        self.modalities = modalities() if modalities_ is None else modalities_
        self.asked, self.raw = [], []
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 0)
        for attempt in range(50):  # a port that was just given back may take a moment
            with contextlib.suppress(zmq.ZMQError):
                self._socket.bind(f"tcp://127.0.0.1:{port or '*'}")
                break
            assert attempt < 49
            time.sleep(0.1)
        self.port = int(self._socket.getsockopt_string(zmq.LAST_ENDPOINT).rpartition(":")[2])
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        self._socket.close()
        self._context.term()

    def address(self, options=QUICK):
        return read_address(f"gr00t://127.0.0.1:{self.port}?{options}")

    def questions(self, endpoint):
        return [q for q in self.asked if q["endpoint"] == endpoint]

    def _serve(self):
        while not self._stop.is_set():
            if not self._socket.poll(20):
                continue
            sender, empty, frame = self._socket.recv_multipart()
            self.raw.append(frame)
            self.asked.append(msgpack.unpackb(frame, object_hook=decoded))
            answer = self._answer(self.asked[-1])
            if answer is not None:
                parts = answer if isinstance(answer, tuple) else (answer,)
                coded = [part if isinstance(part, bytes) else msgpack.packb(part) for part in parts]
                self._socket.send_multipart([sender, empty, *coded])

    def _answer(self, question):
        endpoint = question["endpoint"]
        if self.token is not None and question.get("api_token") != self.token:
            return UNAUTHORIZED
        step = self.script.get(endpoint)
        if isinstance(step, list):
            step = step.pop(0) if step else None
        if callable(step):
            return step(question)
        if step is not None:
            return step
        if endpoint == "ping":
            return PONG
        if endpoint == "get_modality_config":
            return self.modalities
        if endpoint == "reset":
            return {}
        observation = question["data"].get("observation", question["data"])
        some = observation["video"]["front"] if "video" in observation else observation["video.front"]
        return chunk(batch=len(some))


@pytest.fixture
def client():
    """Connect to a server and close whatever the test connected."""
    with contextlib.ExitStack() as stack:

        def connect(server, options=QUICK):
            made = connect_gr00t(server.address(options))
            stack.callback(made.close)
            return made

        yield connect


def seen(step=0, shade=0, **changes):
    given = {
        "instruction": "pack the apple",
        "step": step,
        "images": {name: np.full((256, 256, 3), shade, np.uint8) for name in ("front", "wrist")},
        "joint_positions": np.zeros(7),
        "joint_velocities": np.zeros(7),
        "ee_position": np.array([0.4, 0.0, 0.3 + 0.01 * step]),
        "ee_quaternion": np.array([0.0, 1.0, 0.0, 0.0]),
        "gripper_width": 0.05,
        "depth": {},
        "masks": {},
    }
    return Observation(**{**given, **changes})


def test_an_observation_goes_out_nested_and_a_chunk_comes_back(client):
    with Server() as server:
        policy = client(server)
        policy.reset(START)
        actions = policy.act(seen())
        assert server.raw[0] == PING
        data = server.questions("get_action")[0]["data"]
    assert set(data) == {"observation", "options"}
    observation = data["observation"]
    assert set(observation) == {"video", "state", "language"}
    assert observation["video"]["front"].shape == (1, 1, 256, 256, 3)
    assert observation["video"]["front"].dtype == np.uint8
    assert observation["state"]["ee_position"].shape == (1, 1, 3)
    assert observation["state"]["ee_position"].dtype == np.float32
    assert observation["language"] == {"annotation.human.action.task_description": [["pack the apple"]]}
    assert actions.shape == (8, 7)
    assert np.all(actions == 0.25)


def test_many_environments_are_asked_about_in_one_question(client):
    def answer(question):
        states = question["data"]["observation"]["state"]["ee_position"]
        return [{n: array(np.tile(states[:, :, 2:], (1, 8, s))) for n, s in ACTIONS.items()}, {}]

    with Server({"get_action": answer}) as server:
        policy = client(server)
        assert isinstance(policy, BatchPolicy)
        actions = policy.act_batch([seen(0), seen(5), seen(2, instruction="bring the mug")])
        data = server.questions("get_action")[0]["data"]["observation"]
    assert data["video"]["wrist"].shape == (3, 1, 256, 256, 3)
    assert data["language"]["annotation.human.action.task_description"][2] == ["bring the mug"]
    assert [a.shape for a in actions] == [(8, 7)] * 3
    assert np.allclose([a[0, 0] for a in actions], [0.30, 0.35, 0.32], atol=1e-6)


def test_the_simulation_wrapper_gets_flat_names(client):
    answer = [{f"action.{n}": array(np.full((1, 4, s), -0.5)) for n, s in ACTIONS.items()}, {}]
    with Server({"get_action": answer[:]}) as server:
        server.script["get_action"] = lambda _: answer
        actions = client(server, f"{QUICK}&layout=flat").act(seen())
        data = server.questions("get_action")[0]["data"]
    assert set(data) == {"observation", "options"}
    assert data["observation"]["video.front"].shape == (1, 1, 256, 256, 3)
    assert data["observation"]["annotation.human.action.task_description"] == ["pack the apple"]
    assert actions.shape == (4, 7)
    assert np.all(actions == -0.5)


def test_a_server_of_n1_5_gets_the_observation_as_the_data(client):
    config = {
        "video": modality(["video.front", "video.wrist"], text=True),
        "state": modality(["state.ee_position", "state.ee_rotation", "state.gripper"], text=True),
        "action": modality([f"action.{n}" for n in ACTIONS], range(16), text=True),
        "language": modality(["annotation.human.coarse_action"], text=True),
    }
    answer = {f"action.{n}": array(np.full((1, 16, s), 0.1)) for n, s in ACTIONS.items()}
    with Server({"get_action": lambda _: answer}, modalities_=config) as server:
        actions = client(server, f"{QUICK}&layout=n1.5").act(seen())
        data = server.questions("get_action")[0]["data"]
    assert data["annotation.human.coarse_action"] == [["pack the apple"]]
    assert data["state.gripper"].shape == (1, 1, 1)
    assert actions.shape == (16, 7)


def test_n1_5_is_recognized_by_its_names_and_reads_whole_instructions(client):
    config = {
        "video": modality(["video.front", "video.wrist"], text=True),
        "state": modality(["state.ee_position", "state.ee_rotation", "state.gripper"], text=True),
        "action": modality([f"action.{n}" for n in ACTIONS], range(16), text=True),
        "language": modality(["annotation.human.coarse_action"], text=True),
    }
    told = []

    def answer(question):
        # N1.5 before c51da90a: the first element of what stands for an environment is its instruction.
        batch = question["data"]["annotation.human.coarse_action"]
        told.extend(entry[0] for entry in batch)
        return {f"action.{n}": array(np.full((len(batch), 16, s), 0.1)) for n, s in ACTIONS.items()}

    with Server({"get_action": answer}, modalities_=config) as server:
        client(server).act_batch([seen(), seen(1, instruction="bring the mug")])
    assert told == ["pack the apple", "bring the mug"]


def test_a_server_of_n1_7_is_asked_as_before_and_its_answers_are_read(client):
    with Server({"get_action": lambda _: N1_7_CHUNK}, modalities_=N1_7_MODALITIES) as server:
        policy = client(server)
        policy.reset(START)
        actions = policy.act(seen())
        data = server.questions("get_action")[0]["data"]["observation"]
    assert policy.modalities.video == ("front", "wrist")
    assert data["video"]["front"].shape == (1, 1, 256, 256, 3)
    assert actions.tolist() == [[0.25, -0.5, 0.0, 0.0, 0.0, 0.125, 1.0]]


def test_a_plain_map_as_modality_config_declares_nothing(client):
    plain = {"video": {"delta_indices": [0], "modality_keys": ["primary"]}, "action": {"modality_keys": ["x"]}}
    with Server(modalities_=plain) as server:
        policy = client(server)
        assert policy.act(seen()).shape == (8, 7)
        assert "does not declare its action conventions" in policy.info.metadata["assumed"]


LIBERO_KEYS = ("x", "y", "z", "roll", "pitch", "yaw", "gripper")


@pytest.mark.parametrize("release", ["n1.5", "n1.6", "n1.7"])
def test_libero_panda_has_each_axis_under_its_own_key(client, release):
    mark = "__ModalityConfig__" if release == "n1.7" else "__ModalityConfig_class__"
    dots = {"video": "video.", "state": "state.", "action": "action."} if release == "n1.5" else {}

    def config(kind, keys, steps=(0,)):
        form = {"delta_indices": list(steps), "modality_keys": [dots.get(kind, "") + key for key in keys]}
        return {mark: True, "as_json": json.dumps(form) if release == "n1.5" else form}

    declared = {
        "video": config("video", ["image", "wrist_image"]),
        "state": config("state", LIBERO_KEYS),
        "action": config("action", LIBERO_KEYS, range(16)),
        "language": config("language", ["annotation.human.action.task_description"]),
    }
    chunk_ = {dots.get("action", "") + key: np.full((1, 16, 1), 0.1 * i) for i, key in enumerate(LIBERO_KEYS)}
    coded = {key: array(value) for key, value in chunk_.items()}
    with Server({"get_action": lambda _: coded if release == "n1.5" else [coded, {}]}, modalities_=declared) as server:
        policy = client(server, f"{QUICK}&preset=gr00t_libero_panda")
        # The tool points down, turned by 0.4 rad about the vertical: a rotation vector, and no roll, pitch and yaw.
        turned = seen(ee_quaternion=np.array([0.0, np.cos(0.2), np.sin(0.2), 0.0]))
        actions = policy.act(turned)
        data = server.questions("get_action")[0]["data"]
    if release == "n1.5":
        state = {key: data[f"state.{key}"] for key in LIBERO_KEYS}
        assert data["annotation.human.action.task_description"] == [["pack the apple"]]
        assert data["video.wrist_image"].shape == (1, 1, 256, 256, 3)
    else:
        state = data["observation"]["state"]
        assert data["observation"]["language"] == {"annotation.human.action.task_description": [["pack the apple"]]}
    assert {key: value.shape for key, value in state.items()} == {
        **dict.fromkeys(LIBERO_KEYS, (1, 1, 1)),
        "gripper": (1, 1, 2),
    }
    told = [float(state[key][0, 0, 0]) for key in LIBERO_KEYS[:6]]
    assert np.allclose(told, [0.4, 0.0, 0.3, np.pi * np.cos(0.2), np.pi * np.sin(0.2), 0.0], atol=1e-6)
    assert np.allclose(state["gripper"][0, 0], [0.025, -0.025])
    assert actions.shape == (16, 7)
    assert np.allclose(actions[0], [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, -1.0])  # 0.6 of open: it opens


@pytest.mark.parametrize("shape", [(1, 16), (1, 16, 1), (16, 1)])
def test_an_axis_may_come_without_the_axis_of_its_number(client, shape):
    coded = {f"action.{key}": array(np.linspace(0, 1, 16).reshape(shape)) for key in LIBERO_KEYS}
    with Server({"get_action": lambda _: coded}, modalities_={}) as server:
        actions = client(server, f"{QUICK}&preset=gr00t_libero_panda&layout=n1.5").act(seen())
    assert np.allclose(actions[:, 0], np.linspace(0, 1, 16))


def test_widowx_gets_angles_from_straight_down_and_answers_meters_at_5_hz(client):
    declared = {
        "video": modality(["image_0"]),
        "state": modality(["x", "y", "z", "roll", "pitch", "yaw", "pad", "gripper"]),
        "action": modality(LIBERO_KEYS, range(8)),
    }
    values = dict(zip(LIBERO_KEYS, (0.02, 0.0, -0.01, 0.0, 0.0, 0.2, 1.0), strict=True))
    answer = [{key: array(np.full((1, 8, 1), value)) for key, value in values.items()}, {}]
    with Server({"get_action": lambda _: answer}, modalities_=declared) as server:
        policy = client(server, f"{QUICK}&preset=gr00t_oxe_widowx")
        actions = policy.act(seen(ee_quaternion=np.array([0.0, np.cos(0.2), np.sin(0.2), 0.0])))
        state = server.questions("get_action")[0]["data"]["observation"]["state"]
    told = [float(state[key][0, 0, 0]) for key in ("x", "roll", "pitch", "yaw", "pad", "gripper")]
    assert np.allclose(told, [0.4, 0.0, 0.0, 0.4, 0.0, 0.05 / 0.08], atol=1e-6)
    assert np.allclose(actions[0], [0.1, 0.0, -0.05, 0.0, 0.0, 0.1, -1.0])  # a quarter of each, in units of ours


def test_oxe_droid_gives_and_gets_joints(client):
    declared = {
        "video": modality(["exterior_image_1_left", "wrist_image_left"]),
        "state": modality(["joint_position", "gripper_position"]),
        "action": modality(["joint_position", "gripper_position"], range(32)),
        "language": modality(["annotation.language.language_instruction"]),
    }
    answer = [{"joint_position": array(np.full((1, 32, 7), 0.3)), "gripper_position": array(np.ones((1, 32, 1)))}, {}]
    images = {name: np.zeros((256, 256, 3), np.uint8) for name in ("left_shoulder", "wrist")}
    with Server({"get_action": lambda _: answer}, modalities_=declared) as server:
        policy = client(server, f"{QUICK}&preset=gr00t_oxe_droid")
        policy.reset(EpisodeStart("pack the apple", 3, "joint_position"))
        actions = policy.act(seen(images=images, joint_positions=np.arange(7) / 10))
        data = server.questions("get_action")[0]["data"]["observation"]
    assert data["video"]["exterior_image_1_left"].shape == (1, 1, 180, 320, 3)
    assert np.allclose(data["state"]["joint_position"], np.arange(7) / 10)
    assert np.allclose(data["state"]["gripper_position"], 1.0 - 0.05 / 0.08)
    assert data["language"] == {"annotation.language.language_instruction": [["pack the apple"]]}
    assert np.allclose(actions, [[0.3] * 7 + [1.0]] * 32)


def test_meters_and_radians_are_scaled_to_our_units(client):
    answer = [
        {
            "ee_position": array(np.full((1, 2, 3), 0.025)),
            "ee_rotation": array(np.full((1, 2, 3), 0.1)),
            "gripper": array(np.ones((1, 2, 1))),
        },
        {},
    ]
    with Server({"get_action": lambda _: answer}) as server:
        actions = client(server, f"{QUICK}&units=physical&gripper=open_positive").act(seen())
    assert np.allclose(actions, [[0.5] * 3 + [0.2] * 3 + [-1.0]] * 2)


def test_what_the_server_declares_is_stored_with_the_run(client):
    with Server() as server:
        info = client(server, f"{QUICK}&horizon=4").info
    assert info.execution == Execution(horizon=4)
    assert info.action_space == "ee_delta"
    assert json.loads(info.metadata["server: modalities"])["video"] == ["front", "wrist"]
    assert "gr00t_new_embodiment" in info.metadata["adapter"]
    assert "assumed" not in info.metadata


def test_a_run_without_the_camera_is_refused_before_it_starts(client):
    with Server() as server:
        policy = client(server)
        policy.check(space="ee_delta", observation=observation_spec("default"), rate_hz=20.0)
        with pytest.raises(HandshakeError, match="front, wrist"):
            policy.check(space="ee_delta", observation=observation_spec("state_only"), rate_hz=20.0)
        with pytest.raises(HandshakeError, match="ee_pose"):
            policy.reset(EpisodeStart("pack", 1, "ee_pose"))


# ---------------------------------------------------------------------------------------------------- several steps


def test_several_time_steps_are_kept_and_begin_with_the_first_frame(client):
    with Server(modalities_=modalities(steps=(-2, -1, 0))) as server:
        policy = client(server, f"{QUICK}&horizon=2")
        assert not isinstance(policy, BatchPolicy)
        for episode in range(2):
            policy.reset(START)
            actions = [policy.act(seen(step, shade=10 * episode + step)) for step in range(5)]
            assert [a.shape for a in actions] == [(1, 7)] * 5
        data = [q["data"]["observation"] for q in server.questions("get_action")]
        assert len(server.questions("reset")) == 2
    shades = [d["video"]["front"][0, :, 0, 0, 0].tolist() for d in data]
    assert shades == [[0, 0, 0], [0, 1, 2], [2, 3, 4], [10, 10, 10], [10, 11, 12], [12, 13, 14]]
    assert data[0]["video"]["front"].shape == (1, 3, 256, 256, 3)
    assert data[0]["state"]["ee_position"].shape == (1, 1, 3)


def test_state_may_have_steps_of_its_own(client):
    declared = modalities(state=modality(["ee_position", "ee_rotation", "gripper"], (-3, 0)))
    declared["state"] = modality(["ee_position", "ee_rotation", "gripper"], (-3, 0))
    with Server(modalities_=declared) as server:
        policy = client(server, f"{QUICK}&horizon=1")
        policy.reset(START)
        for step in range(5):
            policy.act(seen(step))
        last = server.questions("get_action")[-1]["data"]["observation"]
    assert np.allclose(last["state"]["ee_position"][0, :, 2], [0.31, 0.34])
    assert last["video"]["front"].shape[1] == 1


def test_a_server_without_a_word_for_reset_is_no_error(client):
    with Server({"reset": {"error": "Unknown endpoint: reset"}}, modalities_=modalities(steps=(-1, 0))) as server:
        policy = client(server)
        policy.reset(START)
        assert policy.act(seen()).shape == (1, 7)


@pytest.mark.parametrize("option", ["horizon=4&ahead=2", "ensemble=0.01"])
def test_a_policy_with_history_is_not_asked_ahead(client, option):
    with (
        Server(modalities_=modalities(steps=(-1, 0))) as server,
        pytest.raises(InvalidInputError, match="several time steps"),
    ):
        client(server, f"{QUICK}&{option}")


# --------------------------------------------------------------------------------------------------------- handshake


@pytest.mark.parametrize(
    ("declared", "text"),
    [
        (
            modalities(video=("ego_view",)),
            "video: the server wants ego_view, the adapter sends front, wrist",
        ),
        (modalities(video=("front",)), "video: the server wants front, the adapter sends front, wrist"),
        (modalities(state=("joints",)), "state: the server wants joints, the adapter sends ee_position, ee_rotation"),
        (
            modalities(action=modality(["single_arm", "gripper"], range(16))),
            "action: the server answers gripper, single_arm, the adapter reads ee_position, ee_rotation, gripper",
        ),
        (
            modalities(language=modality(["a", "b"])),
            "language: the server needs a, b, the adapter sends one instruction",
        ),
        (modalities(steps=(0, 1)), r"needs video at the steps \[0, 1\]"),
        (modalities(steps=(0, -1)), r"needs video at the steps \[0, -1\]"),
        ({**modalities(), "state": 3}, "contains no modality configs"),
        ([1, 2], "contains no modality configs"),
    ],
)
def test_other_modalities_stop_with_both_sides_named(client, declared, text):
    with Server(modalities_=declared) as server, pytest.raises(HandshakeError, match=text) as caught:
        client(server)
    assert "\n" not in str(caught.value)


def test_a_server_that_declares_nothing_is_taken_at_its_first_answer(client):
    with Server(modalities_={}) as server:
        taken = client(server)
        assert taken.act(seen()).shape == (8, 7)
        assert "does not declare its action conventions" in taken.info.metadata["assumed"]
        assert "assumed" not in client(server, f"{QUICK}&preset=gr00t_new_embodiment").info.metadata


def test_the_instruction_goes_under_the_name_that_the_server_gives_it(client):
    with Server(modalities_=modalities(language=modality(["annotation.human.coarse_action"]))) as server:
        client(server).act(seen())
        observation = server.questions("get_action")[0]["data"]["observation"]
    assert observation["language"] == {"annotation.human.coarse_action": [["pack the apple"]]}


@pytest.mark.parametrize("answer", [b"ERROR", b"PK\x03\x04archive/data.pkl", b"\x80\x02}q\x00."])
def test_servers_that_pickle_are_refused_on_purpose(client, answer):
    with Server({"ping": lambda _: answer}) as server:
        with pytest.raises(HandshakeError, match=r"pickles its messages.* This is not supported"):
            client(server)
        assert len(server.raw) == 1


def test_the_token_comes_from_the_environment(client, monkeypatch):
    word = "open-sesame"
    monkeypatch.setenv("MY_TOKEN", word)
    with Server(token=word) as server:
        with pytest.raises(HandshakeError, match=r"Unauthorized: Invalid API token\. Add api_key_env=NAME"):
            client(server)
        policy = client(server, f"{QUICK}&api_key_env=MY_TOKEN")
        assert policy.act(seen()).shape == (8, 7)
        assert word not in str(policy.info)
        with pytest.raises(InvalidInputError, match="NO_TOKEN contains no key"):
            client(server, f"{QUICK}&api_key_env=NO_TOKEN")


def test_unknown_layouts_are_refused_with_the_closest(client):
    with Server() as server, pytest.raises(UnknownNameError, match="Did you mean 'nested'"):
        client(server, f"{QUICK}&layout=nestd")


# ------------------------------------------------------------------------------------------------------------ faults


def reply(**changes):
    """Return a chunk with some of its arrays changed."""
    return [{**chunk()[0], **{name: array(value) for name, value in changes.items()}}, {}]


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (b"ERROR", "reports an error for get_action without a message"),
        ({"error": "Traceback:\n  File x\nKeyError: 'front'"}, "reports an error: KeyError: 'front'"),
        ({"error": "Video key 'front' must have shape (B, T=2, H, W, C)"}, "must have shape"),
        ({"error": ""}, "reports an error: no message"),
        (CLOSE_NOW, "the reply has no action 'ee_position'. It has: gripper"),
        (reply(gripper=np.zeros((1, 8, 2))), "gripper"),
        (reply(gripper=np.zeros((1, 4, 1))), "different lengths"),
        (reply(gripper=np.zeros((2, 8, 1))), r"shape \(2, 8, 1\)"),
        (reply(gripper=np.zeros((8,))), r"shape \(8,\)"),
        (reply(**{n: np.zeros((1, 0, s)) for n, s in ACTIONS.items()}), "empty chunk"),
        ([{**chunk()[0], "gripper": "closed"}, {}], "'gripper' is not an array of real numbers"),
        ([{**chunk()[0], "gripper": array([[["a"]]], "<U1")}, {}], "'gripper' is not an array of real numbers"),
        ([{}, {}], "the reply has no action"),
        ([{"grip\nper": array(np.zeros((1, 8, 1)))}, {}], "It has: grip per"),
        ([{"x" * 1000: 1}, {}], r"the action 'x{40}….* is not an array"),
        ([None, {}], "expected actions in reply to get_action, got list"),
        ("actions", "expected actions in reply to get_action, got str"),
        (b"", "cannot be read"),
        (b"\xc1 garbage", "cannot be read"),
        (msgpack.packb(chunk())[:-20], "cannot be read"),
        ([{"gripper": {"__ndarray_class__": True, "as_npy": b"\x93NUMPY\x01\x00\xff\xff"}}, {}], "cannot be read"),
        ((b"two", b"frames"), "sent 2 frames instead of one"),
    ],
)
def test_bad_answers_end_the_trial_with_a_reason_and_the_next_one_is_asked(client, answer, text):
    with Server({"get_action": [answer, chunk()]}) as server:
        policy = client(server)
        with pytest.raises(PolicyError, match=text) as caught:
            policy.act(seen())
        assert not isinstance(caught.value, PolicyUnavailableError)
        assert str(caught.value).startswith(policy.server.who)
        assert "\n" not in str(caught.value)
        assert policy.act(seen()).shape == (8, 7)


def test_numbers_that_are_not_finite_arrive_as_such(client):
    with Server({"get_action": reply(gripper=np.full((1, 8, 1), np.nan))}) as server:
        server.script["get_action"] = lambda _: reply(gripper=np.full((1, 8, 1), np.nan))
        assert np.isnan(client(server).act(seen())).any()


def test_an_answer_that_never_comes_costs_one_deadline_and_the_socket(client, caplog):
    with Server({"get_action": [lambda _: None, chunk()]}) as server, caplog.at_level(logging.WARNING):
        policy = client(server, "timeout=0.5&retries=2&patience=5")
        assert policy.act(seen()).shape == (8, 7)
        assert policy.figures["policy_retries"] == 1
        assert len(server.questions("ping")) == 2


def test_a_late_answer_is_not_taken_for_the_next_one(client):
    def late(_):
        time.sleep(0.6)
        return chunk(value=0.75)

    with Server({"get_action": [late, chunk(value=0.25)]}) as server:
        policy = client(server, "timeout=0.3&retries=5&patience=5")
        assert np.all(policy.act(seen()) == 0.25)


def test_answers_that_never_come_end_the_trial_after_the_retries(client):
    with Server({"get_action": lambda _: None}) as server:
        policy = client(server, "timeout=0.3&retries=1&patience=5")
        with pytest.raises(PolicyError, match="failed to answer 2 times"):
            policy.act(seen())
        assert len(server.questions("get_action")) == 2


def test_an_answer_that_is_too_large_is_not_taken(client, monkeypatch):
    monkeypatch.setattr(request_client, "MAX_FRAME_BYTES", 100_000)
    with Server({"get_action": lambda _: b"x" * 200_000}) as server:
        policy = client(server, "timeout=20&retries=0&patience=5")
        with pytest.raises(PolicyError, match="its answer exceeds 100000 bytes"):
            policy.act(seen())


def test_closing_from_another_thread_ends_the_wait(client):
    with Server({"get_action": lambda _: None}) as server:
        policy = client(server, "timeout=60&retries=5&patience=5")
        problems = []

        def ask():
            try:
                policy.act(seen())
            except PolicyError as problem:
                problems.append(problem)

        thread = threading.Thread(target=ask)
        thread.start()
        while not server.questions("get_action"):
            time.sleep(0.01)
        policy.close()
        thread.join(timeout=30.0)
        assert not thread.is_alive()
    assert "the client was closed" in str(problems[0])


def test_a_server_that_comes_back_is_asked_again(client):
    with Server() as server:
        policy = client(server, "timeout=5&retries=3&patience=10")
        port = server.port
        assert policy.act(seen()).shape == (8, 7)
    with Server(port=port) as again:
        assert policy.act(seen()).shape == (8, 7)
        assert policy.figures["policy_reconnects"] == 1
        assert len(again.questions("get_modality_config")) == 1


def test_a_server_that_comes_back_with_other_modalities_stops_the_run(client):
    with Server() as server:
        policy = client(server, "timeout=5&retries=3&patience=10")
        port = server.port
    with (
        Server(port=port, modalities_=modalities(steps=(-1, 0))),
        pytest.raises(HandshakeError, match="changed after a restart:"),
    ):
        policy.act(seen())


def test_a_server_that_is_never_there_is_one_clear_line():
    began = time.monotonic()
    with pytest.raises(PolicyUnavailableError, match=r"gr00t://127.0.0.1:9 could not be reached for 0.2 s"):
        connect_gr00t(read_address("gr00t://127.0.0.1:9?patience=0.2"))
    assert time.monotonic() - began < 30.0


# --------------------------------------------------------------------------------------------------------- whole trials


@pytest.mark.slow
@pytest.mark.physics
@pytest.mark.parametrize("steps", [(0,), (-1, 0)])
def test_trials_are_evaluated_with_and_without_a_memory(tmp_path, steps):
    blind = dataclasses.replace(GR00T_NEW_EMBODIMENT, name="blind", views=())
    file = tmp_path / "blind.json"
    file.write_text(json.dumps(blind.to_json()), encoding="utf-8")
    config = modalities()
    del config["video"]
    config["state"] = modality(["ee_position", "ee_rotation", "gripper"], steps)

    def answer(question):
        return chunk(batch=len(question["data"]["observation"]["state"]["gripper"]), value=0.01)

    with Server({"get_action": answer}, modalities_=config) as server:
        address = f"gr00t://127.0.0.1:{server.port}?{QUICK}&adapter={file}"
        plan = make_plan(
            address, tasks=["morning_coffee"], variations=["T1"], trials=2, observation="state_only", quality="fast"
        )
        plan = dataclasses.replace(plan, trials=tuple(t for t in plan.trials if t.variation == "T1"))
        run = evaluate(plan, tmp_path / "run", envs=2)
        seen_ = [q["data"]["observation"]["state"]["gripper"].shape for q in server.questions("get_action")]
    assert [(entry.status, entry.message) for entry in run.entries()] == [("done", None)] * 2
    for trial in plan.trials:
        record = run.read_record(trial.task, trial.condition, trial.seed)
        assert np.allclose(record.applied[1:], 0.01)
    assert {shape[1:] for shape in seen_} == {(len(steps), 1)}
    assert {shape[0] for shape in seen_} <= ({1, 2} if len(steps) == 1 else {1})


def test_an_action_under_two_names_is_refused():
    twice = [{**chunk()[0], "action.gripper": array(np.zeros((1, 8, 1)))}, {}]
    with Server({"get_action": twice}) as server, contextlib.closing(connect_gr00t(server.address())) as policy:
        policy.reset(START)
        with pytest.raises(PolicyError, match="'gripper' occurs twice"):
            policy.act(seen())


# --------------------------------------------------------------------------------------------------- real-time chunking


class Continuing:
    """Answers as an action head with real-time chunking does: frozen rows stay, the others are new.

    ``keeps`` is False for a policy that ignores what it is sent, as that of NVIDIA's main branch does.
    """

    def __init__(self, *, keeps=True):
        self.keeps, self.count = keeps, 0

    def __call__(self, question):
        self.count += 1
        made = {name: np.zeros((1, 8, size), np.float32) for name, size in ACTIONS.items()}
        for rows in made.values():
            rows[:, :, 0] = self.count + np.arange(8) / 100
        sent, options = question["data"]["observation"].get("action"), question["data"]["options"]
        if sent is not None and self.keeps:
            for name, rows in made.items():
                rows[:, : options["rtc_frozen_steps"]] = sent[name][:, : options["rtc_frozen_steps"]]
        return [{name: array(rows) for name, rows in made.items()}, {}]


RTC = f"{QUICK}&horizon=5&ahead=2&rtc_overlap_steps=3"


def test_a_chunk_continues_the_one_before(client):
    with Server({"get_action": Continuing()}) as server:
        policy = client(server, RTC)
        answers = [policy.act(seen(step)) for step in (0, 3, 9)]  # after six more steps only two rows are left
        policy.reset(START)
        policy.act(seen(0))
        asked = server.questions("get_action")
    data = [question["data"] for question in asked]
    assert [question["options"] for question in data] == [
        None,
        {"action_horizon": 8, "rtc_overlap_steps": 3, "rtc_frozen_steps": 2, "rtc_ramp_rate": 6.0},
        {"action_horizon": 8, "rtc_overlap_steps": 2, "rtc_frozen_steps": 2, "rtc_ramp_rate": 6.0},
        None,
    ]
    assert ["action" in question["observation"] for question in data] == [False, True, True, False]
    sent = data[1]["observation"]["action"]
    assert {name: (rows.shape, rows.dtype.str) for name, rows in sent.items()} == {
        name: ((1, 8, size), "<f4") for name, size in ACTIONS.items()
    }
    assert np.allclose(sent["ee_position"][0, :, 0], [1.03, 1.04, 1.05, 1.06, 1.07, 1.07, 1.07, 1.07])
    # The first actions of a new chunk are those that were to come.
    assert np.allclose(answers[1][:2, 0], answers[0][3:5, 0])
    assert "rtc_overlap_steps=3" in policy.info.name


@pytest.mark.parametrize(("keeps", "told"), [(True, 0), (False, 1)])
def test_a_server_that_ignores_the_rest_is_told_once(client, caplog, keeps, told):
    with Server({"get_action": Continuing(keeps=keeps)}) as server:
        policy = client(server, RTC)
        for step in (0, 3, 6, 9):
            policy.act(seen(step))
    said = [r.getMessage() for r in caplog.records if "does not continue chunks" in r.getMessage()]
    assert len(said) == told
    assert all("main branch ignore rtc_overlap_steps" in text for text in said)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ("rtc_frozen_steps=2", "rtc_frozen_steps has no effect without rtc_overlap_steps"),
        ("rtc_overlap_steps=0", "0 frozen steps do not fit into an overlap of 0 steps"),
        ("rtc_overlap_steps=2&rtc_frozen_steps=3", "3 frozen steps do not fit into an overlap of 2"),
        ("rtc_overlap_steps=2&horizon=8&ahead=3", "3 frozen steps do not fit into an overlap of 2"),
        ("rtc_overlap_steps=2.5", "must be a whole number"),
        ("rtc_overlap_steps=2&layout=flat", "layout=flat have no entry for the previous chunk"),
        ("rtc_overlap_steps=2&ensemble=0.01", "it cannot be combined with the option ensemble"),
    ],
)
def test_what_cannot_be_continued_is_refused(client, options, text):
    with Server() as server, pytest.raises(InvalidInputError, match=text):
        client(server, f"{QUICK}&{options}")


def test_several_time_steps_are_not_continued(client):
    with (
        Server(modalities_=modalities(steps=(-2, 0))) as server,
        pytest.raises(InvalidInputError, match="several time"),
    ):
        client(server, f"{QUICK}&rtc_overlap_steps=2")
