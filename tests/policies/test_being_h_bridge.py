"""The bridge beside a Being-H policy, driven by our client of openpi's protocol."""

from __future__ import annotations

import ast
import contextlib
import json
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from websockets.sync.client import connect as connect_raw

from betterbench.errors import HandshakeError, PolicyError
from betterbench.interface import EpisodeStart, Observation
from betterbench.policies.clients.bridges import being_h_bridge
from betterbench.policies.conventions.presets import BEING_H_LIBERO
from betterbench.policies.kinds import make_policy

START = EpisodeStart("pack the apple", 3, "ee_delta")
SIZES = {"action.eef_position": 3, "action.eef_rotation": 3, "action.gripper_position": 1}


class Fake:
    """Answers as Being-H does, nested lists included, and remembers what it was asked."""

    def __init__(self, *, unified=False):
        self.asked, self.unified = [], unified

    def get_action(self, observation):
        self.asked.append(observation)
        if observation["language.instruction"] == ["fail"]:
            raise KeyError("video.top_view")
        answer = {name: np.full((1, 16, size), 0.5).tolist() for name, size in SIZES.items()}
        if self.unified:
            answer["action_unified"] = (np.full((16, 200), 100.0 * len(self.asked)) + np.arange(16.0)[:, None]).tolist()
        return answer


@pytest.fixture
def bridged():
    """Serve a policy, and return where."""
    with contextlib.ExitStack() as stack:

        def start(policy, **options):
            server = being_h_bridge.Bridge(policy, **options).listen("127.0.0.1", 0)
            thread = threading.Thread(target=server.serve_forever)
            thread.start()
            stack.callback(thread.join)
            stack.callback(server.shutdown)
            return server.socket.getsockname()[1]

        yield start


def seen(step=0, instruction="pack the apple"):
    return Observation(
        instruction=instruction,
        step=step,
        images={name: np.full((256, 256, 3), 7, np.uint8) for name in ("front", "wrist")},
        joint_positions=np.zeros(7),
        joint_velocities=np.zeros(7),
        ee_position=np.array([0.4, 0.0, 0.3]),
        ee_quaternion=np.array([0.0, 1.0, 0.0, 0.0]),
        gripper_width=0.05,
        depth={},
        masks={},
    )


def address(port, options="preset=being_h_libero&timeout=5&retries=0&patience=2"):
    return f"openpi://127.0.0.1:{port}?{options}"


def test_a_chunk_comes_through_the_bridge(bridged):
    policy = Fake()
    with contextlib.closing(make_policy(address(bridged(policy)))) as client:
        client.reset(START)
        actions = client.act(seen())
        assert client.last_reply["server_timing"]["infer_ms"] >= 0.0
    assert actions.shape == (16, 7)
    assert np.all(actions == 0.5)
    asked = policy.asked[0]
    assert asked["video.top_view"].shape == (1, 256, 256, 3)
    assert asked["video.top_view"].dtype == np.uint8
    assert asked["video.top_view"].flags.writeable
    assert asked["state.libero_gripper_position"].tolist() == [[np.float32(0.025), np.float32(-0.025)]]
    assert asked["language.instruction"] == ["pack the apple"]
    assert "prev_chunk" not in asked


def test_the_policys_own_fault_is_told_and_the_next_question_is_answered(bridged):
    with contextlib.closing(make_policy(address(bridged(Fake())))) as client:
        with pytest.raises(PolicyError, match=r"reports an error: KeyError: 'video.top_view'"):
            client.act(seen(instruction="fail"))
        assert client.act(seen()).shape == (16, 7)


@pytest.mark.parametrize("how", [{"dtype": "int64", "scalar": True}, {}])
def test_a_chunk_is_continued_within_an_episode_and_not_beyond(bridged, tmp_path, how):
    form = BEING_H_LIBERO.to_json()
    form["states"].append({"key": "better/step", "parts": ["step"]} | how)
    file = tmp_path / "with_step.json"
    file.write_text(json.dumps(form), encoding="utf-8")
    policy = Fake(unified=True)
    options = f"adapter={file}&timeout=5&retries=0&patience=2"
    with contextlib.closing(make_policy(address(bridged(policy, inference_delay=3), options))) as client:
        for step in (0, 12, 25, 41, 54, 0, 12):
            client.act(seen(step))
    # 13 steps later the last three rows are left, 16 steps later none, and step 0 is a new episode.
    first_rows = [asked["prev_chunk"][:4, 0].tolist() if "prev_chunk" in asked else None for asked in policy.asked]
    assert first_rows == [
        None,
        [112.0, 113.0, 114.0, 115.0],
        [213.0, 214.0, 215.0, 215.0],
        None,
        [413.0, 414.0, 415.0, 415.0],
        None,
        [612.0, 613.0, 614.0, 615.0],
    ]
    assert policy.asked[1]["inference_delay"] == 3
    assert policy.asked[1]["prev_chunk"].shape == (16, 200)
    assert policy.asked[1]["prev_chunk"].dtype == np.float32
    assert "better/step" not in policy.asked[1]


