"""Fuzz the wire decoders: any bytes give a value or one PolicyError, in bounded time and memory.

Three kinds of input, drawn from one seed: valid frames with some bytes changed, frames made of msgpack tokens with the
markers of the dialect in hostile places, and random bytes. Run it for long:

    python tests/policies/fuzz_wire.py --minutes 10 --dialect openpi
"""

# ruff: noqa: T201 - a script that talks to a terminal
from __future__ import annotations

import argparse
import struct
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator

import msgpack
import numpy as np

from betterbench.errors import PolicyError
from betterbench.policies.protocols import wire
from betterbench.policies.protocols.wire import ModalityConfig

DECODERS: dict[str, Callable[[bytes], object]] = {
    "openpi": wire.decode_openpi,
    "nd": wire.decode_openpi,
    "vla_eval": wire.decode_vla_eval,
    "gr00t": wire.decode_gr00t,
}
SLOW_S = 5.0
"""A frame of a few kilobytes that takes longer than this has found a way to waste time [s]."""

_PICTURE = np.arange(6 * 5 * 3, dtype=np.uint8).reshape(6, 5, 3)
_VALUE = {
    "actions": np.linspace(-1, 1, 14, dtype=np.float32).reshape(2, 7),
    "state": np.arange(8.0),
    "images": {"front": _PICTURE},
    "flags": np.array([True, False]),
    "fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "empty": np.zeros((0, 7)),
    "nothing": None,
    "list": [1, -2, 2.5, "text", b"bytes", True, [[]], {}],
    "server_timing": {"infer_ms": 3.5},
}
SEEDS: dict[str, tuple[bytes, ...]] = {
    "openpi": (
        wire.encode_openpi({**_VALUE, "scalar": np.float32(0.5), "prompt": np.array("pack it"), "text": np.str_("ab")}),
        wire.encode_openpi({"actions": np.zeros((1, 7))}),
    ),
    "nd": (
        wire.encode_openpi({**_VALUE, "scalar": np.float32(0.5), "prompt": np.array("pack it")}, arrays="nd"),
        msgpack.packb({"actions": {"nd": True, "type": "<f4", "kind": "f", "shape": [1, 2], "data": bytes(8)}}),
    ),
    "vla_eval": tuple(
        wire.encode_vla_eval({"type": "action", "payload": _VALUE, "seq": 3, "timestamp": 1.5}, images=images)
        for images in ("raw", "png", "jpeg")
    ),
    "gr00t": (
        wire.encode_gr00t([{"action.gripper": _VALUE["actions"][None]}, {}]),
        wire.encode_gr00t({**_VALUE, "video": ModalityConfig((-1, 0), ("front", "wrist"))}),
        msgpack.packb({"__ModalityConfig_class__": True, "as_json": '{"delta_indices": [0], "modality_keys": ["a"]}'}),
        msgpack.packb([{"x": {b"nd": True, b"type": "<f4", b"kind": b"", b"shape": [1, 2], b"data": bytes(8)}}, {}]),
        msgpack.packb({"__ModalityConfig__": True, "as_json": {"delta_indices": [0], "modality_keys": ["a"]}}),
    ),
}
_MARKS: dict[str, tuple[str | bytes, ...]] = {
    "openpi": (b"__ndarray__", b"__npgeneric__", b"data", b"dtype", b"shape"),
    "nd": (b"nd", b"type", b"kind", b"shape", b"data", "nd", "type", "kind", "shape", "data", b"complex"),
    "vla_eval": ("__ndarray__", "__image__", "data", "dtype", "shape", "format", "type", "payload"),
    "gr00t": (
        *("__ndarray_class__", "as_npy", "__ModalityConfig_class__", "__ModalityConfig__", "as_json", "delta_indices"),
        *("modality_keys", b"nd", b"type", b"kind", b"shape", b"data"),
    ),
}
_WORDS = (
    "<f4",
    ">f8",
    "|u1",
    "|b1",
    "|O",
    "<U3",
    "|S0",
    "<M8[s]",
    "V8",
    "png",
    "jpeg",
    "raw",
    "f4,i8",
    "(2,)f4",
    "<f16",
)
_NUMBERS = (0, 1, -1, 2, 7, 255, 2**31, 2**40, 2**62, 2**63, 2**64 - 1, -(2**63), 0.5, float("nan"), float("inf"))


def _mutated(draw: np.random.Generator, frame: bytes) -> bytes:
    """Return a frame with some bytes set, inserted, removed, or a piece of it repeated."""
    data = bytearray(frame)
    for _ in range(int(draw.integers(1, 6))):
        at = int(draw.integers(0, len(data) + 1))
        kind = int(draw.integers(0, 6))
        if kind == 0 and at < len(data):
            data[at] ^= 1 << int(draw.integers(0, 8))
        elif kind == 1 and at < len(data):
            data[at] = int(draw.choice([0x00, 0x7F, 0x80, 0x90, 0xC0, 0xC7, 0xD4, 0xDC, 0xDD, 0xDF, 0xFF]))
        elif kind == 2:
            data[at:at] = draw.bytes(int(draw.integers(1, 9)))
        elif kind == 3:
            del data[at : at + int(draw.integers(1, 33))]
        elif kind == 4:
            data[at : at + 4] = struct.pack(">I", int(draw.integers(0, 2**32)))
        else:
            begin = int(draw.integers(0, len(data) + 1))
            data[at:at] = data[begin : begin + int(draw.integers(1, 65))]
    return bytes(data)


