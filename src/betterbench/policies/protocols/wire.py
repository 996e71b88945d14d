"""Encoding and decoding of messages in the variants of msgpack that policy servers use.

In all variants, a message is a map of strings, numbers and arrays, but arrays are encoded in different ways: as in
openpi's client, as in vla-evaluation-harness, as .npy files (GR00T up to N1.6), or as in the package msgpack-numpy. The
last variant, ``nd``, is used by GR00T N1.7 and by some servers with openpi's protocol.

Received messages are not trusted. For any bytes, the decoders return a value or raise a :class:`PolicyError`, and they
need at most a few times as much memory as the size of the message. The nesting depth and the number of values are
checked before decoding. The number of bytes of an array must match its type and shape. The size of an image is checked
before the image is decompressed.
"""

from __future__ import annotations

import io
import json
import math
import re
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import msgpack
import numpy as np

from betterbench.errors import InvalidInputError, PolicyError
from betterbench.json_form import unique_keys

MAX_FRAME_BYTES = 256 * 1024 * 1024
"""Maximum size of a message [bytes]. It corresponds to about 1,300 images of 256 x 256 pixels."""

MAX_VALUES = 200_000
"""Maximum number of values in a message. An array counts as one value."""

MAX_DEPTH = 32
"""Maximum nesting depth of lists and maps in a message."""

MAX_DECLARED_BYTES = 4 * 1024 * 1024
"""Maximum size of the declaration that a server sends in the handshake [bytes].

A declaration with the normalization statistics of many data sets takes about 100 kB.
"""

MAX_DECLARED_DEPTH = 16
"""Maximum nesting depth of lists and maps in a declaration."""

MAX_PIXELS = 4096 * 4096
"""Maximum number of pixels of a compressed image."""

_MAX_AXES = 16
_MAX_LENGTH = 2**40
_MAX_NPY_HEADER = 4096
_SIDE = "(?:0|[1-9][0-9]{0,12})"
_NPY_HEADER = re.compile(
    r"\{'descr': '([<>=|]?[a-zA-Z][0-9]{1,6})', 'fortran_order': (True|False), "
    rf"'shape': \((|{_SIDE},|{_SIDE}(?:, ?{_SIDE})+,?)\), ?\}} *\n?".encode()
)
_MAX_JSON = 1_000_000
_NUMBERS = re.compile(r"[<>=|]?(b1|[iu][1248]|f[248])", re.ASCII)
_TEXTS = re.compile(r"[<>=|]?[SU][0-9]{1,6}", re.ASCII)
_NAMES = {
    np.dtype(code).name: np.dtype(code).str
    for code in ("b1", *(f"{k}{n}" for k in "iu" for n in "1248"), *("f2", "f4", "f8"))
}
"""NumPy type code, such as "<f4", by type name, such as "float32". Some servers send names instead of codes."""

_PLAIN_KINDS = ("", *"biufSU")

_UNREADABLE = (
    InvalidInputError,
    *(ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError, MemoryError, EOFError),
    *(OSError, SyntaxError, struct.error, zlib.error, msgpack.UnpackException),
)
"""Exceptions that may occur while a malformed message is decoded."""

OpenpiArrays = Literal["openpi", "nd"]
"""Encoding of arrays in an openpi request: as in openpi's own client, or as in the package msgpack-numpy."""

ImageCoding = Literal["raw", "png", "jpeg"]
"""Encoding of uint8 images in vla-eval's protocol: uncompressed, PNG (lossless) or JPEG (lossy)."""


@dataclass(frozen=True, slots=True)
class ModalityConfig:
    """Configuration of a modality of a GR00T server: time steps and names of its inputs or outputs."""

    delta_indices: tuple[int, ...]
    modality_keys: tuple[str, ...]


# ---------------------------------------------------------------------------------------------------------- openpi


