"""Helpers for subcommands that serve a web page: check the user's name, and end the process."""

from __future__ import annotations

import getpass
import os
import sys

from betterbench.errors import InvalidInputError, one_line


def person_named(name: str | None, option: str) -> str:
    """Return the given name, or the login name if no name is given.

    Raises:
        InvalidInputError: If the name is empty, is longer than 80 characters, or contains characters that cannot be
            printed.
    """
    try:
        who = getpass.getuser() if name is None else name
    except (KeyError, OSError):  # the user id of this process has no user name
        who = "unknown"
    if not who.strip() or one_line(who, most=80) != who:
        cure = "Use a name of 1 to 80 printable characters, without spaces at its ends"
        raise InvalidInputError(option, f"{who[:40]!r} is not a valid name", cure)
    return who


def end_process() -> None:
    """End the process even if threads are still running.

    Threads that compile a scene, render an image or wait for the browser cannot be interrupted. Call this function only
    after all results are written and all locks are released.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