def _npy(draw: np.random.Generator) -> bytes:
    """Return bytes that begin as a .npy file and go on as they like."""
    shape = draw.choice(["(2,)", "()", "(2, 3,)", "(-1,)", "(99999999999,)", "[2]", "('a',)", "(" * 60, "1" * 400])
    kind = draw.choice(["'<f4'", "'|O'", "'<U2'", "[('a', '<f4')]", "'V0'", "None", "-" * 300 + "1"])
    order = draw.choice(["False", "True", "None", "7"])
    header = f"{{'descr': {kind}, 'fortran_order': {order}, 'shape': {shape}, }}".encode()
    length = len(header) if draw.random() < 0.7 else int(draw.integers(0, 2**16))
    start = b"\x93NUMPY" + bytes([int(draw.choice([1, 1, 1, 2, 3, 9])), 0]) + struct.pack("<H", length)
    return start + header + draw.bytes(int(draw.integers(0, 33)))


def _thing(draw: np.random.Generator, dialect: str, depth: int) -> object:
    """Return a value made of the dialect's markers, in places where they do not belong."""
    kind = int(draw.integers(0, 10 if depth < 6 else 6))
    if kind == 0:
        return _NUMBERS[int(draw.integers(len(_NUMBERS)))]
    if kind == 1:
        return _WORDS[int(draw.integers(len(_WORDS)))]
    if kind == 2:
        return draw.bytes(int(draw.choice([0, 1, 4, 8, 28, 56])))
    if kind == 3:
        return bool(draw.integers(2)) if draw.random() < 0.7 else None
    if kind == 4:
        return [int(n) for n in draw.choice([0, 1, 2, 7, -1, 2**33], int(draw.integers(0, 5)))]
    if kind == 5:
        return _npy(draw) if dialect == "gr00t" else b"\x89PNG\r\n\x1a\n" + draw.bytes(40)
    if kind == 6:
        return [_thing(draw, dialect, depth + 1) for _ in range(int(draw.integers(0, 4)))]
    marks = _MARKS[dialect]
    chosen = [marks[int(draw.integers(len(marks)))] for _ in range(int(draw.integers(1, 6)))]
    return {key: _thing(draw, dialect, depth + 1) for key in chosen}


def inputs(dialect: str, seed: int) -> Iterator[bytes]:
    """Yield hostile frames without end; the same seed yields the same ones."""
    draw = np.random.default_rng(seed)
    frames = SEEDS[dialect]
    while True:
        kind = draw.random()
        frame = frames[int(draw.integers(len(frames)))]
        if kind < 0.5:
            yield _mutated(draw, frame)
        elif kind < 0.85:
            made = msgpack.packb(_thing(draw, dialect, 0), use_bin_type=True)
            yield made if draw.random() < 0.7 else _mutated(draw, made)
        elif kind < 0.95:
            yield draw.bytes(int(draw.integers(0, 200)))
        else:
            yield frame[: int(draw.integers(0, len(frame) + 1))]


def check(dialect: str, frame: bytes) -> bool:
    """Decode one frame; True if it is a value, False if it is refused as it should be.

    Raises:
        AssertionError: If the error has more than one line.
    """
    try:
        DECODERS[dialect](frame)
    except PolicyError as problem:
        if "\n" in str(problem) or len(str(problem)) > 500:
            raise AssertionError(f"an error in more than one short line: {problem}") from problem
        return False
    return True


def main() -> int:
    """Fuzz until the time is over; the exit status is 1 if something was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--dialect", choices=sorted(DECODERS), default="openpi")
    parser.add_argument("--seed", type=int, default=None, help="default: from the clock; it is printed")
    options = parser.parse_args()
    seed = int(time.time()) if options.seed is None else options.seed
    end, tried, values = time.monotonic() + 60.0 * options.minutes, 0, 0
    warnings.simplefilter("error")
    print(f"fuzzing {options.dialect} for {options.minutes:g} min with seed {seed}")
    for frame in inputs(options.dialect, seed):
        began = time.monotonic()
        if began > end:
            break
        try:
            values += check(options.dialect, frame)
        except BaseException as problem:
            if isinstance(problem, KeyboardInterrupt):
                raise
            print(f"FOUND after {tried} frames: {frame.hex()}")
            traceback.print_exc()
            return 1
        if time.monotonic() - began > SLOW_S:
            print(f"SLOW after {tried} frames, {time.monotonic() - began:.1f} s: {frame.hex()}")
            return 1
        tried += 1
    print(f"{tried} frames, {values} of them values, {tried - values} refused, nothing found")
    return 0


if __name__ == "__main__":
    sys.exit(main())