def encode_openpi(value: object, *, arrays: OpenpiArrays = "openpi") -> bytes:
    """Encode a value as a message of openpi's protocol.

    The value may contain dicts, lists, strings, bytes, numbers, None, and NumPy arrays of numbers, booleans or strings.
    ``arrays`` selects the encoding of arrays. Raises InvalidInputError for values of other types.
    """
    return _encode(value, _mark_openpi if arrays == "openpi" else _mark_nd)


def decode_openpi(data: bytes) -> Any:  # noqa: ANN401 - a frame may hold anything
    """Decode a message of openpi's protocol. Arrays in the result are read-only.

    Arrays may be encoded as in openpi's client or as in msgpack-numpy. Raises PolicyError if the message is malformed.
    """
    return _decode(data, "openpi", _read_openpi)


def marks_arrays_as_nd(data: bytes) -> bool:
    """Return whether a message contains arrays or numbers in the format of msgpack-numpy.

    Raises PolicyError if the message is malformed.
    """
    found: list[bool] = []

    def note(form: dict[Any, Any]) -> object:
        found.append(_is_nd(form))
        return _read_openpi(form)

    _decode(data, "openpi", note)
    return any(found)


def _mark_openpi(thing: object) -> object:
    if isinstance(thing, np.ndarray):
        array = _plain(thing)
        return {b"__ndarray__": True, b"data": array.tobytes(), b"dtype": array.dtype.str, b"shape": array.shape}
    if isinstance(thing, np.generic):
        _plain(np.asarray(thing))
        return {b"__npgeneric__": True, b"data": thing.item(), b"dtype": thing.dtype.str}
    return _refuse(thing)


def _read_openpi(form: dict[Any, Any]) -> object:
    if b"__ndarray__" in form:
        return read_array(form.get(b"data"), form.get(b"dtype"), form.get(b"shape"))
    if b"__npgeneric__" in form:
        value = form.get(b"data")
        dtype = _dtype(form.get(b"dtype"))
        if not isinstance(value, (bool, int, float, str, bytes)):
            raise ValueError(f"expected a number or string as scalar, got {type(value).__name__}")
        with np.errstate(over="ignore"):  # a number that is too large for the type becomes infinite
            return dtype.type(value)
    return _read_nd(form) if _is_nd(form) else form


# --------------------------------------------------------------------------------------------------- msgpack-numpy


def _mark_nd(thing: object) -> object:
    if isinstance(thing, (np.ndarray, np.generic)):
        array = _plain(np.asarray(thing))
        form = {b"nd": isinstance(thing, np.ndarray), b"type": array.dtype.str, b"data": array.tobytes()}
        return form | {b"kind": b"", b"shape": array.shape} if form[b"nd"] else form
    return _refuse(thing)


def _is_nd(form: Mapping[Any, Any]) -> bool:
    """Return whether a map represents an array or a number in the format of msgpack-numpy.

    msgpack-numpy uses bytes as keys, but some servers use strings. String keys may also occur in other maps, so more
    keys are checked in this case.
    """
    return b"nd" in form or (isinstance(form.get("nd"), bool) and "type" in form and "data" in form)


def _read_nd(form: Mapping[Any, Any]) -> object:
    """Decode an array or a number in the format of msgpack-numpy. The keys of the map may be bytes or strings.

    msgpack-numpy leaves the entry ``kind`` of an array empty, but other implementations set it to the kind of the NumPy
    dtype, such as "f".
    """
    whole = {name: form.get(name.encode(), form.get(name)) for name in ("nd", "type", "kind", "shape", "data")}
    kind = b"" if whole["kind"] is None else whole["kind"]
    letter = kind.decode("latin-1") if isinstance(kind, bytes) else kind
    if not isinstance(letter, str) or letter not in _PLAIN_KINDS or b"complex" in form or "complex" in form:
        pickled = ": it contains pickles, and unpickling untrusted data can run code"
        raise ValueError(f"an array has the kind {str(kind)[:20]}, not plain numbers{pickled if letter == 'O' else ''}")
    if not isinstance(whole["nd"], bool):
        raise TypeError(f"expected a boolean as the array's nd, got {type(whole['nd']).__name__}")
    array = read_array(whole["data"], whole["type"], whole["shape"] if whole["nd"] else ())
    if letter not in ("", array.dtype.kind):
        raise ValueError(f"an array of type {array.dtype.str} is declared as kind {letter!r}")
    return array if whole["nd"] else array[()]


