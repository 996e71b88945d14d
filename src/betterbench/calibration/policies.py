"""What a calibration runs: the expert, and every faulty policy at several strengths, with more or less action noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.policies.experts import EXPERTS, Address

STRENGTHS = (1.0, 0.6, 0.3)
"""Shares of the trials in which a rule applies. A policy with a habit does not have it every time."""

ACTION_NOISE_M = {1.0: 0.0, 0.6: 0.001, 0.3: 0.002}
"""Noise on each control step's translation that goes with a strength [m]: none, 2 cm/s and 4 cm/s."""


@dataclass(frozen=True, slots=True)
class CalibrationPolicy:
    """One policy of a calibration."""

    address: Address
    trials: int
    seed: int

    @property
    def folder(self) -> str:
        """Name of its run within the calibration."""
        name = self.address.name.replace(":", "-")
        return f"{name}-{round(100 * self.address.strength)}"


def calibration_policies(
    *,
    policies: Sequence[str] = (),
    strengths: Sequence[float] = STRENGTHS,
    trials: int = 1,
    seed: int = 0,
) -> tuple[CalibrationPolicy, ...]:
    """Return the expert, and every faulty policy at every strength.

    Raises:
        InvalidInputError: If a policy is unknown, or a number is out of range.
    """
    names = [name for name in EXPERTS if not name.startswith("probe:")]
    for name in policies:
        if name not in names:
            raise InvalidInputError(
                "--policies", f"{name!r} is not a policy that can be calibrated", f"Name some of {', '.join(names)}"
            )
    if not strengths or any(not 0.0 < s <= 1.0 for s in strengths):
        given = ", ".join(f"{s:g}" for s in strengths) or "nothing"
        raise InvalidInputError("--strengths", f"{given} is out of range", "Give shares above 0 and up to 1")
    if trials < 1:
        raise InvalidInputError("--trials", f"{trials} is out of range", "Give 1 or more")
    kept = [name for name in names if not policies or name in policies]
    planned = [CalibrationPolicy(Address(name), trials, seed) for name in kept if name == "expert"]
    for i, strength in enumerate(strengths):
        action_noise = ACTION_NOISE_M.get(strength, 0.001)
        zoo = (name for name in kept if name.startswith("zoo:"))
        planned += [CalibrationPolicy(Address(name, strength, action_noise), trials, seed + i * trials) for name in zoo]
    return tuple(planned)
