"""Reading of files that may be pipes, devices or folders instead."""

from __future__ import annotations

import errno
import io
import os
import stat
from pathlib import Path

MOST_BYTES = 1 << 30
"""Default of the maximum size of a file that :func:`read_ordinary` reads [byte]."""


class NotOrdinaryError(OSError):
    """A path leads to a folder, pipe, socket or device instead of a regular file, or to a file that is too large."""


def open_ordinary(path: Path) -> io.BufferedReader:
    """Open a file for reading. The file may come from an untrusted source.

    Pipes and devices are rejected without blocking.

    Raises:
        NotOrdinaryError: If the path leads to a folder, pipe, socket or device.
        OSError: If the file is missing or cannot be read.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno == errno.ENXIO:  # the path leads to a socket
            raise NotOrdinaryError(errno.EINVAL, "is not a regular file", str(path)) from error
        raise
    kind = os.fstat(handle).st_mode
    if stat.S_ISREG(kind):
        return os.fdopen(handle, "rb")
    os.close(handle)
    problem = "is a folder and not a file" if stat.S_ISDIR(kind) else "is not a regular file"
    raise NotOrdinaryError(errno.EISDIR if stat.S_ISDIR(kind) else errno.EINVAL, problem, str(path))


def read_ordinary(path: Path, *, max_bytes: int = MOST_BYTES) -> bytes:
    """Return the content of a file, up to a size limit.

    Raises the same errors as :func:`open_ordinary`, and NotOrdinaryError if the file is too large.
    """
    with open_ordinary(path) as file:
        if os.fstat(file.fileno()).st_size > max_bytes:
            raise NotOrdinaryError(errno.EINVAL, f"is larger than {max_bytes} bytes", str(path))
        return file.read()
