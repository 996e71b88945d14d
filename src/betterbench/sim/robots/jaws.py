"""Gripper jaws: relation between the finger joints and the opening width."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


class Jaw(Protocol):
    """Relation between the finger joints of a gripper and its opening width at the tool center point [m].

    Attributes:
        closing_shift_m: Motion of the tool along its y axis before it closes, to bring a fixed finger to an object [m].
    """

    @property
    def closing_shift_m(self) -> float:
        """Motion of the tool before it closes [m] (see the class)."""

    def width_at(self, joints: Sequence[float]) -> float:
        """Return the opening width [m] at the positions of the finger joints [m or rad]."""

    def joints_at(self, width_m: float) -> tuple[float, ...]:
        """Return the positions of the finger joints [m or rad] at an opening width, within their range."""

    def control_at(self, width_m: float) -> float:
        """Return the control of the gripper's servo for an opening width."""

    def width_at_control(self, control: float) -> float:
        """Return the opening width [m] that a control of the gripper's servo commands."""

    def width_at_share(self, share: float) -> float:
        """Return the opening width [m] at a share of the jaw's travel (0 is closed, 1 is fully open)."""

    def share_at(self, width_m: float) -> float:
        """Return the share of the jaw's travel at an opening width."""

    def object_offset_m(self, width_m: float) -> float:
        """Return the y coordinate in the tool frame [m] of the middle of an object of this width before a grasp."""


@dataclass(frozen=True, slots=True)
class ParallelJaw:
    """Two fingers on slides that move symmetrically. The servo takes the opening width.

    Attributes:
        opening_m: Largest opening width [m].
    """

    opening_m: float

    @property
    def closing_shift_m(self) -> float:
        """Both fingers move to the object."""
        return 0.0

    def width_at(self, joints: Sequence[float]) -> float:
        """Return the sum of both slides [m]."""
        left, right = joints
        return left + right

    def joints_at(self, width_m: float) -> tuple[float, ...]:
        """Return half the width for each slide [m]."""
        return 0.5 * width_m, 0.5 * width_m

    def control_at(self, width_m: float) -> float:
        """Return the width itself [m]."""
        return width_m

    def width_at_control(self, control: float) -> float:
        """Return the control itself [m]."""
        return control

    def width_at_share(self, share: float) -> float:
        """Return the opening width [m] at a share of the travel."""
        return share * self.opening_m

    def share_at(self, width_m: float) -> float:
        """Return the share of the travel at an opening width."""
        return width_m / self.opening_m

    def object_offset_m(self, width_m: float) -> float:
        """Return 0, because an object is gripped in the middle."""
        del width_m
        return 0.0


@dataclass(frozen=True, slots=True)
class HingedJaw:
    """One finger on a hinge that closes against a fixed finger. The servo takes the angle of the hinge.

    The opening width at angle ``a`` is ``offset_m + radius_m sin(a - phase_rad)``. This is the distance, along the
    opening direction, between the fixed finger and a point of the moving finger. In the closed jaw, this point is level
    with the tool center point.

    Attributes:
        offset_m: Distance of the hinge from the fixed finger [m].
        radius_m: Distance of that point from the hinge [m].
        phase_rad: Angle at which the point is level with the hinge in the opening direction [rad].
        low_rad: Angle of the closed jaw [rad].
        high_rad: Angle of the fully open jaw [rad].
        fixed_m: Distance of the fixed finger from the tool center point, against the opening direction [m].
        clearance_m: Free distance between the fixed finger and an object while the tool moves down to it [m].
        press_m: Distance by which the tool then pushes the fixed finger against the object [m]. The closing jaw is
            inclined and presses an object down. Without the fixed finger beside it, the object would jam on the table.
    """

    offset_m: float
    radius_m: float
    phase_rad: float
    low_rad: float
    high_rad: float
    fixed_m: float
    clearance_m: float
    press_m: float

    @property
    def closing_shift_m(self) -> float:
        """Distance to the object's surface at the clearance, and the press."""
        return self.clearance_m + self.press_m

    def width_at(self, joints: Sequence[float]) -> float:
        """Return the opening width [m] at an angle of the hinge [rad]."""
        return self.offset_m + self.radius_m * math.sin(joints[0] - self.phase_rad)

    def joints_at(self, width_m: float) -> tuple[float, ...]:
        """Return the angle of the hinge [rad]."""
        sine = (width_m - self.offset_m) / self.radius_m
        angle = self.phase_rad + math.asin(min(max(sine, -1.0), 1.0))
        return (min(max(angle, self.low_rad), self.high_rad),)

    def control_at(self, width_m: float) -> float:
        """Return the angle of the hinge [rad]."""
        return self.joints_at(width_m)[0]

    def width_at_control(self, control: float) -> float:
        """Return the opening width [m] at a commanded angle of the hinge [rad]."""
        return self.width_at((control,))

    def width_at_share(self, share: float) -> float:
        """Return the opening width [m] at a share of the hinge's travel."""
        return self.width_at((self.low_rad + share * (self.high_rad - self.low_rad),))

    def share_at(self, width_m: float) -> float:
        """Return the share of the hinge's travel at an opening width."""
        return (self.control_at(width_m) - self.low_rad) / (self.high_rad - self.low_rad)

    def object_offset_m(self, width_m: float) -> float:
        """Return the offset at which the fixed finger stands beside the object at its clearance [m]."""
        return 0.5 * width_m + self.clearance_m - self.fixed_m
