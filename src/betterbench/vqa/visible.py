"""Visibility limits that keep questions fair. An object must be large enough in the image and not mostly hidden."""

from __future__ import annotations

from betterbench.interface.state import SeenObject

MIN_SIDE_PX = 8
"""Minimum length of the shorter side of an object's box [pixel].

Vision encoders divide images of this size into patches of 14 or 16 pixels. The shape of an object that is smaller than
half a patch cannot be recognized.
"""
MIN_PIXELS = 60
"""Minimum number of visible pixels. A disk with a diameter of 8 pixels has slightly fewer."""
MIN_FRACTION = 0.35
"""Minimum fraction of an object that must be visible.

If less than about a third is visible, people infer the object from the rest of the scene.
"""
HIDDEN_PX = 3
"""Maximum number of visible pixels of an object that is considered hidden.

Isolated pixels between other objects do not show the object.
"""


def clear(seen: SeenObject | None) -> bool:
    """Return whether enough of an object is visible to ask questions about it."""
    return seen is not None and large(seen) and seen.fraction >= MIN_FRACTION


def large(seen: SeenObject | None) -> bool:
    """Return whether the visible part of an object is large enough, even if most of the object is hidden.

    Questions about stacks and drawers use this limit, because a base is hidden by the objects on it, and a closed
    drawer is hidden by its cabinet.
    """
    return seen is not None and seen.side >= MIN_SIDE_PX and seen.pixels >= MIN_PIXELS


def hidden(seen: SeenObject | None) -> bool:
    """Return whether an object is hidden, i.e. has at most ``HIDDEN_PX`` visible pixels.

    An object may be neither hidden nor clearly visible. There are no questions about such objects.
    """
    return seen is None or seen.pixels <= HIDDEN_PX