# -------------------------------------------------------------------------------------------------------- vla-eval


def encode_vla_eval(value: object, *, images: ImageCoding = "raw") -> bytes:
    """Encode a value as a message of vla-evaluation-harness.

    ``images`` selects the encoding of images, which are arrays (height, width, 3 or 4) uint8. Raises InvalidInputError
    for values that :func:`encode_openpi` does not accept, and for arrays of strings.
    """

    def mark(thing: object) -> object:
        if (
            images != "raw"
            and isinstance(thing, np.ndarray)
            and is_image(thing, channels=(3,) if images == "jpeg" else (3, 4))
        ):
            return _compressed(thing, images)
        return _mark_vla_eval(thing)

    return _encode(value, mark)


def decode_vla_eval(data: bytes) -> Any:  # noqa: ANN401 - a frame may hold anything
    """Decode a message of vla-evaluation-harness. Raises PolicyError if it is malformed."""
    return _decode(data, "vla-eval", _read_vla_eval)


def _mark_vla_eval(thing: object) -> object:
    if isinstance(thing, np.ndarray):
        array = _plain(thing, texts=False)
        return {"__ndarray__": True, "data": array.tobytes(), "dtype": array.dtype.str, "shape": list(array.shape)}
    if isinstance(thing, (np.bool_, np.integer, np.floating)):
        return thing.item()
    return _refuse(thing)


def _read_vla_eval(form: dict[Any, Any]) -> object:
    if "__image__" in form and form.get("format") != "raw":
        return _image(form)
    if "__image__" in form or "__ndarray__" in form:
        return read_array(form.get("data"), form.get("dtype"), form.get("shape"), texts=False)
    return form


def is_image(array: np.ndarray, *, channels: tuple[int, ...] = (3,)) -> bool:
    """Return whether an array has the type and shape of an image: (height, width, channels) uint8."""
    return array.ndim == 3 and array.dtype == np.uint8 and array.shape[2] in channels and array.size > 0


def _compressed(array: np.ndarray, images: ImageCoding) -> dict[str, object]:
    data = png_of(array) if images == "png" else _file_of(array, "JPEG", quality=95)
    return {"__image__": True, "format": images, "data": data, "shape": list(array.shape)}


def png_of(image: np.ndarray) -> bytes:
    """Encode an image (height, width, 3 or 4) uint8 as a PNG file."""
    # With compression level 1, encoding a 256 x 256 image takes 2 ms instead of 10 ms, but the file is 10 % larger.
    return _file_of(image, "PNG", compress_level=1)


def _file_of(image: np.ndarray, coding: str, **options: int) -> bytes:
    from PIL import Image  # noqa: PLC0415 - Pillow is needed only for compressed images

    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(buffer, coding, **options)
    return buffer.getvalue()


def _image(form: dict[Any, Any]) -> np.ndarray:
    data, coding, shape = form.get("data"), form.get("format"), _shape(form.get("shape"))
    if coding not in ("png", "jpeg") or not isinstance(data, bytes):
        raise ValueError(f"expected an image as png or jpeg bytes, got {str(coding)[:20]!r} as {type(data).__name__}")
    if len(shape) != 3 or shape[2] not in (1, 3, 4) or not 0 < shape[0] * shape[1] <= MAX_PIXELS:
        raise ValueError(f"expected an image of shape (height, width, 1, 3 or 4), got {shape}")
    from PIL import Image  # noqa: PLC0415 - see _file_of

    try:
        with Image.open(io.BytesIO(data), formats=[coding.upper()]) as image:
            expected = {1: "L", 3: "RGB", 4: "RGBA"}[shape[2]]
            if image.size != (shape[1], shape[0]) or image.mode != expected:
                raise ValueError(
                    f"an image is declared as {shape}, but its file is {image.size[::-1]} in mode {image.mode}"
                )
            array = np.asarray(image).reshape(shape)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as bomb:
        raise ValueError(str(bomb)) from bomb
    array.flags.writeable = False
    return array


