"""Visibility limits of a fair question: its object is large enough in the image and not mostly hidden."""

from __future__ import annotations

from betterbench.interface.state import SeenObject

MIN_SIDE_PX = 8
"""Least length of the shorter side of a box [pixel]. Vision encoders cut images of this size into patches of 14 or 16
pixels: less than half a patch carries no shape."""
MIN_PIXELS = 60
"""Least number of visible pixels, somewhat more than those of a disc of 8 pixels across."""
MIN_FRACTION = 0.35
"""Least visible fraction: below about a third, people guess an object from the rest of the scene."""
HIDDEN_PX = 3
"""Number of pixels up to which an object counts as hidden: single pixels between other objects do not show it."""


def clear(seen: SeenObject | None) -> bool:
    """Tell whether an object is seen well enough to be asked about."""
    return seen is not None and large(seen) and seen.fraction >= MIN_FRACTION


def large(seen: SeenObject | None) -> bool:
    """Tell whether the visible part of an object is large enough, however much of the object is hidden.

    A base is hidden by what lies on it, and a shut drawer by its cabinet: that is what questions about them ask.
    """
    return seen is not None and seen.side >= MIN_SIDE_PX and seen.pixels >= MIN_PIXELS


def hidden(seen: SeenObject | None) -> bool:
    """Tell whether no part of an object is seen; an object that is neither clear nor hidden is not asked about."""
    return seen is None or seen.pixels <= HIDDEN_PX
