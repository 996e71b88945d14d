"""Every threshold that a verdict depends on, in one table with units and reasons. Reports print the table."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Threshold:
    """One entry of the table.

    Attributes:
        unit: "m", "s", "rad", "m/s", "N"; "1" for a plain number.
        reason: What it decides, and where the value comes from.
    """

    name: str
    value: float
    unit: str
    reason: str


_TABLE: dict[str, Threshold] = {}


def threshold(name: str, value: float, unit: str, reason: str) -> float:
    """Enter a threshold in the table and return its value; the file of a relation or failure mode enters its own.

    Raises:
        ValueError: If the name is taken.
    """
    if name in _TABLE:
        raise ValueError(f"the threshold {name!r} exists already")
    _TABLE[name] = Threshold(name, value, unit, reason)
    return value


def remove_threshold(name: str) -> None:
    """Take a threshold out again, as tests do."""
    del _TABLE[name]


def threshold_table() -> tuple[Threshold, ...]:
    """Return the whole table."""
    return tuple(_TABLE.values())


class Thresholds:
    """Thresholds that several files read."""

    # fmt: off
    # The goal tracker: what is at rest, what stands, what is home.
    rest_time = threshold("rest_time", 0.25, "s",
        "Time over which an object must have stayed in its place to be at rest; in it a falling object moves 0.3 m.")
    rest_travel = threshold("rest_travel", 0.003, "m",
        "Distance that an object at rest may have moved in that time; one that lies on trembling contacts moves by "
        "less than 0.1 mm.")
    rest_turn = threshold("rest_turn", 0.05, "rad",
        "Angle that an object at rest may have turned in that time; 3 degrees.")
    upright_tilt = threshold("upright_tilt", 0.0873, "rad",
        "Tilt up to which an object counts as standing; 5 degrees, a mug on a flat tray shows < 0.5.")
    settle_time = threshold("settle_time", 1.0, "s",
        "Time of standing still that a policy which has nothing to do must show at the end.")
    home_radius = threshold("home_radius", 0.1, "m",
        "Distance from home within which opening and closing the gripper is not an attempt.")

    # Grasp attempts.
    grasp_reach = threshold("grasp_reach", 0.035, "m",
        "Distance from the tool center point to an object's box up to which a closing gripper is an attempt at it; "
        "half a finger pad plus the width of a pad.")
    slot_reach = threshold("slot_reach", 0.06, "m",
        "Horizontal distance from an empty slot up to which a closing gripper is an attempt there; the slot jitter "
        "plus the radius of the largest item.")
    same_place = threshold("same_place", 0.03, "m",
        "Distance of two slots up to which they are one place for a rule of motion: what leads to one reaches the "
        "other.")
    attempt_height = threshold("attempt_height", 0.2, "m",
        "Height above the table below which a closing gripper can be an attempt; above it no item of the suite can "
        "be reached.")
    attempt_window = threshold("attempt_window", 1.0, "s",
        "Time after the start of closing within which an attempt is resolved; the fingers need 0.4 s for their full "
        "travel.")
    closed_width = threshold("closed_width", 0.004, "m", "Finger distance below which nothing is between the pads.")
    finger_travel = threshold("finger_travel", 0.003, "m",
        "Smallest closing of the fingers that is an attempt; the position noise of a servo at rest is below 1 mm.")
    chatter_time = threshold("chatter_time", 0.25, "s",
        "Opening shorter than this between two closings makes them one attempt; the fingers need 0.4 s for their "
        "full travel, so they cannot let go and take something else in the time.")
    stop_time = threshold("stop_time", 0.4, "s",
        "Time after which closing fingers have stopped on whatever is between them; their full travel.")
    begun_lift = threshold("begun_lift", 0.02, "m", "Height by which an object must have risen to count as lifted.")

    # What becomes of an object, and of a drawer.
    settle_after_release = threshold("settle_after_release", 1.0, "s",
        "Time in which a released object comes to rest; a fall from 0.3 m takes 0.25 s, rolling and tipping the "
        "rest.")
    fall_height = threshold("fall_height", 0.02, "m",
        "Height above its later resting place from which a released object was dropped; suite, section 5, and four "
        "times the height at which the expert lets go.")
    fallen_below = threshold("fallen_below", 0.05, "m",
        "Height below the table top at which an object has fallen off the table.")
    knocked_tilt = threshold("knocked_tilt", 0.785, "rad",
        "Tilt beyond which something that nobody held has been knocked over; 45 degrees.")

    # Halts.
    halt_speed = threshold("halt_speed", 0.01, "m/s", "End-effector speed below which the arm stands still.")
    halt_time = threshold("halt_time", 3.0, "s", "Time of standing still that counts as a halt; suite, section 5.")
    stillness_window = threshold("stillness_window", 0.25, "s",
        "Time over which the speed of the arm is averaged; servo jitter averages out, the start of a motion does "
        "not.")

    # Collisions, and the rules of a policy.
    collision_force = threshold("collision_force", 3.0, "N",
        "Normal force above which a touch of a fixture is a collision; a jar that slides along the wall of its hole "
        "presses with less.")
    collision_gap = threshold("collision_gap", 0.25, "s",
        "Time without contact after which the next one is another collision.")
    slip = threshold("slip", 0.05, "1",
        "Share of trials in which even a policy with one firm rule does something else, for comparing rules.")
    # fmt: on

    @staticmethod
    def names() -> tuple[str, ...]:
        """Return the names of all thresholds in force, also of those that other files have entered."""
        return tuple(_TABLE)

    @staticmethod
    def to_json() -> dict[str, float]:
        """Return the values of all thresholds in force by name."""
        return {entry.name: entry.value for entry in _TABLE.values()}


THRESHOLDS = Thresholds()
"""The thresholds in use."""