# ----------------------------------------------------------------------------------------------------------- GR00T


def encode_gr00t(value: object) -> bytes:
    """Encode a value as a message for a GR00T server.

    In addition to the types that :func:`encode_openpi` accepts, the value may contain :class:`ModalityConfig` objects.
    Raises InvalidInputError for values of other types.
    """
    return _encode(value, _mark_gr00t)


def decode_gr00t(data: bytes) -> Any:  # noqa: ANN401 - a frame may hold anything
    """Decode a message of GR00T N1.5, N1.6 or N1.7. Raises PolicyError if it is malformed."""
    return _decode(data, "GR00T", _read_gr00t)


def _mark_gr00t(thing: object) -> object:
    if isinstance(thing, np.ndarray):
        buffer = io.BytesIO()
        np.lib.format.write_array(buffer, _plain(thing), version=(1, 0), allow_pickle=False)
        return {"__ndarray_class__": True, "as_npy": buffer.getvalue()}
    if isinstance(thing, (np.bool_, np.integer, np.floating, np.str_)):
        return thing.item()
    if isinstance(thing, ModalityConfig):
        form = {"delta_indices": list(thing.delta_indices), "modality_keys": list(thing.modality_keys)}
        return {"__ModalityConfig_class__": True, "as_json": form}
    return _refuse(thing)


def _read_gr00t(form: dict[Any, Any]) -> object:
    if "__ndarray_class__" in form:
        return _npy(form.get("as_npy"))
    if "__ModalityConfig_class__" in form or "__ModalityConfig__" in form:  # keys of N1.5 and N1.6, and of N1.7
        return _modality(form.get("as_json"))
    return _read_nd(form) if _is_nd(form) else form  # array format of N1.7


def _npy(data: object) -> np.ndarray:
    """Decode an array from the bytes of a .npy file.

    ``numpy.load`` parses the header as Python code. This function matches it with a regular expression instead, and
    never unpickles objects.
    """
    if not isinstance(data, bytes):
        raise TypeError(f"expected a .npy file as bytes, got {type(data).__name__}")
    width = {b"\x93NUMPY\x01\x00": 2, b"\x93NUMPY\x02\x00": 4}.get(data[:8])
    if width is None:
        raise ValueError("an array is not a .npy file of version 1 or 2")
    begin = 8 + width
    end = begin + int.from_bytes(data[8:begin], "little")
    found = _NPY_HEADER.fullmatch(data[begin:end]) if end - begin <= _MAX_NPY_HEADER else None
    if found is None:
        raise ValueError("the header of a .npy file is not in NumPy's own format")
    dtype, fortran, sides = (part.decode("ascii") for part in found.groups())
    shape = tuple(int(side) for side in sides.split(",") if side.strip())
    array = read_array(data[end:], dtype, shape[::-1] if fortran == "True" else shape)
    return array.transpose() if fortran == "True" else array


def _modality(form: object) -> ModalityConfig:
    if isinstance(form, str):  # N1.5 sends JSON text, N1.6 sends a map
        if len(form) > _MAX_JSON:
            raise ValueError("a modality config is too long")
        form = json.loads(form, object_pairs_hook=unique_keys)
    if not isinstance(form, Mapping):
        raise TypeError(f"expected a modality config as a map, got {type(form).__name__}")
    steps, keys = form.get("delta_indices"), form.get("modality_keys")
    if not isinstance(steps, (list, tuple)) or not all(isinstance(s, int) and abs(s) < 10_000 for s in steps):
        raise ValueError("delta_indices of a modality config must be a list of integers")
    if not isinstance(keys, (list, tuple)) or not all(isinstance(k, str) for k in keys):
        raise ValueError("modality_keys of a modality config must be a list of strings")
    return ModalityConfig(tuple(int(s) for s in steps), tuple(keys))


