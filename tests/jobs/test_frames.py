"""Frames: what is sent arrives bit for bit, and nothing that is no frame is read."""

import json
import socket
import struct
import threading

import numpy as np
import pytest

from betterbench.jobs.frames import FrameEndError, FrameError, FrameTimeoutError, receive_frame, send_frame


@pytest.fixture
def link():
    ours, theirs = socket.socketpair()
    ours.settimeout(5.0)
    theirs.settimeout(5.0)
    with ours, theirs:
        yield ours, theirs


@pytest.mark.parametrize(
    "array",
    [
        np.zeros(0),
        np.array(2.5),
        np.arange(24.0).reshape(2, 3, 4)[::-1, :, ::-1],
        np.array([[True, False]]),
        np.arange(3, dtype=">i4"),
        np.full((5, 5, 3), 200, np.uint8),
        np.array([-0.0, np.inf, np.nan]),
    ],
)
def test_an_array_arrives_as_it_was_sent(link, array):
    ours, theirs = link
    send_frame(ours, {"step": 3, "text": "größer"}, {"a": array, "b": array}, number=7)
    number, document, arrays = receive_frame(theirs)
    assert number == 7
    assert document == {"step": 3, "text": "größer"}
    for found in arrays.values():
        assert found.shape == array.shape
        np.testing.assert_array_equal(found, array)
        assert found.astype(array.dtype).tobytes() == np.ascontiguousarray(array).tobytes()


@pytest.mark.parametrize(
    "documents",
    [
        [{"look": True}, {"look": 1}, {"look": 1.0}, {"look": "1"}, {"look": None}],
        [{"a": [1]}, {"a": [1]}, {"a": {"b": 1}}, {}],
        [{"do": "step", "look": False}] * 3,
    ],
)
def test_documents_that_are_alike_are_told_apart_and_belong_to_who_receives_them(link, documents):
    ours, theirs = link
    for sent in documents + documents[::-1]:
        send_frame(ours, sent, {})
        _, document, _ = receive_frame(theirs)
        assert json.dumps(document) == json.dumps(sent)
        for value in document.values():
            if isinstance(value, list):
                value.append("mine")
        document["look"] = "changed"


def _frame(document, forms=b"{}", body=b"", lengths=None):
    head, names = (text if isinstance(text, bytes) else json.dumps(text).encode() for text in (document, forms))
    return struct.pack(">IIQQ", *(lengths or (len(head), len(names), len(body))), 0) + head + names + body


@pytest.mark.parametrize(
    "data",
    [
        b"Warning: something that a library prints",
        b"",
        b"short",
        _frame(b"{no json"),
        _frame(b"\xff"),
        _frame({}, b"{no json"),
        _frame([1, 2]),
        _frame({}, [1, 2]),
        _frame({}, {"a": 1}),
        _frame({}, {"a": ["|O8", [1]]}, b"12345678"),
        _frame({}, {"a": [1, [1]]}, b"12345678"),
        _frame({}, {"a": ["<f8", [-1]]}, b"12345678"),
        _frame({}, {"a": ["<f8", [2]]}, b"12345678"),
        _frame({}, {"a": ["<f8", [1]]}, b"1234567890"),
        _frame({}, {"a": ["<f8", [True]]}, b"12345678"),
        _frame({}, {"a": ["<f8", 1]}, b"12345678"),
        _frame({}, {"a": ["<f8", [0, 1 << 70]]}),
        _frame({}, {"a": ["<f8", [1 << 40, 0, 1 << 40]]}),
        _frame({}, lengths=(1 << 30, 0, 0)),
        _frame({}, lengths=(0, 0, 1 << 40)),
        _frame({}, {"a": ["<U3", [1]]}, b"a\0\0\0" * 3),
        _frame({}, {"a": ["<f2", [1]]}, b"12"),
    ],
)
def test_what_is_no_frame_is_refused(link, data):
    ours, theirs = link
    ours.sendall(data)
    ours.shutdown(socket.SHUT_WR)
    with pytest.raises(FrameError):
        receive_frame(theirs)


def test_the_form_of_a_frame_may_change_at_any_time(link):
    ours, theirs = link
    for step, length in enumerate([3, 3, 0, 5, 3]):
        forces = np.arange(float(length))
        send_frame(ours, {"step": step}, {"forces": forces, "holds": np.array([True]), "qpos": np.arange(2.0)})
        _, document, arrays = receive_frame(theirs)
        assert document == {"step": step}
        assert {name: array.tolist() for name, array in arrays.items()} == {
            "forces": forces.tolist(),
            "holds": [True],
            "qpos": [0.0, 1.0],
        }


def test_a_large_frame_comes_in_many_pieces(link):
    ours, theirs = link
    image = np.random.default_rng(0).integers(0, 256, (256, 256, 3), np.uint8)
    sender = threading.Thread(target=send_frame, args=(ours, {}, {"image": image}))
    sender.start()
    assert receive_frame(theirs)[2]["image"].tobytes() == image.tobytes()
    sender.join()


def test_waiting_for_a_frame_ends(link):
    _, theirs = link
    theirs.settimeout(0.05)
    with pytest.raises(FrameTimeoutError, match="in time"):
        receive_frame(theirs)


def test_the_end_of_the_other_side_is_told_apart(link):
    ours, theirs = link
    ours.sendall(b"short")
    ours.close()
    with pytest.raises(FrameEndError, match="has ended"):
        receive_frame(theirs)


@pytest.mark.parametrize(
    "array",
    [
        np.array(["wörd", "no"]),
        np.array(1 + 2j),
        np.arange(3, dtype=">f2"),
        np.array([object(), None]),
        np.zeros((0, 3)),
    ],
    ids=lambda array: array.dtype.str,
)
def test_arrays_of_all_types_are_read_where_that_is_wanted(link, array):
    ours, theirs = link
    send_frame(ours, {}, {"a": array, "b": np.arange(2.0)})
    found = receive_frame(theirs, any_type=True)[2]
    assert found["a"].shape == array.shape
    assert found["b"].tolist() == [0.0, 1.0]
    if array.dtype.hasobject:
        assert not found["a"].astype(bool).any()
    else:
        assert found["a"].tolist() == array.tolist()


@pytest.mark.parametrize(
    "forms",
    [
        {"a": ["<f8", [-1]]},
        {"a": ["<f8", [1 << 40]]},
        {"a": ["<f8", [1] * 33]},
        {"a": ["f" * 41, [1]]},
        {"a": ["<f8", [2]]},
        {"a": ["<U0", [1 << 40]]},
        {"a": ["|O", [1 << 40]]},
        {"a": ["nonsense", [1]]},
        {"a": ["(1,", [1]]},
    ],
)
def test_forms_of_all_types_are_bounded(link, forms):
    ours, theirs = link
    ours.sendall(_frame({}, forms, bytes(8)))
    with pytest.raises(FrameError):
        receive_frame(theirs, any_type=True)
