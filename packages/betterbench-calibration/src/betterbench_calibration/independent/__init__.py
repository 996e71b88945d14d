"""Independent family: policies with known habits that test the diagnosis, with a controller of their own."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from betterbench_calibration.independent.registry import (
        FAMILY_PARTS,
        INDEPENDENT,
        IndependentPolicy,
        Shown,
        make_independent,
        policy_of,
        shown_in,
    )

__all__ = [
    "FAMILY_PARTS",
    "INDEPENDENT",
    "IndependentPolicy",
    "Shown",
    "make_independent",
    "policy_of",
    "shown_in",
]

_MODULES = {
    "registry": (
        "FAMILY_PARTS",
        "INDEPENDENT",
        "IndependentPolicy",
        "Shown",
        "make_independent",
        "policy_of",
        "shown_in",
    ),
}
_HOMES = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import the habits on first use, because runs with other policies do not need them."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
