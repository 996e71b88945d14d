"""Policies for a calibration: the expert, and faulty policies with several strengths of fault and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from betterbench.errors import InvalidInputError
from betterbench.policies.experts import Address, expert_names
from betterbench.policies.experts.address import EXPERT_FORM, ZOO_FORM

STRENGTHS = (1.0, 0.6, 0.3)
"""Fractions of trials in which a faulty policy shows its fault. Real policies do not show a fault in every trial."""

ACTION_NOISE_M = {1.0: 0.0, 0.6: 0.001, 0.3: 0.002}
"""Standard deviation of the noise added to the translation in each control step [m], by strength.

At a control rate of 20 Hz, the values correspond to 0, 2 and 4 cm/s.
"""


@dataclass(frozen=True, slots=True)
class CalibrationPolicy:
    """Policy to run in a calibration, with the number of trials per variation and the first seed."""

    address: Address
    trials: int
    seed: int

    @property
    def folder(self) -> str:
        """Name of the run folder of this policy, inside the folder of the calibration."""
        name = self.address.name.replace(":", "-")
        return f"{name}-{round(100 * self.address.strength)}"


def calibration_policies(
    *,
    policies: Sequence[str] = (),
    strengths: Sequence[float] = STRENGTHS,
    trials: int = 1,
    seed: int = 0,
) -> tuple[CalibrationPolicy, ...]:
    """Return the policies to run for a calibration: the expert, and each faulty policy with each strength.

    ``policies`` selects some of these policies by name. Each strength uses different seeds.

    Raises:
        InvalidInputError: If a policy is unknown, or a number is out of range.
    """
    experts, zoo = expert_names(EXPERT_FORM), expert_names(ZOO_FORM)
    names = (*experts, *zoo)
    for name in policies:
        if name not in names:
            raise InvalidInputError(
                "--policies",
                f"{name!r} is not a policy for calibrations",
                f"Use one or more of {', '.join(names)}",
            )
    if not strengths or any(not 0.0 < s <= 1.0 for s in strengths):
        given = ", ".join(f"{s:g}" for s in strengths) or "nothing"
        raise InvalidInputError("--strengths", f"{given} is out of range", "Use numbers greater than 0 and at most 1")
    if trials < 1:
        raise InvalidInputError("--trials", f"{trials} is out of range", "Use a number of at least 1")
    kept = [name for name in names if not policies or name in policies]
    planned = [CalibrationPolicy(Address(name), trials, seed) for name in experts if name in kept]
    for i, strength in enumerate(strengths):
        action_noise = ACTION_NOISE_M.get(strength, 0.001)
        faulty = [Address(name, strength, action_noise) for name in zoo if name in kept]
        planned += [CalibrationPolicy(address, trials, seed + i * trials) for address in faulty]
    return tuple(planned)
