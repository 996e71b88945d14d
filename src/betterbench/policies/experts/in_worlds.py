"""Privileged policies that work in betterbench's own scenes and in LIBERO."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from betterbench.interface.state import PrivilegedPolicy
from betterbench.policies.experts import libero
from betterbench.policies.experts.privileged import make_expert
from betterbench.tasks.worlds.facts import OURS
from betterbench.tasks.worlds.libero import LIBERO

EXPERTS_IN: Mapping[str, Callable[[str, Any], PrivilegedPolicy]] = {
    OURS.name: make_expert,
    LIBERO.name: libero.LiberoAgent,
}
"""Constructors of privileged policies, by simulated world (``scene.world``).

They are called with an address and a scene.
"""

POLICIES_IN: Mapping[str, tuple[str, ...]] = {LIBERO.title: tuple(libero.POLICIES)}
"""Addresses of the privileged policies that work in a simulated world other than betterbench's own, by title of the
world.
"""
