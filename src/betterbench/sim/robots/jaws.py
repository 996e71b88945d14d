"""Gripper jaws: how the finger joints relate to the opening width of a gripper."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


class Jaw(Protocol):
    """Relation between the finger joints of a gripper and its opening width at the tool center point [m].

    Attributes:
        closing_shift_m: Distance that the tool moves along its y axis before the gripper closes, to bring a fixed
            finger next to an object [m].
    """

    @property
    def closing_shift_m(self) -> float:
        """Distance that the tool moves before the gripper closes [m]. See the description of :class:`Jaw`."""

    def width_at(self, joints: Sequence[float]) -> float:
        """Return the opening width [m] for the given positions of the finger joints [m or rad]."""

    def joints_at(self, width_m: float) -> tuple[float, ...]:
        """Return the positions of the finger joints [m or rad] for an opening width, within the range of the joints."""

    def control_at(self, width_m: float) -> float:
        """Return the control value of the gripper's servo that corresponds to an opening width."""

    def width_at_control(self, control: float) -> float:
        """Return the opening width [m] that corresponds to a control value of the gripper's servo."""

    def width_at_share(self, share: float) -> float:
        """Return the opening width [m] for a fraction of the jaw's range, from 0 (closed) to 1 (fully open)."""

    def share_at(self, width_m: float) -> float:
        """Return how far the jaw is open, as a fraction of its range, at the given opening width [m]."""

    def object_offset_m(self, width_m: float) -> float:
        """Return the y coordinate of an object's center in the tool frame before a grasp, for an object width [m]."""


@dataclass(frozen=True, slots=True)
class ParallelJaw:
    """Two fingers on slides that move symmetrically. The control of the servo is the opening width.

    Attributes:
        opening_m: Largest opening width [m].
    """

    opening_m: float

    @property
    def closing_shift_m(self) -> float:
        """Distance that the tool moves before the gripper closes [m]. Always 0, because both fingers move."""
        return 0.0

    def width_at(self, joints: Sequence[float]) -> float:
        """Return the opening width [m], which is the sum of both slide positions."""
        left, right = joints
        return left + right

    def joints_at(self, width_m: float) -> tuple[float, ...]:
        """Return the position of each slide [m], which is half of the opening width."""
        return 0.5 * width_m, 0.5 * width_m

    def control_at(self, width_m: float) -> float:
        """Return the opening width itself [m]."""
        return width_m

    def width_at_control(self, control: float) -> float:
        """Return the control itself, which is the opening width [m]."""
        return control

    def width_at_share(self, share: float) -> float:
        """Return the opening width [m] for a fraction of the jaw's range."""
        return share * self.opening_m

    def share_at(self, width_m: float) -> float:
        """Return the opening width as a fraction of the largest one."""
        return width_m / self.opening_m

    def object_offset_m(self, width_m: float) -> float:
        """Return 0, because an object is gripped in the middle between the fingers."""
        del width_m
        return 0.0


@dataclass(frozen=True, slots=True)
class HingedJaw:
    """One finger on a hinge that closes against a fixed finger. The control of the servo is the angle of the hinge.

    The opening width at the hinge angle ``a`` is ``offset_m + radius_m sin(a - phase_rad)``. This is the distance
    between the fixed finger and a reference point on the moving finger, measured along the opening direction. When the
    jaw is closed, the reference point is level with the tool center point.

    Attributes:
        offset_m: Distance of the hinge from the fixed finger [m].
        radius_m: Distance of the reference point from the hinge [m].
        phase_rad: Angle at which the reference point is level with the hinge in the opening direction [rad].
        low_rad: Hinge angle of the closed jaw [rad].
        high_rad: Hinge angle of the fully open jaw [rad].
        fixed_m: Distance of the fixed finger from the tool center point, against the opening direction [m].
        clearance_m: Free distance between the fixed finger and an object while the tool moves down to the object [m].
        press_m: Distance that the tool then moves to push the fixed finger against the object [m]. The closing jaw is
            inclined and presses the object down. Without the fixed finger next to it, the object would jam on the
            table.
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
        """Clearance between the fixed finger and the object, plus the distance by which the finger presses on it."""
        return self.clearance_m + self.press_m

    def width_at(self, joints: Sequence[float]) -> float:
        """Return the opening width [m] at the given hinge angle [rad]."""
        return self.offset_m + self.radius_m * math.sin(joints[0] - self.phase_rad)

    def joints_at(self, width_m: float) -> tuple[float, ...]:
        """Return the hinge angle [rad] for the given opening width."""
        sine = (width_m - self.offset_m) / self.radius_m
        angle = self.phase_rad + math.asin(min(max(sine, -1.0), 1.0))
        return (min(max(angle, self.low_rad), self.high_rad),)

    def control_at(self, width_m: float) -> float:
        """Return the hinge angle [rad] for the given opening width, which is the control of the servo."""
        return self.joints_at(width_m)[0]

    def width_at_control(self, control: float) -> float:
        """Return the opening width [m] for a commanded hinge angle [rad]."""
        return self.width_at((control,))

    def width_at_share(self, share: float) -> float:
        """Return the opening width [m] when the hinge has turned by the given fraction of its range."""
        return self.width_at((self.low_rad + share * (self.high_rad - self.low_rad),))

    def share_at(self, width_m: float) -> float:
        """Return how far the hinge has turned, as a fraction of its range, at the given opening width [m]."""
        return (self.control_at(width_m) - self.low_rad) / (self.high_rad - self.low_rad)

    def object_offset_m(self, width_m: float) -> float:
        """Return the y coordinate of an object's center in the tool frame before a grasp [m].

        The object is next to the fixed finger, at the distance ``clearance_m``.
        """
        return 0.5 * width_m + self.clearance_m - self.fixed_m
