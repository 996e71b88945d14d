"""Return of freed memory to the system, for servers that run for weeks."""

from __future__ import annotations

import ctypes
import gc


def return_memory() -> None:
    """Return freed memory to the system, since glibc's allocator would keep it. Other allocators are not affected."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
