"""Quantities of a robot's dynamics that vary from trial to trial, with their ranges and sources."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from betterbench.errors import InvalidInputError

Quantity = Literal["joint_damping", "joint_friction", "joint_armature", "servo_stiffness", "servo_damping", "backlash"]
"""Quantities that can vary. Values are factors applied to the numbers of the model, except the backlash [rad]."""

BACKLASH: Quantity = "backlash"


@dataclass(frozen=True, slots=True)
class VariedQuantity:
    """Range of one varied quantity. For each joint of the arm and the gripper, a trial draws one value from the range.

    Attributes:
        quantity: Name of the quantity.
        low: Smallest factor, or for "backlash" the smallest total play [rad].
        high: Largest factor, or for "backlash" the largest total play [rad].
        source: Source of the range, in one sentence.
    """

    quantity: Quantity
    low: float
    high: float
    source: str

    def __post_init__(self) -> None:
        """Raise InvalidInputError if the quantity is unknown or the range is impossible."""
        where = f"dynamics of a robot: {self.quantity}"
        if self.quantity not in get_args(Quantity):
            raise InvalidInputError(where, "the quantity is unknown", f"Use one of {', '.join(get_args(Quantity))}")
        least = 0.0 if self.quantity == BACKLASH else 1e-3
        if not least <= self.low <= self.high < math.inf:
            problem = f"the range {self.low:g} to {self.high:g} is not possible"
            raise InvalidInputError(where, problem, f"Choose the range so that {least:g} ≤ low ≤ high")

    def draw(self, generator: np.random.Generator, count: int) -> tuple[float, ...]:
        """Draw values for ``count`` joints. Factors are log-uniform, so that 0.5 is as likely as 2."""
        shares = generator.uniform(0.0, 1.0, count)
        if self.quantity == BACKLASH:
            values = self.low + shares * (self.high - self.low)
        else:
            values = self.low * (self.high / self.low) ** shares
        return tuple(round(value, 6) for value in values.tolist())
