"""Returns freed memory to the operating system, which matters for servers that run for weeks."""

from __future__ import annotations

import ctypes
import gc


def return_memory() -> None:
    """Return freed memory to the operating system. By default, glibc's allocator would keep it.

    Other allocators are not affected.
    """
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
