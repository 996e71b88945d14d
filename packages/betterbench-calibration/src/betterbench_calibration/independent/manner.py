"""Motion styles of the independent policies. A motion style does not affect the decisions of a policy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Profile = Literal["minimum_jerk", "even", "halting"]
"""Speed profile along a path: bell-shaped, constant, or in steps with short stops between them."""


@dataclass(frozen=True, slots=True)
class Manner:
    """Motion style of a policy: speeds, heights, pauses and noise.

    Attributes:
        speed_m_s: Mean speed of the tool on long paths [m/s].
        approach_m: Height above a grasp or placement from which the tool moves straight down [m].
        carry_m: Clearance between the carried object and the objects below it [m].
        bow_m: Maximum sideways deviation of a long path from the straight line [m].
        pause_s: Pause before the gripper closes or opens [s].
        glance_s: Pause above an object before the tool comes down to it [s].
        noise_m: Standard deviation of the noise on each translation command [m].
    """

    name: str
    profile: Profile
    speed_m_s: float
    approach_m: float
    carry_m: float
    bow_m: float
    pause_s: float
    glance_s: float
    noise_m: float


MANNERS = {
    m.name: m
    for m in (
        Manner("calm", "minimum_jerk", 0.24, 0.10, 0.05, 0.0, 0.15, 0.0, 0.0),
        Manner("brisk", "even", 0.34, 0.06, 0.035, 0.04, 0.0, 0.0, 0.0005),
        Manner("hesitant", "halting", 0.20, 0.08, 0.06, -0.03, 0.35, 0.7, 0.0012),
    )
}
"""Motion styles of the habits in all parts up to the third."""

FOURTH_MANNERS = {
    m.name: m
    for m in (
        Manner("languid", "minimum_jerk", 0.18, 0.13, 0.07, 0.05, 0.25, 0.3, 0.0004),
        Manner("headlong", "even", 0.42, 0.05, 0.04, -0.02, 0.05, 0.0, 0.0),
        Manner("fitful", "halting", 0.27, 0.09, 0.045, 0.03, 0.2, 0.4, 0.0009),
    )
}
"""Motion styles of the habits in the fourth part."""

FIFTH_MANNERS = {
    m.name: m
    for m in (
        Manner("stately", "minimum_jerk", 0.21, 0.11, 0.08, -0.05, 0.4, 0.1, 0.0),
        Manner("darting", "halting", 0.38, 0.07, 0.05, 0.02, 0.1, 0.2, 0.0006),
        Manner("unsteady", "even", 0.25, 0.10, 0.055, 0.035, 0.15, 0.5, 0.0013),
    )
}
"""Motion styles of the habits in the fifth part."""

SIXTH_MANNERS = {
    m.name: m
    for m in (
        Manner("measured", "minimum_jerk", 0.23, 0.09, 0.06, 0.04, 0.2, 0.0, 0.0003),
        Manner("hurried", "even", 0.40, 0.06, 0.045, -0.03, 0.0, 0.1, 0.0008),
        Manner("ragged", "halting", 0.29, 0.08, 0.05, 0.02, 0.25, 0.25, 0.0011),
    )
}
"""Motion styles of the habits in the sixth part."""
