"""Safe reader for messages written by ``torch.save``.

Being-H's servers write messages with ``torch.save`` and read them with ``torch.load(weights_only=False)``, which runs
any code that the sender includes. This module reads answers with ``torch.load(weights_only=True)``, which calls only
functions from a list of permitted functions. In this list, NumPy's constructors are replaced by classes of this module
that only store their arguments. Arrays are then built from the raw bytes, with the same checks as in all other
protocols.
"""

from __future__ import annotations

import importlib
import io
import math
import re
import threading
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from betterbench.errors import InvalidInputError, PolicyError
from betterbench.installation import missing_extra
from betterbench.policies.protocols.wire import MAX_DEPTH, MAX_FRAME_BYTES, MAX_VALUES

OLDEST_TORCH = (2, 10)
"""Oldest supported version of PyTorch. In older versions, a file can corrupt memory even with ``weights_only=True``
(CVE-2026-24747).
"""

_ZIP = b"PK\x03\x04"
_HOARDER = b"\nbytearray\n"
_MAX_ELEMENTS = 64 * 1024 * 1024
_NUMBERS = re.compile(r"(b1|[iu][1248]|f[248])", re.ASCII)
_READING = threading.Lock()


class _Kind:
    """Replacement for numpy.dtype during loading. It only stores the type name and the byte order."""

    def __init__(self, text: object = "", *_: object) -> None:
        self.text, self.order = text, "="

    def __setstate__(self, state: object) -> None:
        if isinstance(state, tuple) and len(state) > 1 and state[1] in ("<", ">", "|", "="):
            self.order = state[1]

    def dtype(self) -> np.dtype[Any]:
        if not isinstance(self.text, str) or not _NUMBERS.fullmatch(self.text):
            raise ValueError(f"an array has the type {str(self.text)[:20]!r}, which is not a plain number")
        return np.dtype(self.order.replace("|", "=") + self.text)


class _Array:
    """Replacement for numpy.ndarray during loading. It only stores the pickled state of the array."""

    def __init__(self, *_: object) -> None:
        self.state: object = None

    def __setstate__(self, state: object) -> None:
        self.state = state

    def array(self) -> np.ndarray:
        if not isinstance(self.state, tuple) or len(self.state) != 5:
            raise ValueError("the state of an array must be a tuple of 5 elements")
        _, shape, kind, fortran, data = self.state
        if not isinstance(kind, _Kind) or not isinstance(data, bytes) or not isinstance(shape, tuple):
            raise TypeError("expected the type, shape and bytes of an array")
        if len(shape) > 16 or not all(type(n) is int and 0 <= n < 2**40 for n in shape):
            raise ValueError(f"the shape of an array is invalid: {str(shape)[:40]}")
        dtype = kind.dtype()
        if math.prod(shape) * dtype.itemsize != len(data):
            raise ValueError(f"{len(data)} bytes do not match an array of type {dtype} and shape {shape}")
        if 0 in shape:
            return np.zeros(shape, dtype.newbyteorder("="))
        if dtype.kind == "b":
            flat: np.ndarray = np.frombuffer(data, np.uint8) != 0
        else:
            flat = np.frombuffer(data, dtype).astype(dtype.newbyteorder("="))
        return flat.reshape(shape, order="F" if fortran else "C")


class _Scalar:
    """Replacement for a NumPy scalar during loading. It only stores the type and the bytes."""

    def __init__(self, kind: object = None, data: object = b"", *_: object) -> None:
        self.kind, self.data = kind, data

    def number(self) -> float | int | bool:
        if not isinstance(self.kind, _Kind) or not isinstance(self.data, bytes):
            raise TypeError("expected the type and bytes of a number")
        dtype = self.kind.dtype()
        if dtype.itemsize != len(self.data):
            raise ValueError(f"{len(self.data)} bytes do not match a number of type {dtype}")
        return np.frombuffer(self.data, dtype)[0].item()  # type: ignore[no-any-return]


def _no_bytes(*_: object) -> bytes:
    """Return an empty bytes object. It replaces the constructor ``bytes``, which is called for empty arrays."""
    return b""


# Pickles contain the module name numpy._core if they were written by NumPy 2, and numpy.core for NumPy 1.
_STAND_INS = [
    (_Kind, "numpy.dtype"),
    (_Array, "numpy.ndarray"),
    (_no_bytes, "builtins.bytes"),
    *((_Array, f"numpy.{core}.multiarray._reconstruct") for core in ("_core", "core")),
    *((_Scalar, f"numpy.{core}.multiarray.scalar") for core in ("_core", "core")),
]


def import_torch() -> Any:  # noqa: ANN401 - torch is not installed where types are checked
    """Import torch.

    Raises MissingDependencyError if torch is not installed, or if its version is too old to read untrusted data safely.
    """
    try:
        torch = importlib.import_module("torch")
    except ImportError as error:
        raise missing_extra(
            "being-h:// needs PyTorch, which is not installed",
            "being-h",
            otherwise="or use the bridge (betterbench.policies.clients.bridges), which does not need PyTorch here.",
        ) from error
    version = tuple(int(part) for part in re.findall(r"\d+", torch.__version__)[:2])
    if version < OLDEST_TORCH:
        oldest = ".".join(map(str, OLDEST_TORCH))
        raise missing_extra(
            f"being-h:// needs PyTorch {oldest} or newer to read a server's answers safely; {torch.__version__} is "
            "installed",
            "being-h",
            otherwise="or use the bridge.",
        )
    return torch


