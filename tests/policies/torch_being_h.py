"""The client of Being-H's servers against an independent one, which saves and loads with torch as theirs does.

Run by ``test_with_torch.py`` in an environment that has torch; pytest does not collect this file by itself.
"""

from __future__ import annotations

import contextlib
import io
import os
import threading
import zipfile

import numpy as np
import pytest
import torch
import zmq

from betterbench.errors import HandshakeError, MissingDependencyError, PolicyError
from betterbench.interface import EpisodeStart, Observation
from betterbench.policies.kinds import make_policy
from betterbench.policies.protocols import torch_payload
from betterbench.policies.protocols.torch_payload import read_torch, write_torch

START = EpisodeStart("pack the apple", 3, "ee_delta")
SIZES = {"action.eef_position": 3, "action.eef_rotation": 3, "action.gripper_position": 1}
RAN = []


def mark(*_):
    RAN.append(True)


class Evil:
    """Calls something when it is unpickled."""

    def __init__(self, call, *arguments):
        self.call, self.arguments = call, arguments

    def __reduce__(self):
        return self.call, self.arguments


def saved(value):
    buffer = io.BytesIO()
    torch.save(value, buffer)
    return buffer.getvalue()


class Server:
    """Unpickles questions and pickles answers by torch, as the description says."""

    def __init__(self, script=(), *, token=None):
        self.script, self.token, self.asked = list(script), token, []
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self.port = self._socket.bind_to_random_port("tcp://127.0.0.1")
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

    def _serve(self):
        while not self._stop.is_set():
            if not self._socket.poll(20):
                continue
            sender, empty, frame = self._socket.recv_multipart()
            question = torch.load(io.BytesIO(frame), weights_only=False)
            answer = self._answer(question)
            self._socket.send_multipart([sender, empty, answer if isinstance(answer, bytes) else saved(answer)])

    def _answer(self, question):
        if self.token is not None and question.get("api_token") != self.token:
            return {"error": "Unauthorized: Invalid API token"}
        if question["endpoint"] == "ping":
            return {"status": "ok", "message": "Server is running"}
        self.asked.append(question["data"])
        return self.script.pop(0) if self.script else chunk()


def chunk(make=lambda value: value.tolist(), **more):
    return {**{name: make(np.full((1, 16, size), 0.5)) for name, size in SIZES.items()}, **more}


