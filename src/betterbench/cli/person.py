"""Functions for subcommands with a browser page: name of the person, and exit of the process."""

from __future__ import annotations

import getpass
import os
import sys

from betterbench.errors import InvalidInputError, one_line


def person_named(name: str | None, option: str) -> str:
    """Return a person's name, by default the user name. Raises InvalidInputError unless it is a short line."""
    try:
        who = getpass.getuser() if name is None else name
    except (KeyError, OSError):  # this process's user id has no user name
        who = "unknown"
    if not who.strip() or one_line(who, most=80) != who:
        raise InvalidInputError(
            option, f"{one_line(who, most=40)!r} is not a name", "Give a name of 1 to 80 printable characters"
        )
    return who


def end_process() -> None:
    """Exit the process even if threads are still running.

    Threads that compile a scene, render an image or wait for the browser cannot be interrupted. Call this after all
    results are written and the locks are released.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