# ----------------------------------------------------------------------------------------------------- common parts


def _encode(value: object, mark: Callable[[object], object]) -> bytes:
    try:
        return bytes(msgpack.packb(value, default=mark, use_bin_type=True))
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInputError(
            "message", f"the message cannot be sent ({error})", "Send strings, numbers and arrays"
        ) from error


def _refuse(thing: object) -> object:
    raise TypeError(f"a {type(thing).__name__} cannot be encoded")


def _plain(array: np.ndarray, *, texts: bool = True) -> np.ndarray:
    """Return the array in C order. Raises TypeError if its dtype cannot be encoded."""
    too_long = array.dtype.kind == "f" and array.dtype.itemsize > 8
    if too_long or array.dtype.kind not in ("biufSU" if texts else "biuf"):
        raise TypeError(f"an array of {array.dtype} cannot be encoded")
    return np.ascontiguousarray(array).reshape(array.shape)


def _decode(data: bytes, dialect: str, hook: Callable[[dict[Any, Any]], object]) -> object:
    try:
        _survey(data)
        # strict_map_key allows only str and bytes as keys. With other keys, a malicious server could send many keys
        # with equal hashes, and building the dict would take quadratic time.
        return msgpack.unpackb(
            data,
            object_pairs_hook=lambda pairs: hook(unique_keys(pairs)),
            raw=False,
            strict_map_key=True,
            ext_hook=_no_extension,
        )
    except _UNREADABLE as error:
        problem = " ".join(str(error).split())[:200] or type(error).__name__
        raise PolicyError(
            f"{dialect} frame of {len(data)} bytes cannot be read ({problem}). "
            "Check that both sides use the same protocol."
        ) from error


def require_depth(value: object, most: int) -> None:
    """Raise ValueError if the lists and maps in a decoded value are nested deeper than ``most`` levels."""
    level = [value]
    for _ in range(most + 1):
        holders = [v for v in level if isinstance(v, (list, tuple, Mapping))]
        if not holders:
            return
        level = [inner for held in holders for inner in (held.values() if isinstance(held, Mapping) else held)]
    raise ValueError(f"the value is nested deeper than {most} levels")


def _no_extension(code: int, data: bytes) -> object:
    raise ValueError(f"an extension of type {code} with {len(data)} bytes is not supported")


# msgpack tokens, by first byte. _FIXED: number of bytes that follow the first byte. _SIZED: number of bytes of the
# length field of a string or bytes object. _HOLDERS: for lists and maps, number of bytes of the count field, and number
# of values per counted item (1 for lists, 2 for maps).
_FIXED = dict(
    zip(b"\xc0\xc2\xc3\xca\xcb\xcc\xcd\xce\xcf\xd0\xd1\xd2\xd3", b"\0\0\0\4\x08\1\2\4\x08\1\2\4\x08", strict=True)
)
_SIZED = {0xC4: 1, 0xC5: 2, 0xC6: 4, 0xD9: 1, 0xDA: 2, 0xDB: 4}
_HOLDERS = {0xDC: (2, 1), 0xDD: (4, 1), 0xDE: (2, 2), 0xDF: (4, 2)}


