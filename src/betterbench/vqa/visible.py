"""Visibility limits for fair questions. An object must be large enough in the image and not mostly hidden."""

from __future__ import annotations

from betterbench.interface.state import SeenObject

MIN_SIDE_PX = 8
"""Minimum length of the shorter side of a box [pixel]. Vision encoders divide images of this size into patches of 14 or
16 pixels, and less than half a patch shows no shape."""
MIN_PIXELS = 60
"""Minimum number of visible pixels, slightly more than a disc with a diameter of 8 pixels."""
MIN_FRACTION = 0.35
"""Minimum visible fraction; below about a third, people infer an object from the rest of the scene."""
HIDDEN_PX = 3
"""Maximum number of visible pixels of a hidden object; isolated pixels between other objects do not show it."""


def clear(seen: SeenObject | None) -> bool:
    """Return whether an object is visible enough for a question."""
    return seen is not None and large(seen) and seen.fraction >= MIN_FRACTION


def large(seen: SeenObject | None) -> bool:
    """Return whether the visible part of an object is large enough, even if most of the object is hidden.

    Questions about stacks and drawers use this, because a base is hidden by the objects on it, and a closed drawer by
    its cabinet.
    """
    return seen is not None and seen.side >= MIN_SIDE_PX and seen.pixels >= MIN_PIXELS


def hidden(seen: SeenObject | None) -> bool:
    """Return whether an object is hidden (at most ``HIDDEN_PX`` visible pixels).

    Objects that are neither clear nor hidden are not used.
    """
    return seen is None or seen.pixels <= HIDDEN_PX
