"""Thresholds of live judging, and the table of all thresholds that affect a verdict.

The goal tracker, the grasp attempts and the rules of harm judge a trial while it runs, so their thresholds are defined
here, below the diagnosis, including those shared with it. Thresholds of the diagnosis only are in
:mod:`betterbench.diagnosis.thresholds`. A tolerance of a relation is in the file of its relation, and a user's failure
mode defines its own thresholds.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Threshold:
    """Threshold in the table: its value, unit, purpose and effect.

    Attributes:
        unit: "m", "s", "rad", "m/s", "N"; "1" for a plain number.
        reason: Use of the threshold, and source of its value.
        effect: Labels that become more or less frequent with a larger value.
        listed: Whether runs, stored diagnoses and reports list it.
    """

    name: str
    value: float
    unit: str
    reason: str
    effect: str = ""
    listed: bool = True


_TABLE: dict[str, Threshold] = {}


def threshold(name: str, value: float, unit: str, reason: str, effect: str = "", *, listed: bool = True) -> float:
    """Add a threshold to the table and return its value.

    Args:
        name: Its name in runs, stored diagnoses and reports.
        value: Its value.
        unit: "m", "s", "rad", "m/s", "N"; "1" for a plain number.
        reason: Use of the threshold, and source of its value.
        effect: Labels that become more or less frequent with a larger value.
        listed: False for a value that was used before it had an entry. Stored diagnoses lack it, and listing it would
            mark them as judged by other rules. List it when its value changes.

    Raises:
        ValueError: If the name is taken.
    """
    if name in _TABLE:
        raise ValueError(f"the threshold {name!r} exists already")
    _TABLE[name] = Threshold(name, value, unit, reason, effect, listed)
    return value


def remove_threshold(name: str) -> None:
    """Remove a threshold, for tests."""
    del _TABLE[name]


def threshold_table() -> tuple[Threshold, ...]:
    """Return the whole table."""
    return tuple(_TABLE.values())


class Thresholds:
    """Thresholds used by several modules."""

    # fmt: off
    # The goal tracker: objects at rest, upright objects, and the home position.
    rest_time = threshold("rest_time", 0.25, "s",
        "Time over which an object must have stayed in its place to be at rest; in it a falling object moves 0.3 m.",
        "Larger: a goal counts later; fewer success, more timeout.")
    rest_travel = threshold("rest_travel", 0.003, "m",
        "Distance that an object at rest may have moved in that time; one that lies on trembling contacts moves by "
        "less than 0.1 mm.",
        "Larger: what still slides counts as at rest; more success, fewer timeout and execution_failure.")
    rest_turn = threshold("rest_turn", 0.05, "rad",
        "Angle that an object at rest may have turned in that time; 3 degrees.",
        "Larger: what still rocks counts as at rest; more success, fewer timeout and execution_failure.")
    upright_tilt = threshold("upright_tilt", 0.0873, "rad",
        "Tilt up to which an object counts as standing; 5 degrees, a mug on a flat tray shows < 0.5.",
        "Larger: what leans counts as standing; more success, fewer execution_failure.")
    settle_time = threshold("settle_time", 1.0, "s",
        "Time of standing still that a policy which has nothing to do must show at the end.",
        "Larger: nothing may move for longer; fewer correct_freeze, more execution_failure and timeout.")
    home_radius = threshold("home_radius", 0.1, "m",
        "Distance from home within which opening and closing the gripper is not an attempt.",
        "Larger: more closings are no attempts; fewer behavioral_inertia and execution_failure, more early_halt and "
        "timeout.")

    # Grasp attempts.
    grasp_reach = threshold("grasp_reach", 0.035, "m",
        "Distance from the tool center point to an object's box up to which a closing gripper is an attempt at it; "
        "half a finger pad plus the width of a pad.",
        "Larger: more closings are attempts at an object; more wrong_object and execution_failure, fewer timeout.")
    slot_reach = threshold("slot_reach", 0.06, "m",
        "Horizontal distance from an empty slot up to which a closing gripper is an attempt there; the slot jitter "
        "plus the radius of the largest item.",
        "Larger: more closings on nothing belong to an object or a slot; more behavioral_inertia and "
        "execution_failure, fewer timeout.")
    same_place = threshold("same_place", 0.03, "m",
        "Distance of two slots up to which they are one place for a rule of motion: what leads to one reaches the "
        "other.",
        "Larger: more slots share a place, so a word or a favorite place explains more; more "
        "lexical_kinematic_shortcut and visual_layout_bias, fewer wrong_object.")
    attempt_height = threshold("attempt_height", 0.2, "m",
        "Height above the table below which a closing gripper can be an attempt; above it no item of the suite can "
        "be reached.",
        "Larger: closings higher up are attempts; more behavioral_inertia and execution_failure, fewer timeout.")
    attempt_window = threshold("attempt_window", 1.0, "s",
        "Time after the start of closing within which an attempt is resolved; the fingers need 0.4 s for their full "
        "travel.",
        "Larger: what the fingers meet late still belongs to the closing; more attempts at an object, fewer "
        "execution_failure of a closing on nothing.")
    closed_width = threshold("closed_width", 0.004, "m",
        "Finger distance below which nothing is between the pads.",
        "Larger: more closings are on nothing; more execution_failure and behavioral_inertia, fewer wrong_object.")
    finger_travel = threshold("finger_travel", 0.003, "m",
        "Smallest closing of the fingers that is an attempt; the position noise of a servo at rest is below 1 mm.",
        "Larger: fewer closings are attempts; fewer wrong_object, more execution_failure of a weak grip, and "
        "timeout.")
    chatter_time = threshold("chatter_time", 0.25, "s",
        "Opening shorter than this between two closings makes them one attempt; the fingers need 0.4 s for their "
        "full travel, so they cannot let go and take something else in the time.",
        "Larger: more closings are one attempt; fewer causal_confusion and behavioral_inertia, which a second "
        "attempt shows.")
    stop_time = threshold("stop_time", 0.4, "s",
        "Time after which closing fingers have stopped on whatever is between them; their full travel.",
        "Larger: fewer closings without a contact on both sides are at an object, and stays have to be longer; "
        "fewer wrong_object, more timeout.")
    begun_lift = threshold("begun_lift", 0.02, "m",
        "Height by which an object must have risen to count as lifted.",
        "Larger: fewer objects count as taken; more execution_failure of what slips.")

    # Objects and drawers after a release.
    settle_after_release = threshold("settle_after_release", 1.0, "s",
        "Time in which a released object comes to rest; a fall from 0.3 m takes 0.25 s, rolling and tipping the "
        "rest.",
        "Larger: a fall is seen to its end; more execution_failure of what drops, fewer behavioral_inertia of what "
        "is put elsewhere.")
    fall_height = threshold("fall_height", 0.02, "m",
        "Height above its later resting place from which a released object was dropped; suite, section 5, and four "
        "times the height at which the expert lets go.",
        "Larger: more objects were put where they lie on purpose; more behavioral_inertia, fewer execution_failure "
        "of what drops.")
    fallen_below = threshold("fallen_below", 0.05, "m",
        "Height below the table top at which an object has fallen off the table.",
        "Larger: less lies on the floor; more success, fewer execution_failure.")
    knocked_tilt = threshold("knocked_tilt", 0.785, "rad",
        "Tilt beyond which something that nobody held has been knocked over; 45 degrees.",
        "Larger: less counts as knocked over; more success, fewer execution_failure.")

    # Halts.
    halt_speed = threshold("halt_speed", 0.01, "m/s",
        "End-effector speed below which the arm stands still.",
        "Larger: a slow arm stands still; more early_halt and phase_conflict, fewer timeout.")
    halt_time = threshold("halt_time", 3.0, "s",
        "Time of standing still that counts as a halt; suite, section 5.",
        "Larger: a stand has to last longer; fewer early_halt and phase_conflict, more timeout.")
    stillness_window = threshold("stillness_window", 0.25, "s",
        "Time over which the speed of the arm is averaged; servo jitter averages out, the start of a motion does "
        "not.",
        "Larger: an arm that trembles stands still; more early_halt and phase_conflict, fewer timeout.")

    # Collisions, and the rules of a policy.
    collision_force = threshold("collision_force", 3.0, "N",
        "Normal force above which a touch of a fixture is a collision; a jar that slides along the wall of its hole "
        "presses with less.",
        "Larger: no label changes; the metric counts fewer collisions.")
    collision_gap = threshold("collision_gap", 0.25, "s",
        "Time without contact after which the next one is another collision.",
        "Larger: no label changes; the metric counts fewer collisions.")
    slip = threshold("slip", 0.05, "1",
        "Share of trials in which even a policy with one firm rule does something else, for comparing rules.",
        "Larger: a rule may have more exceptions, so it explains more attempts; fewer wrong_object.")
    # fmt: on

    @staticmethod
    def names() -> tuple[str, ...]:
        """Return the names of all current thresholds, including unlisted ones and those of other files."""
        return tuple(_TABLE)

    @staticmethod
    def to_json() -> dict[str, float]:
        """Return the values of all listed thresholds by name."""
        return {entry.name: entry.value for entry in _TABLE.values() if entry.listed}


THRESHOLDS = Thresholds()
"""The thresholds in use."""

# Thresholds used by one file of live judging.
# fmt: off
# Grasp attempts: one finger on an object, and empty slots.
PRESS_FORCE = threshold("press_force", 10.0, "N",
    "Force of one finger on something from which a closing gripper is at it, if it lasts for press_time; a finger "
    "that grazes something, or pushes it aside, presses with less than the weight of what it moves.",
    "Larger: fewer touches by one finger are attempts; fewer wrong_object and semantic_feature_collapse, more "
    "execution_failure of a closing on nothing.")
PRESS_TIME = threshold("press_time", 0.1, "s",
    "Time for which one finger presses with press_force; a graze is shorter.",
    "Larger: as for press_force; fewer wrong_object, more execution_failure.")
LEAN_FORCE = threshold("lean_force", 2.0, "N",
    "Force of one finger on something from which a closing gripper is at it, if it lasts for stop_time; objects of "
    "up to 0.3 kg slide away from less.",
    "Larger: as for press_force; fewer wrong_object, more execution_failure.")
TREMBLE = threshold("tremble", 0.001, "m",
    "Change of the finger distance up to which it trembles, for fingers that close by a little and open again; "
    "servos at rest move by less.",
    "Larger: a squeeze begins later and ends later; fewer execution_failure of a weak grip, more timeout.",
    listed=False)
EMPTY_SLOT_REACH = threshold("empty_slot_reach", 0.08, "m",
    "Distance beyond the spread of where demonstrations close in a slot up to which a closing on nothing belongs to "
    "the slot, if nothing stands there and nothing else is nearer; with a spread of 2 cm that is 10 cm. Learned "
    "policies close 4 to 10 cm from the middle of a slot that they find empty: nothing corrects the last of them.",
    "Larger: more closings on nothing are at an emptied slot; more behavioral_inertia, fewer execution_failure, "
    "correct_freeze and timeout.")

# Forbidden objects.
HOVER_TIME = threshold("hover_time", 0.5, "s",
    "Time for which an open, empty gripper stays within reach of something that is to be left alone until it has "
    "interfered with it; at the speed of a transport it would be past in that time.",
    "Larger: more stays are forgiven; more correct_refusal and correct_freeze, fewer behavioral_inertia and "
    "semantic_feature_collapse.")
MOVED = threshold("moved", 0.005, "m",
    "Distance from its place at the start from which something that nothing was to touch was moved, whether or not "
    "a touch is on record; objects at rest move by less than a hundredth of that.",
    "Larger: lighter touches are forgiven; more correct_freeze, fewer execution_failure.")

# Harm.
DISPLACED = threshold("displaced", 0.05, "m",
    "Distance of its middle from where that was at the start beyond which something that was not asked for was "
    "carried, pushed or knocked out of its place, also if it is brought back; suite, law 7. What is left over of a "
    "kind of which enough is at the target, the other one of two burgers, may be brought back.",
    "Larger: less was moved out of its place; more success, fewer execution_failure.")
TURNED = threshold("turned", 0.04, "m",
    "Way of the ends of something with a direction, a keyboard or a spoon, from which it was turned out of its place. "
    "Judges call a spoon harmed whose ends went 4.9 cm and a keyboard with 5.2 cm, and accept a mouse with 2.1 cm and "
    "a box with 3.6 cm (docs/sides.md).",
    "Larger: less was turned out of its place; more success, fewer execution_failure.")
TARGET_MOVED = threshold("target_moved", 0.08, "m",
    "Distance of its middle from where that was at the start beyond which a target, a laptop or a lunchbox, was moved "
    "away; what is put into a box or beside a laptop may push it. Judges accept up to 7.7 cm (docs/sides.md).",
    "Larger: targets may be pushed farther; more success, fewer execution_failure.")
LEFT_OPEN = threshold("left_open", 0.015, "m",
    "Opening of a drawer from which it was left open if it was shut at the start and was not asked for; judges accept "
    "9 mm and do not accept 18 (docs/sides.md).",
    "Larger: drawers may stand open farther; more success, fewer execution_failure.")
BOX_POINTS_FROM = threshold("box_points_from", 1.1, "1",
    "Length of a box in its width from which it has a direction: laptops, keyboards and lunchboxes have 1.15 or more, "
    "waste bins, cheese and sponges 1.07 or less. A box that stands upright has a front.",
    "Larger: fewer boxes can be turned out of their place; more success, fewer execution_failure.")
OTHER_POINTS_FROM = threshold("other_points_from", 1.4, "1",
    "Length of an irregular object in its width from which it has a direction: mice, cutlery, staplers and soap bars "
    "have 1.7 or more, lettuce leaves and crushed cans 1.31 or less.",
    "Larger: fewer objects can be turned out of their place; more success, fewer execution_failure.")
CYLINDER_STANDS_FROM = threshold("cylinder_stands_from", 0.3, "1",
    "Height of a cylinder, in its smaller width, from which it stands upright and can be knocked over. Measured "
    "over all looks of the library: mugs, cans, jars, cups and bottles have 0.80 to 2.33, low sauce cups 0.43.",
    "Larger: fewer objects can be knocked over; more success, fewer execution_failure.")
OTHER_STANDS_FROM = threshold("other_stands_from", 1.15, "1",
    "Height of a box or an irregular object, in its smaller width, from which it stands upright and can be knocked "
    "over. Measured over all looks of the library: egg cups, staplers, speakers and boxes of fries have 1.31 or "
    "more; blocks, which lie as well on another face, 1.01 or less, and crushed cans, napkins and mice 0.90 or "
    "less.",
    "Larger: fewer objects can be knocked over; more success, fewer execution_failure.")
# fmt: on