def _survey(data: bytes) -> None:
    """Check the structure of a message before it is decoded.

    An empty list takes one byte in a message but 56 bytes in memory, and nested lists use stack space. The number of
    values and the nesting depth are therefore checked before the decoder allocates memory.

    Raises:
        ValueError: If the message is incomplete, has extra bytes, is nested too deeply, has too many values, or
            contains an extension type of msgpack.
    """
    at, values, end = 0, 0, len(data)
    if end > MAX_FRAME_BYTES:
        raise ValueError(f"the message is larger than {MAX_FRAME_BYTES} bytes")
    left = [1]  # number of remaining values, by nesting level
    while left:
        if left[-1] == 0:
            left.pop()
            continue
        if at >= end:
            raise ValueError("the message is incomplete")
        left[-1] -= 1
        values += 1
        if values > MAX_VALUES:
            raise ValueError(f"the message contains more than {MAX_VALUES} values")
        at, inside = _token(data, at)
        if inside:
            left.append(inside)
            if len(left) > MAX_DEPTH:
                raise ValueError(f"the message is nested deeper than {MAX_DEPTH} levels")
    if at != end:
        raise ValueError("the message has extra bytes" if at < end else "the message is incomplete")


def _token(data: bytes, at: int) -> tuple[int, int]:
    """Return the offset of the token after the msgpack token at ``at``, and the number of values that it contains.

    The number is 0 unless the token begins a list or a map.
    """
    token = data[at]
    at += 1
    if token < 0x80 or token >= 0xE0:
        return at, 0
    if token < 0x90:
        return at, 2 * (token & 0x0F)
    if token < 0xA0:
        return at, token & 0x0F
    if token < 0xC0:
        return at + (token & 0x1F), 0
    if token in _FIXED:
        return at + _FIXED[token], 0
    if token in _SIZED:
        width = _SIZED[token]
        return at + width + int.from_bytes(data[at : at + width], "big"), 0
    if token in _HOLDERS:
        width, each = _HOLDERS[token]
        return at + width, each * int.from_bytes(data[at : at + width], "big")
    raise ValueError(f"the message contains an extension or a forbidden byte ({token:#x})")


def _dtype(text: object, *, texts: bool = True) -> np.dtype[Any]:
    text = _NAMES.get(text, text) if isinstance(text, str) else text
    if not isinstance(text, str) or not (_NUMBERS.fullmatch(text) or (texts and _TEXTS.fullmatch(text))):
        raise ValueError(f"an array has the type {str(text)[:20]!r}, which is not a plain number")
    return np.dtype(text)


def _shape(given: object) -> tuple[int, ...]:
    if not isinstance(given, (list, tuple)) or len(given) > _MAX_AXES:
        raise ValueError("an array has no shape")
    if not all(isinstance(n, int) and not isinstance(n, bool) and 0 <= n < _MAX_LENGTH for n in given):
        raise ValueError("the shape of an array is not a list of integers")
    return tuple(int(n) for n in given)


def read_array(data: object, dtype_text: object, given_shape: object, *, texts: bool = True) -> np.ndarray:
    """Create a read-only array in native byte order from its bytes, NumPy type code (or name) and shape.

    The elements must be numbers, booleans or, if ``texts`` is True, strings. Raises ValueError or TypeError if the type
    is not allowed, or if the number of bytes does not match the type and the shape.
    """
    dtype, shape = _dtype(dtype_text, texts=texts), _shape(given_shape)
    if not isinstance(data, bytes):
        raise TypeError(f"expected array data as bytes, got {type(data).__name__}")
    if dtype.itemsize == 0 or math.prod(shape) * dtype.itemsize != len(data):
        raise ValueError(f"{len(data)} bytes do not match an array of type {dtype.str} and shape {shape}")
    if 0 in shape:
        return _frozen(np.zeros(shape, dtype.newbyteorder("=")))
    if dtype.kind == "b":
        return _frozen((np.frombuffer(data, np.uint8) != 0).reshape(shape))
    if dtype.kind == "U":
        points = np.frombuffer(data, np.dtype(np.uint32).newbyteorder(dtype.byteorder))
        if ((points > 0x10FFFF) | ((points >= 0xD800) & (points < 0xE000))).any():
            raise ValueError("a string in an array has invalid characters")
    flat = np.frombuffer(data, dtype)
    if not dtype.isnative:
        flat = flat.astype(dtype.newbyteorder("="))
    return _frozen(flat.reshape(shape))


def _frozen(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array
