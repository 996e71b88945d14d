"""Frames: what is sent arrives bit for bit, and nothing that is no frame is read."""

import json
import socket
import struct

import numpy as np
import pytest

from betterbench.worlds.frames import FrameError, receive_frame, send_frame


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
    send_frame(ours, {"step": 3, "text": "größer"}, {"a": array, "b": array})
    document, arrays = receive_frame(theirs)
    assert document == {"step": 3, "text": "größer"}
    for found in arrays.values():
        assert found.shape == array.shape
        np.testing.assert_array_equal(found, array)
        assert found.astype(array.dtype).tobytes() == np.ascontiguousarray(array).tobytes()


def _frame(head, body=b"", lengths=None):
    text = head if isinstance(head, bytes) else json.dumps(head).encode()
    return struct.pack(">IQ", *(lengths or (len(text), len(body)))) + text + body


@pytest.mark.parametrize(
    "data",
    [
        b"Warning: something that a library prints",
        b"",
        _frame(b"{no json", b""),
        _frame([1, 2]),
        _frame({"document": [], "arrays": {}}),
        _frame({"document": {}, "arrays": {"a": ["|O8", [1]]}}, b"12345678"),
        _frame({"document": {}, "arrays": {"a": ["<f8", [-1]]}}, b"12345678"),
        _frame({"document": {}, "arrays": {"a": ["<f8", [2]]}}, b"12345678"),
        _frame({"document": {}, "arrays": {"a": ["<f8", [1]]}}, b"1234567890"),
        _frame({"document": {}, "arrays": {"a": ["<f8", [True]]}}, b"12345678"),
        _frame({"document": {}, "arrays": {}}, lengths=(1 << 30, 0)),
    ],
)
def test_what_is_no_frame_is_refused(link, data):
    ours, theirs = link
    ours.sendall(data)
    ours.shutdown(socket.SHUT_WR)
    with pytest.raises(FrameError):
        receive_frame(theirs)


def test_waiting_for_a_frame_ends(link):
    _, theirs = link
    theirs.settimeout(0.05)
    with pytest.raises(FrameError, match="in time"):
        receive_frame(theirs)
