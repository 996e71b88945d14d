"""Wire formats: golden bytes, round trips, hostile input."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import itertools
import pickle  # noqa: TID251 - what a stranger might send, written here and never read
import tracemalloc
import zlib
from functools import partial
from pathlib import Path

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from tests.looping import each

from betterbench.errors import InvalidInputError, PolicyError
from betterbench.policies.protocols import wire
from betterbench.policies.protocols.wire import (
    ModalityConfig,
    decode_gr00t,
    decode_openpi,
    decode_vla_eval,
    encode_gr00t,
    encode_openpi,
    encode_vla_eval,
    marks_arrays_as_nd,
)

DIALECTS = {
    "openpi": (encode_openpi, decode_openpi),
    "nd": (partial(encode_openpi, arrays="nd"), decode_openpi),
    "vla_eval": (encode_vla_eval, decode_vla_eval),
    "gr00t": (encode_gr00t, decode_gr00t),
}
EACH = pytest.mark.parametrize("dialect", DIALECTS)
ARRAYS = st.sampled_from(["<f4", "<f8", "<f2", "|u1", "<i8", "|b1", ">f4", ">i2"]).flatmap(
    lambda dtype: arrays(np.dtype(dtype), array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4))
)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)


def fuzzer():
    spec = importlib.util.spec_from_file_location("fuzz_wire", Path(__file__).with_name("fuzz_wire.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def same(a, b):
    if isinstance(a, np.ndarray):
        return (
            isinstance(b, np.ndarray)
            and a.shape == b.shape
            and a.dtype.newbyteorder("=") == b.dtype
            and a.astype(b.dtype).tobytes() == b.tobytes()
        )
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and (a == b or a != a)  # noqa: PLR0124 - NaN


# ------------------------------------------------------------------------------------------------------ golden bytes

VALUE = {"actions": np.array([[0.5, -1.0]], dtype="<f4")}


def test_openpi_marks_arrays_with_byte_keys():
    expected = (
        "81a7616374696f6e7384"
        "c40b5f5f6e6461727261795f5fc3"
        "c40464617461c4080000003f000080bf"
        "c4056474797065a33c6634"
        "c4057368617065920102"
    )
    assert encode_openpi(VALUE).hex() == expected
    assert same(VALUE, decode_openpi(bytes.fromhex(expected)))
    assert encode_openpi({"x": np.float32(0.5)}).hex() == (
        "81a17883c40d5f5f6e7067656e657269635f5fc3c40464617461cb3fe0000000000000c4056474797065a33c6634"
    )


def test_vla_eval_marks_arrays_with_text_keys():
    expected = (
        "81a7616374696f6e7384"
        "ab5f5f6e6461727261795f5fc3"
        "a464617461c4080000003f000080bf"
        "a56474797065a33c6634"
        "a57368617065920102"
    )
    assert encode_vla_eval(VALUE).hex() == expected
    assert same(VALUE, decode_vla_eval(bytes.fromhex(expected)))


def test_gr00t_sends_npy_files():
    frame = encode_gr00t(VALUE)
    form = msgpack.unpackb(frame)["actions"]
    assert form["__ndarray_class__"] is True
    assert form["as_npy"].startswith(b"\x93NUMPY\x01\x00")
    assert same(VALUE["actions"], np.load(io.BytesIO(form["as_npy"]), allow_pickle=False))
    assert same(VALUE, decode_gr00t(frame))
    columns = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    assert decode_gr00t(encode_gr00t(columns)).tolist() == columns.tolist()


@pytest.mark.parametrize("as_text", [False, True])
def test_gr00t_modality_configs_are_read_as_maps_and_as_json_texts(as_text):
    form = '{"delta_indices": [-1, 0], "modality_keys": ["front"]}'
    said = form if as_text else {"delta_indices": [-1, 0], "modality_keys": ["front"], "more": 1}
    frame = msgpack.packb({"video": {"__ModalityConfig_class__": True, "as_json": said}})
    assert decode_gr00t(frame) == {"video": ModalityConfig((-1, 0), ("front",))}
    assert decode_gr00t(encode_gr00t(ModalityConfig((-1, 0), ("front",)))) == ModalityConfig((-1, 0), ("front",))


# [{"gripper": float32 array of shape (1, 1, 2) as msgpack-numpy writes it}], and the same with a pickle in it: bytes as
# N1.7 answers, put together from the facts and not by the code under test.
N1_7_ARRAY = bytes.fromhex(
    "9181a76772697070657285c4026e64c3c40474797065a33c6634c4046b696e64c400c405736861706593010102c40464617461c408"
    "0000803e000000bf"
)
N1_7_PICKLE = bytes.fromhex(
    "9281a76772697070657285c4026e64c3c40474797065a27c4fc4046b696e64c4014fc405736861706593010101c40464617461c405"
    "80044b012e80"
)


def test_gr00t_n1_7_writes_arrays_as_msgpack_numpy_does():
    (reply,) = decode_gr00t(N1_7_ARRAY)
    assert same(np.array([[[0.25, -0.5]]], "<f4"), reply["gripper"])
    assert not reply["gripper"].flags.writeable
    number = msgpack.packb({b"nd": False, b"type": "<f8", b"data": np.float64(0.5).tobytes()})
    assert same(np.float64(0.5), decode_gr00t(number))
    frame = msgpack.packb(
        {"video": {"__ModalityConfig__": True, "as_json": {"delta_indices": [0], "modality_keys": ["a"]}}}
    )
    assert decode_gr00t(frame) == {"video": ModalityConfig((0,), ("a",))}


def test_gr00t_n1_7_pickles_are_refused_unread():
    with pytest.raises(PolicyError, match="kind b'O', not plain numbers: it contains pickles"):
        decode_gr00t(N1_7_PICKLE)


ND_READERS = pytest.mark.parametrize("decode", [decode_gr00t, decode_openpi])


@ND_READERS
@each(
    "change",
    [
        {b"kind": b"O"},
        {b"kind": b"V", b"type": [["a", "<f4"]]},
        {b"kind": "O"},
        {b"kind": [b"O"]},
        {b"kind": b"i"},
        {b"kind": b"c", b"type": "<c8"},
        {b"type": "|O"},
        {b"type": "O"},
        {b"type": b"<f4"},
        {b"complex": True, b"type": "<c8"},
        {b"data": b"123"},
        {b"data": "1234"},
        {b"shape": [2]},
        {b"shape": None},
        {b"nd": False, b"shape": [1], b"data": b"12345678"},
        {b"nd": 1},
    ],
)
@each("keys", [bytes, str])
def test_nd_arrays_that_are_no_plain_numbers_are_refused(decode, change, keys):
    form = {b"nd": True, b"type": "<f4", b"kind": b"", b"shape": [1], b"data": b"1234", **change}
    if keys is str:
        form = {name.decode(): value for name, value in form.items()}
        if form["nd"] == 1 and form["nd"] is not True:
            return  # a map of somebody's own
    with pytest.raises(PolicyError, match="cannot be read") as caught:
        decode(msgpack.packb([{"gripper": form}]))
    assert "\n" not in str(caught.value)


@ND_READERS
def test_nd_arrays_are_read_with_either_kind_of_keys(decode):
    whole = np.array([[0.25, -0.5]], "<f4")
    form = {"nd": True, "type": "<f4", "kind": "", "shape": [1, 2], "data": whole.tobytes()}
    for kind in ("", b"", "f", b"f", None):  # None: left out
        text = {name: value for name, value in (form | {"kind": kind}).items() if value is not None}
        for marked in (text, {name.encode(): value for name, value in text.items()}):
            found = decode(msgpack.packb({"a": marked}))["a"]
            assert same(whole, found)
            assert not found.flags.writeable
    number = {"nd": False, "type": "<f8", "data": np.float64(0.5).tobytes()}
    assert same(np.float64(0.5), decode(msgpack.packb(number)))


@ND_READERS
@pytest.mark.parametrize("own", [{"nd": 3}, {"nd": True, "type": "x"}, {"nd": "a", "type": "b", "data": "c"}])
def test_a_map_with_an_entry_nd_is_a_map(decode, own):
    assert decode(msgpack.packb(own)) == own


def test_what_msgpack_numpy_pickles_is_named():
    # msgpack-numpy 0.4.8: an array with the dtype [("a", "<i4"), ("b", "<f4")].
    structured = bytes.fromhex(
        "85c4026e64c3c404747970659292a161a33c693492a162a33c6634c4046b696e64c40156c40573686170659101c40464617461c4080100"
        "000000000040"
    )
    with pytest.raises(PolicyError, match="kind b'V', not plain numbers"):
        decode_openpi(structured)


def test_the_dialect_of_a_frame_is_found():
    value = {"a": [{"b": np.arange(3)}], "n": 1}
    assert marks_arrays_as_nd(encode_openpi(value, arrays="nd"))
    assert marks_arrays_as_nd(encode_openpi({"a": np.float32(0.5)}, arrays="nd"))
    assert not marks_arrays_as_nd(encode_openpi(value))
    assert not marks_arrays_as_nd(encode_openpi({"a": "nd"}, arrays="nd"))


# ------------------------------------------------------------------------------------------------------- round trips


@given(value=st.dictionaries(st.text(max_size=8), ARRAYS | PLAIN, max_size=4))
@settings(max_examples=40, deadline=None)
def test_values_come_back_as_they_were(value):
    marked = {"__ndarray__", "__image__", "__ndarray_class__", "__ModalityConfig_class__", "__ModalityConfig__", "nd"}
    if not marked & set(map(str, value)):
        for dialect, (encode, decode) in DIALECTS.items():
            assert same(value, decode(encode(value))), dialect


@EACH
def test_numpy_scalars_travel(dialect):
    encode, decode = DIALECTS[dialect]
    back = decode(encode({"a": np.float32(0.5), "b": np.int64(-3), "c": np.bool_(True)}))
    assert back == {"a": 0.5, "b": -3, "c": True}


def test_texts_in_arrays_travel_in_openpi():
    back = decode_openpi(encode_openpi({"prompt": np.array("pack it"), "s": np.str_("ä")}))
    assert back["prompt"].item() == "pack it"
    assert back["s"] == "ä"


@pytest.mark.parametrize(("images", "largest"), [("png", 0), ("jpeg", 12)])
def test_images_are_compressed_without_and_with_loss(images, largest):
    x, y = np.meshgrid(np.arange(64), np.arange(48))
    image = np.stack([3 * x, 4 * y, 128 + 0 * x], axis=2).astype(np.uint8)
    frame = encode_vla_eval({"a": image, "b": image[:, :, :2]}, images=images)
    back = decode_vla_eval(frame)
    assert back["a"].shape == image.shape
    assert np.abs(back["a"].astype(int) - image).max() <= largest
    assert same(np.ascontiguousarray(image[:, :, :2]), back["b"])
    assert len(frame) < len(encode_vla_eval({"a": image, "b": image[:, :, :2]}))


@EACH
@each(
    "value",
    [object(), {"a": np.array([object()])}, {"a": 1 + 2j}, {"a": np.zeros(2, complex)}, 2**70, {"a": {1, 2}}],
)
def test_what_has_no_form_on_the_wire_is_not_sent(dialect, value):
    with pytest.raises(InvalidInputError, match="cannot be sent"):
        DIALECTS[dialect][0](value)


# ----------------------------------------------------------------------------------------------------- hostile input


def openpi_array(change):
    return msgpack.packb({"a": {b"__ndarray__": True, b"data": b"\x00" * 8, b"dtype": "<f4", b"shape": [2]} | change})


def test_arrays_that_lie_are_refused():
    for change, text in [
        ({b"shape": [3]}, "8 bytes do not match"),
        ({b"shape": [1]}, "8 bytes do not match"),
        ({b"shape": [2**32, 2**32]}, "do not match"),
        ({b"shape": [-2]}, "not a list of integers"),
        ({b"shape": [2.0]}, "not a list of integers"),
        ({b"shape": [True, 2]}, "not a list of integers"),
        ({b"shape": [1] * 17}, "no shape"),
        ({b"shape": None}, "no shape"),
        ({b"shape": [0, 2**39, 2**39], b"data": b""}, "cannot be read"),
        ({b"dtype": "|O"}, "not a plain number"),
        ({b"dtype": "O8"}, "not a plain number"),
        ({b"dtype": "<M8[s]"}, "not a plain number"),
        ({b"dtype": "<c8"}, "not a plain number"),
        ({b"dtype": "|V8"}, "not a plain number"),
        ({b"dtype": "f4,f4"}, "not a plain number"),
        ({b"dtype": "<f4\n"}, "not a plain number"),
        ({b"dtype": 3}, "not a plain number"),
        ({b"dtype": "<U0"}, "do not match"),
        ({b"dtype": "<U2", b"data": b"\xff" * 8, b"shape": [1]}, "a string in an array has invalid characters"),
        ({b"data": "text"}, "expected array data as bytes, got str"),
        ({b"data": None}, "expected array data as bytes, got NoneType"),
    ]:
        with pytest.raises(PolicyError, match=text):
            decode_openpi(openpi_array(change))


def npy(header, data=b"\x00" * 8, version=1):
    return b"\x93NUMPY" + bytes([version, 0]) + len(header).to_bytes(2, "little") + header + data


def test_npy_bytes_that_lie_are_refused_and_never_unpickled():
    for data in [
        b"",
        b"\x93NUMPY",
        b"\x93NUMPY\x01\x00",
        npy(b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }", pickle.dumps(print)),
        npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999,), }"),
        npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }", version=3),
        npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (02,), }"),
        npy(b"{'descr': '<f4', 'fortran_order': False, 'shape': (1,,2), }"),
        npy(b"{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (2,), }"),
        npy(b"(" * 4000),
        npy(b"-" * 4000 + b"1"),
        npy(b" " * 5000),
        npy(b"__import__('os').system('true')"),
        pickle.dumps({"a": 1}),
        b"PK\x03\x04" + b"\x00" * 60,
    ]:
        with pytest.raises(PolicyError, match=r"GR00T frame .* cannot be read"):
            decode_gr00t(msgpack.packb({"__ndarray_class__": True, "as_npy": data}))


def png(width, height):
    """Return a PNG that claims any size; its pixels are zeros, compressed a thousandfold."""

    def chunk(name, data):
        return len(data).to_bytes(4, "big") + name + data + zlib.crc32(name + data).to_bytes(4, "big")

    head = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 2, 0, 0, 0])
    rows = zlib.compress(b"\x00" * min(height * (3 * width + 1), 3_000_000))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def test_images_that_lie_are_refused_before_they_are_decompressed():
    for data, shape, coding, text in [
        (png(60_000, 60_000), [60_000, 60_000, 3], "png", "expected an image of shape"),
        (png(60_000, 60_000), [8, 8, 3], "png", "cannot be read"),
        (png(12_000, 12_000), [8, 8, 3], "png", "cannot be read"),
        (png(6_000, 6_000), [8, 8, 3], "png", r"its file is \(6000, 6000\) in mode RGB"),
        (png(8, 8), [8, 9, 3], "png", r"its file is \(8, 8\)"),
        (png(8, 8), [8, 8, 4], "png", "its file is .* in mode RGB"),
        (png(8, 8), [8, 8, 3], "jpeg", "cannot be read"),
        (png(8, 8), [8, 8, 3], "tiff", "got 'tiff'"),
        (png(8, 8), [8, 8], "png", "expected an image of shape"),
        (png(8, 8), None, "png", "no shape"),
        (png(8, 8)[:40], [8, 8, 3], "png", "cannot be read"),
        (b"GIF89a" + b"\x00" * 50, [8, 8, 3], "png", "cannot be read"),
        ("text", [8, 8, 3], "png", "as str"),
    ]:
        frame = msgpack.packb({"__image__": True, "format": coding, "data": data, "shape": shape})
        tracemalloc.start()
        with pytest.raises(PolicyError, match=f"vla-eval frame .*{text}"):
            decode_vla_eval(frame)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 20_000_000


def test_an_honest_image_of_that_make_is_read():
    frame = msgpack.packb({"__image__": True, "format": "png", "data": png(8, 6), "shape": [6, 8, 3]})
    assert decode_vla_eval(frame).shape == (6, 8, 3)


@EACH
@each(
    "frame, text",
    [
        (b"", "is incomplete"),
        (b"\x93\x01", "is incomplete"),
        (b"\xc4\xff", "is incomplete"),
        (b"\x01\x02", "has extra bytes"),
        (b"\xc1", "forbidden byte"),
        (msgpack.packb(msgpack.Timestamp(1, 2)), "extension"),
        (msgpack.packb(msgpack.ExtType(5, b"x")), "extension"),
        (b"\x91" * 100 + b"\xc0", "nested deeper"),
        (b"\x91" * 100_000 + b"\xc0", "nested deeper"),
        (b"\xdd\xff\xff\xff\xff", "is incomplete"),
        (b"\xdd\x00\x04\x00\x00" + b"\x90" * 0x40000, "more than 200000 values"),
        (b"\xa1\xff", "cannot be read"),
        (b"\x81\x01\x02", "cannot be read"),
        (b"\x81\x90\x02", "cannot be read"),
        (pickle.dumps({"a": 1}), "cannot be read"),
    ],
)
def test_frames_that_lie_are_one_clear_line(dialect, frame, text):
    with pytest.raises(PolicyError, match=text) as caught:
        DIALECTS[dialect][1](frame)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_frame_that_is_too_large_is_not_read(monkeypatch):
    monkeypatch.setattr(wire, "MAX_FRAME_BYTES", 100)
    with pytest.raises(PolicyError, match="larger than 100 bytes"):
        decode_openpi(encode_openpi({"a": b"\x00" * 200}))


def test_many_small_values_cannot_fill_the_memory():
    frame = b"\xdd\x00\x20\x00\x00" + b"\x90" * 0x200000
    tracemalloc.start()
    with pytest.raises(PolicyError, match="more than"):
        decode_openpi(frame)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1_000_000


@given(frame=st.binary(max_size=300))
@settings(max_examples=200, deadline=None)
def test_any_bytes_are_a_value_or_a_policy_error(frame):
    for _, decode in DIALECTS.values():
        with contextlib.suppress(PolicyError):
            decode(frame)


@EACH
def test_mutations_of_valid_frames_are_values_or_policy_errors(dialect):
    module = fuzzer()
    seen = [module.check(dialect, frame) for frame in itertools.islice(module.inputs(dialect, 11), 2000)]
    assert all(module.check(dialect, frame) for frame in module.SEEDS[dialect])
    assert 50 < sum(seen) < 1950  # both outcomes are met


@EACH
def test_a_key_that_stands_twice_is_refused(dialect):
    """Readers take one or the other, and nobody would learn which actions were played."""
    packer = msgpack.Packer()
    frame = packer.pack_map_header(2) + b"".join(packer.pack(x) for x in ("actions", [0.1], "actions", [0.9]))
    with pytest.raises(PolicyError, match="actions: is given twice"):
        DIALECTS[dialect][1](frame)


def test_an_array_may_name_its_type_in_words():
    """``float32`` in place of ``<f4``, as servers of vla-evaluation-harness may write."""
    packed = msgpack.packb({"a": {"__ndarray__": True, "data": b"\0\0\x80?", "dtype": "float32", "shape": [1]}})
    assert decode_vla_eval(packed)["a"].tolist() == [1.0]
    with pytest.raises(PolicyError, match="object"):
        decode_vla_eval(packed.replace(b"float32", b"object_"))
