"""Release of freed memory to the operating system, for servers that run for weeks."""

from __future__ import annotations

import ctypes
import gc


def return_memory() -> None:
    """Release freed memory to the operating system. Without this call, glibc's allocator keeps it for this process.

    With other allocators, only unused Python objects are collected.
    """
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
