"""Free memory of this machine or container, and memory used by this process and its child processes."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

PROC = Path("/proc")
CONTROL_GROUPS = Path("/sys/fs/cgroup")

_SHARE = 0.5
"""Fraction of the free memory that additional environments may take."""

_LEAST_BYTES = 16 << 20
"""Minimum amount of memory that is assumed for one environment, with its scene, record and connection [bytes]."""

_V2 = ("memory.max", "memory.current")
_V1 = ("memory.limit_in_bytes", "memory.usage_in_bytes")
_FILES_V2, _FILES_V1 = "inactive_file", "total_inactive_file"


def free_bytes(*, proc: Path = PROC, groups: Path = CONTROL_GROUPS) -> int | None:
    """Return the memory that this process can still use [bytes], or None if it is not known.

    Both the machine and the control groups (cgroups) of the process may limit the memory. In a control group, inactive
    cached files count as free memory.
    """
    found = list(_machine_free(proc)) + list(_groups_free(proc, groups))
    return max(0, min(found)) if found else None


def used_bytes(pid: int | None = None, *, proc: Path = PROC) -> int:
    """Return the resident memory of a process and all its descendants [bytes], or 0 if it is not known."""
    waiting, total = [os.getpid() if pid is None else pid], 0
    page = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096
    seen = set[int]()
    while waiting:
        process = waiting.pop()
        if process in seen:
            continue
        seen.add(process)
        with contextlib.suppress(OSError, ValueError, IndexError):
            _, resident, shared, *_ = (proc / str(process) / "statm").read_text(encoding="ascii").split()
            total += max(0, int(resident) - int(shared)) * page
        for children in (proc / str(process) / "task").glob("*/children"):
            with contextlib.suppress(OSError, ValueError):
                waiting += [int(child) for child in children.read_text(encoding="ascii").split()]
    return total


def room_for(envs: int, *, used_before: int, sharing: int, free: int | None = None, used: int | None = None) -> int:
    """Return the number of environments that fit into memory, given that ``envs`` environments are open.

    Args:
        envs: Number of open environments.
        used_before: Memory of this process before the first environment was opened [bytes].
        sharing: Number of workers on this machine that open environments at the same time.
        free: Free memory [bytes]. By default, it is determined from the system.
        used: Memory that this process uses now [bytes]. By default, it is determined from the system.
    """
    free = free_bytes() if free is None else free
    if free is None:
        return envs
    used = used_bytes() if used is None else used
    each = max(_LEAST_BYTES, (used - used_before) // max(1, envs))
    return envs + int(_SHARE * free / max(1, sharing) / each)


def _machine_free(proc: Path) -> Iterator[int]:
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in (proc / "meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                yield 1024 * int(line.split()[1])


def _groups_free(proc: Path, groups: Path) -> Iterator[int]:
    """Yield the free memory of each control group that contains this process and has a memory limit.

    Versions 1 and 2 of control groups are supported.
    """
    try:
        lines = (proc / "self" / "cgroup").read_text(encoding="utf-8").splitlines()
    except OSError:
        return
    for line in lines:
        number, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        if number == "0" and not controllers:
            root, names, files = groups, _V2, _FILES_V2
        elif "memory" in controllers.split(","):
            root, names, files = groups / "memory", _V1, _FILES_V1
        else:
            continue
        group = Path(path.lstrip("/"))
        if ".." in group.parts:  # the group is not visible in this container
            group = Path()
        for folder in (group, *group.parents):
            left = _left(root / folder, names, files)
            if left is not None:
                yield left


def _left(folder: Path, names: tuple[str, str], files: str) -> int | None:
    with contextlib.suppress(OSError, ValueError):
        limit, used = (int((folder / name).read_text(encoding="ascii")) for name in names)
        idle = 0
        with contextlib.suppress(OSError, ValueError, IndexError):
            for line in (folder / "memory.stat").read_text(encoding="ascii").splitlines():
                if line.split()[0] == files:
                    idle = int(line.split()[1])
        return limit - used + idle
    return None  # there is no limit ("max"), or no such group
