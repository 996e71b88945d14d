"""Looks of the objects and rooms in a run: those of training and test, or held-out ones."""

from __future__ import annotations

from typing import Literal, get_args

from betterbench.errors import UnknownNameError

Looks = Literal["seen", "unseen"]
"""The looks of objects and rooms in a run: "seen" are those of training, "unseen" are held out."""

LOOKS: tuple[Looks, ...] = get_args(Looks)
"""The sets of looks by name."""


def looks_named(name: str) -> Looks:
    """Return the looks of a name; raise UnknownNameError for an unknown name."""
    for known in LOOKS:
        if name == known:
            return known
    raise UnknownNameError("looks", name, LOOKS)