def seen(step=0):
    return Observation(
        instruction="pack the apple",
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


@contextlib.contextmanager
def connected(server, options="timeout=10&retries=0&patience=2"):
    with contextlib.closing(make_policy(f"being-h://127.0.0.1:{server.port}?{options}")) as client:
        client.reset(START)
        yield client


@pytest.mark.parametrize(
    "make",
    [
        lambda value: value.tolist(),
        lambda value: value[0].tolist(),
        lambda value: value.astype(np.float32),
        lambda value: np.asfortranarray(value.astype(np.float32)[0]),
        lambda value: value.astype(">f8"),
        lambda value: torch.from_numpy(value).to(torch.bfloat16),
        lambda value: [[np.float32(x) for x in row] for row in value[0]],
    ],
)
def test_an_observation_goes_out_and_a_chunk_comes_back(make):
    with Server([chunk(make)]) as server, connected(server) as client:
        actions = client.act(seen())
        assert "does not declare its action conventions" in client.info.metadata["assumed"]
    assert actions.shape == (16, 7)
    assert np.all(actions == 0.5)
    asked = server.asked[0]
    assert asked["video.top_view"].shape == (1, 256, 256, 3)
    assert asked["video.top_view"].dtype == np.uint8
    assert np.all(asked["video.top_view"] == 7)
    assert asked["state.eef_position"].dtype == np.float32
    assert asked["language.instruction"] == ["pack the apple"]
    assert "prev_chunk" not in asked


def test_arrays_keep_their_order():
    values = np.arange(12.0).reshape(3, 4)
    for array in (values, np.asfortranarray(values), values.astype(">i4"), values > 5, values[:0]):
        assert np.array_equal(read_torch(saved({"a": array}))["a"], array)


def test_real_time_chunking_sends_what_is_left_of_the_last_chunk():
    unified = np.arange(16.0)[:, None] + np.zeros((1, 200))
    script = [chunk(action_unified=(unified + 100 * n).tolist()) for n in range(5)]
    script[2] = chunk(action_unified=(unified + 200)[None].astype(np.float32))
    with Server(script) as server, connected(server, "timeout=10&horizon=8&ahead=2") as client:
        for step in (0, 6, 12, 20, 35):
            client.act(seen(step))
        client.reset(START)
        client.act(seen())
    first, second, third, fourth, fifth, sixth = server.asked
    assert "prev_chunk" not in first
    assert second["inference_delay"] == 2
    assert second["prev_chunk"].dtype == np.float32
    assert second["prev_chunk"][:, 0].tolist() == [*range(6, 16), *[15] * 6], "as of the step that begins now"
    assert third["prev_chunk"][:2, 0].tolist() == [106, 107]
    assert fourth["prev_chunk"].shape == (1, 16, 200)
    assert fourth["prev_chunk"][0, :2, 0].tolist() == [208, 209]
    assert "prev_chunk" not in fifth, "one row is left, and two are needed"
    assert "prev_chunk" not in sixth


@pytest.mark.parametrize("options", ["timeout=10", "timeout=10&horizon=8"])
def test_without_a_delay_nothing_is_continued(options):
    """Being-H's servers send their chunks as lists, unasked, and break when they get one back."""
    script = [chunk(action_unified=[[1.0] * 200] * 16)] * 3
    with Server(script) as server, connected(server, options) as client:
        for step in (0, 8, 16):
            client.act(seen(step))
    assert not any("prev_chunk" in asked for asked in server.asked)


def test_the_last_chunk_of_an_episode_is_forgotten():
    script = [chunk(action_unified=[[1.0] * 200] * 16)]
    with Server(script) as server, connected(server, "timeout=10&delay=4") as client:
        client.act(seen())
        client.reset(START)
        client.act(seen())
    assert "prev_chunk" not in server.asked[1]


@pytest.mark.parametrize("unified", ["far", [1.0, 2.0], [[1.0], [2.0, 3.0]], []])
def test_what_is_no_whole_chunk_is_one_clear_line(unified):
    with (
        Server([chunk(action_unified=unified)]) as server,
        connected(server) as client,
        pytest.raises(PolicyError, match="expected action_unified as numbers"),
    ):
        client.act(seen())


def evil_answers(path):
    return {
        "runs a command": Evil(os.system, f"touch {path}"),
        "writes a file": Evil(open, str(path), "w"),
        "evaluates": Evil(eval, f"open({str(path)!r}, 'w')"),
        "calls our own code": Evil(mark, 1),
        "within a chunk": {**chunk(), "action.eef_position": Evil(os.system, f"touch {path}")},
        "as a key": {Evil(os.system, f"touch {path}"): 1},
        "an object of its own": Server.__new__(Server),
        "an array of objects": {"action.eef_position": np.array([{}], dtype=object)},
        "a record array": {"action.eef_position": np.zeros(2, dtype=[("a", "f4"), ("b", "O")])},
        "a date": {"action.eef_position": np.array(["2026-01-01"], dtype="datetime64[D]")},
    }


@pytest.mark.parametrize("name", list(evil_answers("x")))
def test_what_an_answer_names_is_never_called(name, tmp_path):
    path = tmp_path / "ran"
    evil = saved(evil_answers(path)[name])
    RAN.clear()
    with Server([evil, chunk()]) as server, connected(server) as client:
        with pytest.raises(PolicyError, match="cannot be read") as caught:
            client.act(seen())
        assert "\n" not in str(caught.value)
        assert client.act(seen()).shape == (16, 7)
    assert not path.exists()
    assert not RAN


def test_the_same_answer_would_run_if_it_were_unpickled(tmp_path):
    path = tmp_path / "ran"
    torch.load(io.BytesIO(saved(Evil(os.system, f"touch {path}"))), weights_only=False)
    assert path.exists()


def test_the_name_of_what_was_refused_is_told():
    with pytest.raises(PolicyError, match=r"the file would call (posix|os)\.system, which is not allowed"):
        read_torch(saved(Evil(os.system, "true")))


def rezipped(data, change):
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        change(old, new)
    return out.getvalue()


def compressed(old, new):
    for entry in old.infolist():
        new.writestr(entry.filename, old.read(entry), zipfile.ZIP_DEFLATED)


def hoarding(old, new):
    for entry in old.infolist():
        data = old.read(entry)
        if entry.filename.endswith("data.pkl"):
            data = b"\x80\x02cbuiltins\nbytearray\nq\x00\x8a\x05\x00\x00\x00\x00\x10\x85R."
        new.writestr(entry.filename, data)


def laughing():
    layer = [0.5] * 100
    for _ in range(8):
        layer = [layer] * 100
    return saved({"action.eef_position": layer})


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "not a zip archive"),
        (b"PK\x03\x04 nothing", "cannot be read"),
        (b"\x80\x02}q\x00.", "not a zip archive"),
        (saved(chunk())[:-100], "cannot be read"),
        (rezipped(saved(chunk()), compressed), "the file is compressed"),
        (rezipped(saved(chunk()), hoarding), "the file contains a bytearray"),
        (laughing(), "more than 200000 values"),
        (saved({1: 2}), "keys that are not strings"),
        (saved({"a": torch.zeros(1).expand(10**9)}), "too large"),
        (saved({"a": torch.zeros(1).expand(10**7)}), "larger than its storage"),
        (saved({"a": torch.zeros(3, 3).to_sparse()}), "sparse"),
        (saved({"a": {1, 2}}), "the file contains a set"),
        (saved({"a": np.array(["text"])}), "not a plain number"),
    ],
)
def test_broken_and_hostile_payloads_give_one_clear_error(data, text):
    with pytest.raises(PolicyError, match=text) as caught:
        read_torch(data)
    assert "\n" not in str(caught.value)


