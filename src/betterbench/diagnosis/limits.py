"""Limits that only the diagnosis needs, beside those of ``tasks.thresholds``; the run's diagnosis names both."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the detectors. Meters, seconds, radians.

    Attributes:
        chatter_time: Opening shorter than this between two closings makes them one attempt [s]; the fingers need 0.4 s
            for their full travel, so they cannot let go and take something else in the time.
        finger_travel: Smallest closing of the fingers that is an attempt [m]; the position noise of a servo at rest is
            below 1 mm.
        stop_time: Time after which closing fingers have stopped on whatever is between them [s]; their full travel.
        settle_after_release: Time in which a released object comes to rest [s]; a fall from 0.3 m takes 0.25 s, rolling
            and tipping the rest.
        fall_height: Height above its later resting place from which a released object was dropped [m]; suite, section
            5, and four times the height at which a careful hand lets go.
        stillness_window: Time over which the speed of the arm is averaged [s]; servo jitter averages out, the start of
            a motion does not.
        fallen_below: Height below the table top at which an object has fallen off the table [m].
        knocked_tilt: Tilt beyond which something that nobody held has been knocked over [rad]; 45 degrees.
        drawn_out: Opening of a drawer below which it has to be drawn out before it can be loaded [m].
        pushed_in: Opening of a drawer above which it stands in the way of the one below [m].
        collision_force: Normal force above which a touch of a fixture is a collision [N]; a jar that slides along the
            wall of its hole presses with less.
        collision_gap: Time without contact after which the next one is another collision [s].
        slip: Share of trials in which even a policy with one firm rule does something else, for comparing rules.
    """

    chatter_time: float = 0.25
    finger_travel: float = 0.003
    stop_time: float = 0.4
    settle_after_release: float = 1.0
    fall_height: float = 0.02
    stillness_window: float = 0.25
    fallen_below: float = 0.05
    knocked_tilt: float = 0.785
    drawn_out: float = 0.12
    pushed_in: float = 0.02
    collision_force: float = 3.0
    collision_gap: float = 0.25
    slip: float = 0.05

    def to_json(self) -> dict[str, float]:
        """Return the JSON form."""
        return asdict(self)


LIMITS = Limits()
