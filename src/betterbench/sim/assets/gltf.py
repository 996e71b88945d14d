"""Check the header and the JSON description of a glTF file before it is loaded (glTF 2.0, sections 3 and 4.4)."""

from __future__ import annotations

import struct
from typing import Any, BinaryIO

from betterbench.errors import InvalidInputError, one_line
from betterbench.json_form import parse_json

MAX_JSON_BYTES = 32 << 20
"""Maximum size of the JSON description in a glTF file [byte]."""

_HEAD = struct.Struct("<4sIII4s")
_CURE = "Export the object again, or leave out this file"


def description_of(file: BinaryIO, where: str, *, binary: bool) -> dict[str, Any]:
    """Read the JSON description of a scene from an open glTF file.

    Args:
        file: The open file.
        where: Name of the file, for messages.
        binary: Whether the file is in the binary format (GLB).

    Raises:
        InvalidInputError: If the file is truncated or has an unsupported version, or its JSON cannot be read.
    """
    size = file.seek(0, 2)
    file.seek(0)
    length = size
    if binary:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size or head[:4] != b"glTF":
            raise InvalidInputError(where, "it does not have the header of a GLB file", _CURE)
        _, version, total, length, kind = _HEAD.unpack(head)
        if version != 2 or kind != b"JSON":
            raise InvalidInputError(where, f"it is GLB version {version}, expected version 2", _CURE)
        if total > size or length > size - _HEAD.size:
            raise InvalidInputError(where, f"it ends after {size:,} of {total:,} bytes", "Copy the file again")
    if length > MAX_JSON_BYTES:
        raise InvalidInputError(where, f"its description has more than {MAX_JSON_BYTES >> 20} MB", _CURE)
    try:
        form = parse_json(file.read(length))
    except (ValueError, RecursionError) as error:
        raise InvalidInputError(where, f"its JSON cannot be read ({one_line(error, most=120)})", _CURE) from error
    if not isinstance(form, dict):
        raise InvalidInputError(where, "its description is not a JSON object", _CURE)
    return form