def test_mutated_payloads_give_values_or_one_clear_error():
    draw = np.random.default_rng(7)
    good = saved(chunk(lambda value: value.astype(np.float32), note="fine", n=3))
    refused = 0
    for _ in range(400):
        data = bytearray(good)
        for at in draw.integers(0, len(data), draw.integers(1, 6)):
            data[at] = draw.integers(0, 256)
        try:
            read_torch(bytes(data))
        except PolicyError:
            refused += 1
    assert refused > 20


def test_what_is_allowed_while_reading_is_not_left_allowed():
    before = list(torch.serialization.get_safe_globals())
    read_torch(saved(chunk(lambda value: value)))
    assert set(torch.serialization.get_safe_globals()) == set(before)


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        ({"error": "Traceback\nKeyError: 'video.top_view'"}, "reports an error: KeyError: 'video.top_view'"),
        (b"ERROR", "reports an error for .* without a message"),
        ([1, 2], "in reply to get_action, got list"),
        ({}, "the reply has no 'action.eef_position'"),
        (chunk(lambda value: value[..., :0].tolist()), "action.eef_position"),
        (chunk(lambda value: value[:, :0]), "empty chunk|has shape"),
    ],
)
def test_bad_answers_end_the_trial_with_a_reason(answer, text):
    with Server([answer]) as server, connected(server) as client:
        with pytest.raises(PolicyError, match=text):
            client.act(seen())
        assert client.act(seen()).shape == (16, 7)


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (saved({"status": "x" * 5_000_000}), "bytes, but the limit is 4194304 bytes"),
        (saved({"status": [[[[[[[[[[[[[[[[[["x"]]]]]]]]]]]]]]]]]]}), "nested deeper than 16"),
    ],
)
def test_a_greeting_too_large_or_too_deep_is_one_line(answer, text, monkeypatch):
    monkeypatch.setattr(Server, "_answer", lambda *_: answer)
    with Server() as server, pytest.raises(HandshakeError, match=text), connected(server):
        pass


def test_the_token_is_shown(monkeypatch):
    word = "open-sesame"
    monkeypatch.setenv("MY_TOKEN", word)
    with Server(token=word) as server:
        with pytest.raises(HandshakeError, match="Unauthorized"), connected(server):
            pass
        with connected(server, "timeout=10&api_key_env=MY_TOKEN") as client:
            assert client.act(seen()).shape == (16, 7)


def test_an_old_torch_is_refused(monkeypatch):
    monkeypatch.setattr(torch, "__version__", "2.9.1+cpu")
    with pytest.raises(MissingDependencyError, match=r"needs PyTorch 2.10 or newer .*2.9.1"):
        torch_payload.import_torch()
    with pytest.raises(MissingDependencyError):
        write_torch({})