def write_torch(value: object) -> bytes:
    """Serialize a value with ``torch.save``.

    Raises MissingDependencyError if torch is not installed, and InvalidInputError if the value cannot be serialized.
    """
    torch = import_torch()
    buffer = io.BytesIO()
    try:
        torch.save(value, buffer)
    except (TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise InvalidInputError(
            "message", f"the value cannot be saved ({error})", "Send strings, numbers and arrays"
        ) from error
    return buffer.getvalue()


def read_torch(data: bytes) -> Any:  # noqa: ANN401 - a payload may hold anything
    """Decode a message written by ``torch.save``, without running code that the message may contain.

    The result consists of dicts with string keys, lists, strings, numbers and NumPy arrays. Raises
    MissingDependencyError if torch is not installed, and PolicyError if the message is malformed, too large, or
    contains values of any other type.
    """
    torch = import_torch()
    try:
        _survey(data)
        with _READING, torch.serialization.safe_globals(_STAND_INS):
            loaded = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
        return _Reader(torch).plain(loaded)
    except Exception as error:
        # All errors raised by torch's reader are caused by the received bytes. The beginning of torch's message is
        # removed, because it advises users to load the file with weights_only=False.
        problem = " ".join(str(error).rpartition("WeightsUnpickler error:")[2].split())
        named = re.search(r"GLOBAL ([\w.]+)", problem)
        reason = f"the file would call {named.group(1)}, which is not allowed" if named else problem[:200]
        raise PolicyError(
            f"torch payload of {len(data)} bytes cannot be read ({reason or type(error).__name__})."
        ) from error


def _survey(data: bytes) -> None:
    """Check the zip archive before torch reads it.

    Compressed entries are rejected, because they could become much larger in memory.
    """
    if len(data) > MAX_FRAME_BYTES:
        raise ValueError(f"the file is larger than {MAX_FRAME_BYTES} bytes")
    if not data.startswith(_ZIP):
        raise ValueError("the file is not a zip archive written by torch 1.6 or newer")
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = archive.infolist()
        if any(e.compress_type != zipfile.ZIP_STORED or e.file_size != e.compress_size for e in entries):
            raise ValueError("the file is compressed")
        if sum(e.file_size for e in entries) > MAX_FRAME_BYTES:
            raise ValueError("the entries of the file overlap")
        # bytearray is the only permitted function that can allocate a large amount of memory from a few bytes.
        if any(_HOARDER in archive.read(e) for e in entries if e.filename.endswith(".pkl")):
            raise ValueError("the file contains a bytearray")


class _Reader:
    """Conversion of the loaded objects to dicts, lists, numbers, strings and NumPy arrays.

    The number of values is limited, because a small file can repeat a value many times with references.
    """

    def __init__(self, torch: Any) -> None:  # noqa: ANN401 - a module
        self._torch = torch
        self._values, self._elements = 0, 0

    def plain(self, thing: object, depth: int = 0) -> Any:  # noqa: ANN401 - a payload may hold anything
        self._values += 1
        if self._values > MAX_VALUES:
            raise ValueError(f"the file contains more than {MAX_VALUES} values")
        if depth > MAX_DEPTH:
            raise ValueError(f"the file is nested deeper than {MAX_DEPTH} levels")
        if thing is None or type(thing) in (bool, int, float, str, bytes):
            return thing
        if isinstance(thing, Mapping):
            if not all(type(key) is str for key in thing):
                raise ValueError("a map has keys that are not strings")
            return {key: self.plain(value, depth + 1) for key, value in thing.items()}
        if isinstance(thing, (list, tuple)):
            return [self.plain(value, depth + 1) for value in thing]
        if isinstance(thing, _Scalar):
            return thing.number()
        if isinstance(thing, _Array):
            return self._counted(thing.array())
        if type(thing) is self._torch.Tensor:
            return self._tensor(thing)
        raise ValueError(f"the file contains a {type(thing).__name__}")

    def _tensor(self, tensor: Any) -> np.ndarray:  # noqa: ANN401 - a torch tensor
        torch = self._torch
        if tensor.layout != torch.strided or tensor.device.type != "cpu" or tensor.numel() > _MAX_ELEMENTS:
            raise ValueError("the file contains a tensor that is sparse, too large or not on the CPU")
        if tensor.numel() * tensor.element_size() > tensor.untyped_storage().nbytes():
            # Reject tensors that were expanded from a smaller storage, because a copy would need much more memory.
            raise ValueError("the file contains a tensor that is larger than its storage")
        # NumPy does not support bfloat16, so convert it to float32.
        return self._counted(np.array((tensor.float() if tensor.dtype == torch.bfloat16 else tensor).detach().numpy()))

    def _counted(self, array: np.ndarray) -> np.ndarray:
        self._elements += array.size
        if self._elements > _MAX_ELEMENTS:
            raise ValueError(f"the arrays in the file contain more than {_MAX_ELEMENTS} numbers")
        if array.dtype.kind not in "biuf":
            raise ValueError(f"the file contains an array of {array.dtype}")
        return array
