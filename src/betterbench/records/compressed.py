"""LZ4 compression of byte blocks that are read often and individually. LZ4 is chosen because it decompresses fast."""

from __future__ import annotations

import pyarrow as pa

from betterbench.errors import RecordError

_CODEC = pa.Codec("lz4_raw")


def pack_block(data: bytes) -> bytes:
    """Compress a block. Within one installation, the same block always gives the same bytes."""
    found: bytes = _CODEC.compress(data, asbytes=True)
    return found


def unpack_block(data: memoryview | bytes, size: int) -> memoryview:
    """Decompress a block that has ``size`` bytes after decompression. Raises RecordError if the block is damaged."""
    try:
        return memoryview(_CODEC.decompress(data, size))
    except (pa.ArrowException, OSError, ValueError) as error:
        raise RecordError(f"a compressed block is damaged ({type(error).__name__})") from error
