"""Every threshold that a verdict depends on, in one place, each with its reason. Reports name this table."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Limits used by predicates and by the diagnosis. Meters, seconds, radians, newtons.

    Attributes:
        rest_speed: An object slower than this is at rest [m/s]; resting contacts jitter below 1 mm/s here.
        rest_turning: An object turning slower than this is at rest [rad/s].
        upright_tilt: Tilt up to which an object counts as standing [rad]; 5 degrees, a mug on a flat tray shows < 0.5.
        ring_radius: Distance up to which a mug is centered on its ring [m]; suite, section 3, task 6.
        ring_height: Height above the ring plane up to which it stands on it [m].
        spout_margin: Free distance between handle and spout, seen from above [m].
        side_reach: Distance from an anchor beyond which nothing is beside it [m]; the farthest region ends at 0.25 m.
        side_height: Height above the anchor's foot up to which something lies on the same table [m].
        side_turn: Angle up to which a long object is aligned with its anchor [rad]; 20 degrees, seen as parallel.
        long_ratio: Length over width from which an object has a direction; a mug with its handle has 1.4.
        hole_depth: Height of a foot above the floor of its hole up to which it stands on it [m].
        hole_tilt: Tilt up to which an object in a hole is upright [rad]; the clearance allows 4 degrees.
        layer_offset: Distance from the middle of the base up to which a layer is centered [m]; half its
            radius, so that it cannot topple.
        layer_gap: Height between a layer and the one below up to which it lies on it [m]; leaves and buns are uneven.
        layer_tilt: Tilt up to which a layer lies flat [rad]; 10 degrees.
        plate_offset: Distance from the middle of a plate up to which the next one is centered [m]; the play within the
            rim.
        plate_gap: Height of a foot above the floor of a plate up to which it stands on it [m].
        closed_gap: Distance from its closed position up to which a drawer is shut [m].
        inside_margin: Distance by which an object's center must be inside the opening of a container [m].
        grasp_reach: Distance from the tool center point to an object's box up to which a closing gripper is an attempt
            at it [m]; half a finger pad plus the width of a pad.
        slot_reach: Horizontal distance from an empty slot up to which a closing gripper is an attempt there [m]; the
            slot jitter plus the radius of the largest item.
        attempt_height: Height above the table below which a closing gripper can be an attempt [m]; above it no item
            of the suite can be reached.
        attempt_window: Time after the start of closing within which an attempt is resolved [s]; the fingers need 0.4 s
            for their full travel.
        closed_width: Finger distance below which nothing is between the pads [m].
        halt_speed: End-effector speed below which the arm stands still [m/s].
        halt_time: Time of standing still that counts as a halt [s]; suite, section 5.
        settle_time: Time of standing still that a policy which has nothing to do must show at the end [s].
        home_radius: Distance from home within which opening and closing the gripper is not an attempt [m].
        begun_lift: Height by which an object must have risen to count as lifted [m].
        dropped_speed: Downward speed above which a held object that is let go was dropped, not put down [m/s].
        oscillation_travel: Path length without an attempt in an episode that counts as wandering [m].
    """

    rest_speed: float = 0.02
    rest_turning: float = 0.3
    upright_tilt: float = 0.0873
    ring_radius: float = 0.010
    ring_height: float = 0.006
    spout_margin: float = 0.003
    side_reach: float = 0.30
    side_height: float = 0.012
    side_turn: float = 0.35
    long_ratio: float = 1.5
    hole_depth: float = 0.004
    hole_tilt: float = 0.12
    layer_offset: float = 0.020
    layer_gap: float = 0.006
    layer_tilt: float = 0.175
    plate_offset: float = 0.014
    plate_gap: float = 0.004
    closed_gap: float = 0.005
    inside_margin: float = 0.0
    grasp_reach: float = 0.035
    slot_reach: float = 0.06
    attempt_height: float = 0.20
    attempt_window: float = 1.0
    closed_width: float = 0.004
    halt_speed: float = 0.01
    halt_time: float = 3.0
    settle_time: float = 1.0
    home_radius: float = 0.10
    begun_lift: float = 0.02
    dropped_speed: float = 0.3
    oscillation_travel: float = 1.0

    def to_json(self) -> dict[str, float]:
        """Return the JSON form."""
        return asdict(self)

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of all thresholds."""
        return tuple(f.name for f in fields(cls))


THRESHOLDS = Thresholds()
