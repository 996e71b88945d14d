"""Appearance of objects and rooms in a run: the default looks of training and tests, or held-out looks."""

from __future__ import annotations

from typing import Literal, get_args

from betterbench.errors import UnknownNameError

Looks = Literal["seen", "unseen"]
"""Looks of objects and rooms in a run: "seen" in training, or "unseen" (held out)."""

LOOKS: tuple[Looks, ...] = get_args(Looks)
"""The sets of looks by name."""


def looks_named(name: str) -> Looks:
    """Return the looks with a given name. Raises UnknownNameError for an unknown name."""
    for known in LOOKS:
        if name == known:
            return known
    raise UnknownNameError("looks", name, LOOKS)
