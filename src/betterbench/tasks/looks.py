"""Appearance of the objects and rooms in a run: the appearance used in training and tests, or a held-out one."""

from __future__ import annotations

from typing import Literal, get_args

from betterbench.errors import UnknownNameError

Looks = Literal["seen", "unseen"]
"""Appearance of objects and rooms: "seen" in training, or "unseen" (held out)."""

LOOKS: tuple[Looks, ...] = get_args(Looks)
"""Names of the sets of appearances."""


def looks_named(name: str) -> Looks:
    """Check that a string names a set of appearances ("seen" or "unseen"), and return it.

    Raises:
        UnknownNameError: If there is no such set.
    """
    for known in LOOKS:
        if name == known:
            return known
    raise UnknownNameError("looks", name, LOOKS)
