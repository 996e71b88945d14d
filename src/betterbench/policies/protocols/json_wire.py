"""Encoding and decoding of the JSON bodies of ``POST /act`` requests and replies.

In the format of json-numpy, an array is a map with the base64-encoded bytes (``__numpy__``), the dtype and the shape.
Some servers expect a string with the JSON text of this map instead of the map. As in
:mod:`betterbench.policies.protocols.wire`, received bodies are not trusted: for any bytes, the decoder returns a value
or raises a :class:`PolicyError`.
"""

from __future__ import annotations

import base64
import json
from typing import Any, Literal

import numpy as np

from betterbench.errors import InvalidInputError, PolicyError
from betterbench.json_form import unique_keys
from betterbench.policies.protocols.wire import MAX_DEPTH, is_image, png_of, read_array, require_depth

MAX_BODY_BYTES = 4 * 1024 * 1024
"""Maximum size of a received body [bytes].

A chunk of 100 actions takes about 15 kB. The limit is low because an empty list takes about 20 times as much memory as
its JSON text.
"""

ArrayCoding = Literal["map", "text", "png"]
"""Encoding of arrays in a body.

"map": a json-numpy map (OpenVLA). "text": a string with the JSON text of this map (X-VLA). "png": a base64-encoded PNG
file for images, and nested lists of numbers for all other arrays (Dexbotic).
"""


def encode_body(value: object, *, arrays: ArrayCoding = "map", encoded: bool = False) -> bytes:
    """Encode a value as a JSON body.

    The value may contain dicts, lists, strings, numbers, None and NumPy arrays of numbers. If ``encoded`` is True, the
    body is a map with the single key ``encoded``, whose value is the JSON text of ``value``. Some servers accept arrays
    only in this form. Raises InvalidInputError for values of other types.
    """

    def mark(thing: object) -> object:
        if isinstance(thing, np.ndarray) and thing.dtype.kind in "biuf" and arrays == "png":
            return base64.b64encode(png_of(thing)).decode("ascii") if is_image(thing) else thing.tolist()
        if isinstance(thing, np.ndarray) and thing.dtype.kind in "biuf":
            data = base64.b64encode(np.ascontiguousarray(thing).tobytes()).decode("ascii")
            form = {"__numpy__": data, "dtype": thing.dtype.str, "shape": list(thing.shape)}
            return form if arrays == "map" else json.dumps(form)
        if isinstance(thing, (np.bool_, np.integer, np.floating)):
            return thing.item()
        raise TypeError(f"a {type(thing).__name__} cannot be encoded as JSON")

    try:
        text = json.dumps(value, default=mark, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise InvalidInputError(
            "message", f"the message cannot be sent ({error})", "Send strings, numbers and arrays"
        ) from error
    return (json.dumps({"encoded": text}) if encoded else text).encode("utf-8")


def decode_body(data: bytes) -> Any:  # noqa: ANN401 - a body may hold anything
    """Decode a JSON body. The arrays in the result are read-only.

    If the body is a string that contains JSON text, this text is decoded as well. Raises PolicyError if the body is
    malformed, nested too deeply, or larger than ``MAX_BODY_BYTES``.
    """
    try:
        if len(data) > MAX_BODY_BYTES:
            raise ValueError(f"the body is larger than {MAX_BODY_BYTES} bytes")  # noqa: TRY301
        value = json.loads(data, object_pairs_hook=_read_map)
        if isinstance(value, str) and value[:1] in ("{", "["):
            value = json.loads(value, object_pairs_hook=_read_map)
        require_depth(value, MAX_DEPTH)
    except (ValueError, TypeError, LookupError, RecursionError, MemoryError, OverflowError, InvalidInputError) as error:
        problem = " ".join(str(error).split())[:200] or type(error).__name__
        raise PolicyError(
            f"JSON of {len(data)} bytes cannot be read ({problem}). Check that both sides use the same protocol."
        ) from error
    return value


def _read_map(pairs: list[tuple[str, Any]]) -> object:
    form = unique_keys(pairs)
    if "__numpy__" not in form:
        return form
    data = form["__numpy__"]
    if not isinstance(data, str):
        raise TypeError(f"expected array data as a base64 string, got {type(data).__name__}")
    return read_array(base64.b64decode(data, validate=True), form.get("dtype"), form.get("shape"), texts=False)
