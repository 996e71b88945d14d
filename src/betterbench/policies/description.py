"""Descriptions of policies as JSON of limited size.

When a run is resumed, the description of the policy is compared with the description that the run contains.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from betterbench.errors import encodable
from betterbench.interface import PolicyInfo
from betterbench.json_form import parse_json
from betterbench.policies.kinds.kind import defining_file

_MAX_DECLARED_BYTES = 1 << 18


_MAX_DEPTH = 12


_MAX_LISTED = 1000


def describe_policy(address: str, info: PolicyInfo) -> dict[str, Any]:
    """Return the description of a policy as JSON.

    If a metadata value contains JSON text, such as an adapter or a handshake, it is included as JSON rather than as
    text. If the policy kind is defined in a user's file, the description contains the file's name and SHA-256.
    """
    from betterbench.tasks.user_files import loaded_files  # noqa: PLC0415 - a policy's own process loads no tasks

    place = defining_file(address)
    own = next((file for file in loaded_files() if file.path == place), None)
    return {
        "address": address,
        "name": encodable(info.name),
        "action_space": encodable(info.action_space),
        "needs_images": info.needs_images,
        "heavy": info.heavy,
        "execution": asdict(info.execution),
        "metadata": bounded({name: _document(text) for name, text in info.metadata.items()}),
        **({} if own is None else {"kind_file": f"{Path(own.path).name}, sha256 {own.sha256}"}),
    }


def bounded(value: object, *, depth: int = 0) -> Any:  # noqa: ANN401 -- JSON from an untrusted server
    """Convert the metadata that a server declares to JSON of limited size.

    Short arrays become lists. Long arrays are replaced by hashes.
    """
    plain = _plain(value, depth)
    if depth == 0 and len(json.dumps(plain)) > _MAX_DECLARED_BYTES:
        return {"sha256": _fingerprint(json.dumps(plain, sort_keys=True).encode())}
    return plain


def _plain(value: object, depth: int) -> Any:  # noqa: ANN401 -- JSON
    if depth > _MAX_DEPTH:
        return "too deep"
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray):
        if value.size <= _MAX_LISTED and value.dtype.kind in "biuf":
            return _plain(value.tolist(), depth)
        return {"dtype": str(value.dtype), "shape": list(value.shape), "sha256": _fingerprint(value.tobytes())}
    if isinstance(value, Mapping):
        named = {k.decode("utf-8", "replace") if isinstance(k, bytes) else str(k): v for k, v in value.items()}
        return {encodable(name): _plain(inner, depth + 1) for name, inner in sorted(named.items())}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(inner, depth + 1) for inner in value]
    if isinstance(value, bytes | bytearray):
        return {"bytes": len(value), "sha256": _fingerprint(bytes(value))}
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, int) and not -(2**63) <= value < 2**63:  # larger integers cannot be stored in a run
        return f"{value:#x}"
    return value if value is None or isinstance(value, bool | int) else encodable(str(value))


def _document(text: str) -> object:
    """Return the JSON object or list that a text contains, or the text itself if it contains neither."""
    if text[:1] in ("{", "["):
        try:
            return parse_json(text)
        except ValueError:
            return text
    return text


def _fingerprint(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
