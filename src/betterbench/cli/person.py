"""Verbs that a person uses in the browser: the person name, and the end of the process."""

from __future__ import annotations

import getpass
import os
import sys

from betterbench.errors import InvalidInputError, one_line


def person_named(name: str | None, option: str) -> str:
    """Return a person's name, by default the user name; raise InvalidInputError if it is not one short line."""
    try:
        who = getpass.getuser() if name is None else name
    except (KeyError, OSError):  # the user id of this process has no name
        who = "unknown"
    if not who.strip() or one_line(who, most=80) != who:
        raise InvalidInputError(
            option, f"{one_line(who, most=40)!r} is not a name", "Give 1 to 80 printable characters"
        )
    return who


def end_process() -> None:
    """End the process although threads are still running.

    Compiling a scene, rendering an image, and waiting for a page that does not answer cannot be interrupted. All
    results are on disk, and the locks are released.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
