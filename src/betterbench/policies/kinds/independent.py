"""Policies of the independent family, which are in a distribution of their own (betterbench-calibration)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from betterbench.installation import calibration_module
from betterbench.interface.state import PrivilegedPolicy

if TYPE_CHECKING:
    from betterbench.sim.scenes import Scene

PREFIX = "independent:"


def is_independent(address: str) -> bool:
    """Tell whether an address is one of the independent family.

    Raises:
        UnknownNameError: If the family has no such policy.
        MissingDependencyError: If the distribution is not installed; the text says how to install it.
    """
    if not address.startswith(PREFIX):
        return False
    return bool(calibration_module("independent", _problem(address)).is_independent(address))


def make_independent(address: str, scene: Scene) -> PrivilegedPolicy:
    """Return a policy of the independent family for one episode in a scene; raises what :func:`is_independent` does."""
    made: PrivilegedPolicy = calibration_module("independent", _problem(address)).make_independent(address, scene)
    return made


def _problem(address: str) -> str:
    return f"{address} is a policy of the independent family, which needs betterbench-calibration"