def test_clients_that_do_not_say_where_they_are_get_no_continuation_and_that_is_told_once(bridged, caplog):
    policy = Fake(unified=True)
    with contextlib.closing(make_policy(address(bridged(policy, inference_delay=3)))) as client:
        for step in (0, 12):
            client.act(seen(step))
    assert not any("prev_chunk" in asked for asked in policy.asked)
    assert caplog.text.count("does not send its step number") == 1


def test_tensors_are_sent_as_arrays(bridged):
    class Tensor:
        def __init__(self, array):
            self.array = array

        def detach(self):
            return self

        float = cpu = detach

        def numpy(self):
            return self.array

    class Torchy(Fake):
        def get_action(self, observation):
            return {k: Tensor(np.asarray(v, np.float32)) for k, v in super().get_action(observation).items()}

    with contextlib.closing(make_policy(address(bridged(Torchy())))) as client:
        assert client.act(seen()).shape == (16, 7)


def test_a_key_is_asked_for(bridged, monkeypatch):
    word = "open-sesame"
    port = bridged(Fake(), api_key=word)
    with pytest.raises(HandshakeError, match="rejects this client"):
        make_policy(address(port))
    monkeypatch.setenv("BRIDGE_KEY", word)
    with contextlib.closing(make_policy(f"{address(port)}&api_key_env=BRIDGE_KEY")) as client:
        assert client.act(seen()).shape == (16, 7)
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/healthz") as answer:
        assert answer.read() == b"OK\n"


@pytest.mark.parametrize(
    "frame",
    [
        b"",
        b"\xc1",
        b"\x93\x01\x02\x03",
        b"\x81\xa1x\x84\xc4\x0b__ndarray__\xc3\xc4\x04data\xc4\x01\x00\xc4\x05dtype\xa1O\xc4\x05shape\x91\x01",
        "text",
    ],
)
def test_garbage_gets_an_error_and_harms_nobody(bridged, frame):
    port = bridged(Fake())
    with connect_raw(f"ws://127.0.0.1:{port}", compression=None) as raw:
        assert being_h_bridge.decode(raw.recv())["policy"] == "Fake"
        raw.send(frame)
        assert "Traceback" in raw.recv()
    with contextlib.closing(make_policy(address(port))) as client:
        assert client.act(seen()).shape == (16, 7)


def test_it_is_one_file_that_needs_three_packages():
    tree = ast.parse(Path(being_h_bridge.__file__).read_text(encoding="utf-8"))
    named = {n.names[0].name.partition(".")[0] for n in ast.walk(tree) if isinstance(n, ast.Import)}
    named |= {(n.module or "").partition(".")[0] for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert named - set(sys.stdlib_module_names) == {"websockets", "msgpack", "numpy"}


def test_it_serves_what_a_file_beside_it_makes(tmp_path):
    copy = tmp_path / "being_h_bridge.py"
    copy.write_bytes(Path(being_h_bridge.__file__).read_bytes())
    (tmp_path / "mine.py").write_text(
        "class Mine:\n"
        "    def get_action(self, observation):\n"
        f"        return {{name: [[0.25] * size] * 4 for name, size in {SIZES!r}.items()}}\n"
        "def make():\n    return Mine()\n",
        encoding="utf-8",
    )
    with subprocess.Popen(
        [sys.executable, "-I", copy, "mine:make", "--port", "0"], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    ) as served:
        try:
            assert served.stderr is not None
            line = served.stderr.readline()
            assert "serving mine:make on ws://127.0.0.1:" in line
            with contextlib.closing(make_policy(address(int(line.rpartition(":")[2])))) as client:
                assert np.all(client.act(seen()) == 0.25)
        finally:
            served.terminate()
            served.communicate(timeout=30)
