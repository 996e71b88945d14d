"""Memory of a server that runs for weeks: what was freed goes back to the machine."""

from __future__ import annotations

import ctypes
import gc


def return_memory() -> None:
    """Give freed memory back to the system, which the allocator of glibc keeps otherwise; elsewhere nothing happens."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
