"""Thresholds for live judging, and the table of all thresholds that affect a verdict.

The goal tracker, grasp attempts and harm rules judge a trial while it runs. The thresholds for them are defined here,
including thresholds that the diagnosis also uses. Thresholds of only the diagnosis are in
:mod:`betterbench.diagnosis.thresholds`. A relation's tolerances are defined in its file, and a user's failure mode
defines its own thresholds.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Threshold:
    """Table entry of a threshold, with its value, unit, purpose and effect.

    Attributes:
        unit: "m", "s", "rad", "m/s", "N", "%"; "1" for a plain number.
        reason: Use of the threshold, and the source of its value.
        effect: Labels that become more or less frequent with a larger value.
        listed: Whether runs, stored diagnoses and reports list the threshold.
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
        name: Name in runs, stored diagnoses and reports.
        value: Value in ``unit``.
        unit: "m", "s", "rad", "m/s", "N", "%"; "1" for a plain number.
        reason: Use of the threshold, and the source of its value.
        effect: Labels that become more or less frequent with a larger value.
        listed: False for a value that was in use before it had an entry. Stored diagnoses lack such a value, and
            listing it would mark them as judged by other rules. Set this to True when the value changes.

    Raises:
        ValueError: If the name is taken.
    """
    if name in _TABLE:
        raise ValueError(f"the threshold {name!r} already exists")
    _TABLE[name] = Threshold(name, value, unit, reason, effect, listed)
    return value


def remove_threshold(name: str) -> None:
    """Remove a threshold, for tests."""
    del _TABLE[name]


def threshold_table() -> tuple[Threshold, ...]:
    """Return the complete table."""
    return tuple(_TABLE.values())


class Thresholds:
    """Thresholds used by several modules."""

    # fmt: off
    # The goal tracker: objects at rest, upright objects, and the home position.
    rest_time = threshold("rest_time", 0.25, "s",
        "Time during which an object must stay in place to be at rest; a falling object moves 0.3 m in this time.",
        "Larger: goals are reached later; less success, more timeout.")
    rest_travel = threshold("rest_travel", 0.003, "m",
        "Distance that an object at rest may move within rest_time; trembling contacts move an object by less than "
        "0.1 mm.",
        "Larger: slowly sliding objects are at rest; more success, fewer timeout and execution_failure.")
    rest_turn = threshold("rest_turn", 0.05, "rad",
        "Maximum rotation of an object at rest within rest_time; 3 degrees.",
        "Larger: rocking objects are at rest; more success, fewer timeout and execution_failure.")
    upright_tilt = threshold("upright_tilt", 0.0873, "rad",
        "Maximum tilt at which an object is upright; 5 degrees. A mug on a flat tray shows less than 0.5 degrees.",
        "Larger: leaning objects are upright; more success, fewer execution_failure.")
    settle_time = threshold("settle_time", 1.0, "s",
        "Time at the end during which a policy with no step left must not move.",
        "Larger: the policy must keep still for longer; fewer correct_freeze, more execution_failure and timeout.")
    home_radius = threshold("home_radius", 0.1, "m",
        "Distance from the home position within which opening and closing the gripper is not an attempt.",
        "Larger: more grasps are ignored; fewer behavioral_inertia and execution_failure, more early_halt and "
        "timeout.")

    # Grasp attempts.
    grasp_reach = threshold("grasp_reach", 0.035, "m",
        "Maximum distance from the tool center point to an object's box at which a closing gripper attempts the "
        "object; half a finger pad plus the pad width.",
        "Larger: more grasps are attempts at an object; more wrong_object and execution_failure, fewer timeout.")
    slot_reach = threshold("slot_reach", 0.06, "m",
        "Maximum horizontal distance to an empty slot at which a closing gripper attempts the slot; the slot jitter "
        "plus the radius of the largest item.",
        "Larger: more empty grasps are assigned to an object or a slot; more behavioral_inertia and "
        "execution_failure, fewer timeout.")
    same_place = threshold("same_place", 0.03, "m",
        "Distance between two slots up to which a motion rule does not distinguish them, because a motion to one slot "
        "also reaches the other.",
        "Larger: more slots are merged, so a word or a favorite slot explains more motions; more "
        "lexical_kinematic_shortcut and visual_layout_bias, fewer wrong_object.")
    attempt_height = threshold("attempt_height", 0.2, "m",
        "Height above the table below which a closing gripper can be an attempt; higher up, no item of the suite can "
        "be reached.",
        "Larger: grasps higher up are attempts; more behavioral_inertia and execution_failure, fewer timeout.")
    attempt_window = threshold("attempt_window", 1.0, "s",
        "Time after the gripper starts to close within which the attempted object is determined; the fingers "
        "need 0.4 s for their full travel.",
        "Larger: late finger contacts still belong to the attempt; more attempts at an object, fewer "
        "execution_failure of empty grasps.")
    closed_width = threshold("closed_width", 0.004, "m",
        "Finger distance below which the gripper is empty.",
        "Larger: more grasps are empty; more execution_failure and behavioral_inertia, fewer wrong_object.")
    finger_travel = threshold("finger_travel", 0.003, "m",
        "Minimum finger travel of an attempt; the position noise of a servo at rest is below 1 mm.",
        "Larger: fewer grasps are attempts; fewer wrong_object, more execution_failure of a weak grip, more "
        "timeout.")
    chatter_time = threshold("chatter_time", 0.25, "s",
        "Minimum time for which the gripper must be open between two separate attempts; full finger "
        "travel takes 0.4 s, so the gripper cannot release an object and take another in this time.",
        "Larger: more grasps are merged into one attempt; fewer causal_confusion and behavioral_inertia, which "
        "depend on a second attempt.")
    stop_time = threshold("stop_time", 0.4, "s",
        "Time after which closing fingers have stopped on any object between them; the duration of their full travel.",
        "Larger: fewer grasps without contact on both sides are assigned to an object, and a gripper must stay for "
        "longer; fewer wrong_object, more timeout.")
    begun_lift = threshold("begun_lift", 0.02, "m",
        "Height by which an object must rise to be lifted.",
        "Larger: fewer objects are lifted; more execution_failure of slipping objects.")

    # Objects and drawers after a release.
    settle_after_release = threshold("settle_after_release", 1.0, "s",
        "Time in which a released object comes to rest; a fall from 0.3 m takes 0.25 s, and the remainder allows for "
        "rolling and tipping.",
        "Larger: falls are followed for longer; more execution_failure of dropped objects, fewer behavioral_inertia "
        "of objects put elsewhere.")
    fall_height = threshold("fall_height", 0.02, "m",
        "Minimum height of the release above the object's later resting position for the object to have been dropped; "
        "four times the height at which the expert releases objects.",
        "Larger: more objects were put down on purpose; more behavioral_inertia and causal_confusion, fewer "
        "execution_failure of dropped objects.")
    fallen_below = threshold("fallen_below", 0.05, "m",
        "Depth below the table top at which an object has fallen off the table.",
        "Larger: fewer objects have fallen off; more success, fewer execution_failure.")
    knocked_tilt = threshold("knocked_tilt", 0.785, "rad",
        "Tilt beyond which an object that the gripper does not hold has been knocked over, and beyond which a drink in "
        "a container lies on its side; 45 degrees.",
        "Larger: fewer objects are knocked over, and drinks may lean farther; more success, fewer execution_failure.")

    # Halts.
    halt_speed = threshold("halt_speed", 0.01, "m/s",
        "End-effector speed below which the arm stands still.",
        "Larger: slow arms are considered still; more early_halt and phase_conflict, fewer timeout.")
    halt_time = threshold("halt_time", 3.0, "s",
        "Minimum time without motion after which the policy has halted.",
        "Larger: a halt must last longer; fewer early_halt and phase_conflict, more timeout.")
    stillness_window = threshold("stillness_window", 0.25, "s",
        "Time over which the speed of the arm is averaged. The average removes servo jitter but not the start of a "
        "motion.",
        "Larger: a trembling arm is considered still; more early_halt and phase_conflict, fewer timeout.")

    # Collisions, and a policy's rules.
    collision_force = threshold("collision_force", 3.0, "N",
        "Minimum normal force at which contact with a fixture is a collision; a jar that slides along the wall of its "
        "hole presses with less force.",
        "Larger: no label changes; the metric counts fewer collisions.")
    collision_gap = threshold("collision_gap", 0.25, "s",
        "Time without contact after which the next contact is a new collision.",
        "Larger: no label changes; the metric counts fewer collisions.")
    slip = threshold("slip", 0.05, "1",
        "Share of trials in which even a policy with one fixed rule deviates from the rule, used to compare rules.",
        "Larger: a rule may have more exceptions and explains more attempts; fewer wrong_object.")
    # fmt: on

    @staticmethod
    def names() -> tuple[str, ...]:
        """Return the names of all current thresholds, including unlisted thresholds and thresholds in other files."""
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
    "Minimum force of one finger at which a closing gripper attempts the touched object, if the force lasts for "
    "press_time; a finger that grazes an object or pushes it aside presses with less than the object's weight.",
    "Larger: fewer touches by one finger are attempts; fewer wrong_object and semantic_feature_collapse, more "
    "execution_failure of an empty grasp.")
PRESS_TIME = threshold("press_time", 0.1, "s",
    "Minimum duration of press_force for one finger to attempt an object; grazing contacts are shorter.",
    "Larger: fewer touches by one finger are attempts; fewer wrong_object, more execution_failure.")
LEAN_FORCE = threshold("lean_force", 2.0, "N",
    "Minimum force of one finger at which a closing gripper attempts the touched object, if the force lasts for "
    "stop_time; objects of up to 0.3 kg slide away under a smaller force.",
    "Larger: fewer touches by one finger are attempts; fewer wrong_object, more execution_failure.")
TREMBLE = threshold("tremble", 0.001, "m",
    "Change of the finger distance that is treated as trembling when fingers close slightly and open again; servos at "
    "rest move by less.",
    "Larger: squeezes begin and end later; fewer execution_failure of a weak grip, more timeout.",
    listed=False)
EMPTY_SLOT_REACH = threshold("empty_slot_reach", 0.08, "m",
    "Maximum distance beyond a slot's demonstrated closing points at which an empty grasp is assigned to the "
    "empty slot, if no object is nearer; with a spread of 2 cm, up to 10 cm. Learned policies close 4 to 10 cm "
    "from the center of an empty slot, because no object corrects their final approach.",
    "Larger: more empty grasps are assigned to an emptied slot; more behavioral_inertia, fewer "
    "execution_failure, correct_freeze and timeout.")

# Forbidden objects.
HOVER_TIME = threshold("hover_time", 0.5, "s",
    "Time after which an open, empty gripper within reach of a forbidden object has interfered with the object; a "
    "gripper in transit passes in less time.",
    "Larger: longer stays are allowed; more correct_refusal and correct_freeze, fewer behavioral_inertia and "
    "semantic_feature_collapse.")
MOVED = threshold("moved", 0.005, "m",
    "Minimum distance from its start at which an object that must not be touched has been moved, with or without a "
    "recorded contact; objects at rest move by less than a hundredth of this distance.",
    "Larger: lighter touches are allowed; more correct_freeze, fewer execution_failure.")

# Harm.
DISPLACED = threshold("displaced", 0.05, "m",
    "Minimum distance from its start to an uninstructed object's center at which the object was displaced, "
    "even if it is brought back. Exception: a surplus object (the second burger, if one burger was requested and one "
    "is at the target) may be brought back.",
    "Larger: fewer objects are displaced; more success, fewer execution_failure.")
TURNED = threshold("turned", 0.04, "m",
    "Minimum displacement of the ends of an object with a direction, such as a keyboard or a spoon, for the object to "
    "have been rotated out of place. People call a spoon harmed after 4.9 cm and a keyboard after 5.2 cm, and accept "
    "2.1 cm of a mouse and 3.6 cm of a box (docs/sides.md).",
    "Larger: fewer objects are rotated out of their place; more success, fewer execution_failure.")
OUTERMOST_MOVED = threshold("outermost_moved", 0.06, "m",
    "Minimum displacement of the outermost point of an object whose rotation is visible (a corner, or the handle of a "
    "mug) for the object to have been rotated out of place, although it was pushed by less than displaced and its ends "
    "moved by less than turned. People accept up to 5.9 cm of a mug and 5.7 cm of a speaker, and call 6.3 cm of a "
    "keyboard, 6.6 cm of a speaker and the handles of mugs after 7.7 cm harmed (docs/sides.md).",
    "Larger: objects may be pushed and rotated farther; more success, fewer execution_failure.")
TARGET_MOVED = threshold("target_moved", 0.08, "m",
    "Minimum distance from its start to the center of a target, such as a lunchbox, at which the target was moved "
    "away; placing an object in a box may push the box. People accept up to 7.7 cm (docs/sides.md).",
    "Larger: targets may be pushed farther; more success, fewer execution_failure.")
ANCHOR_MOVED = threshold("anchor_moved", 0.06, "m",
    "The same distance for a target that objects are put beside, so that nothing has to touch it. People accept "
    "plates after 5.8 cm, and call plates after 6.3 and 7.2 cm harmed (docs/sides.md).",
    "Larger: laptops and plates may be pushed farther; more success, fewer execution_failure.")
LEFT_OPEN = threshold("left_open", 0.015, "m",
    "Opening beyond which an unrequested drawer, closed at the start, was left open; people accept 9 mm and reject 18 "
    "mm (docs/sides.md).",
    "Larger: drawers may stay open wider; more success, fewer execution_failure.")
BOX_POINTS_FROM = threshold("box_points_from", 1.1, "1",
    "Ratio of length to width from which a box has a direction: laptops, keyboards and lunchboxes have 1.15 or more, "
    "waste bins, cheese and sponges 1.07 or less. An upright box has a front in any case.",
    "Larger: fewer boxes can be rotated out of their place; more success, fewer execution_failure.")
CYLINDER_POINTS_FROM = threshold("cylinder_points_from", 1.22, "1",
    "Ratio of length to width from which a cylinder has a handle, so that its rotation is visible: mugs and cups have "
    "1.29 or more, jars, cans and shakers 1.16 or less.",
    "Larger: fewer cylinders can be rotated out of their place; more success, fewer execution_failure.")
OTHER_POINTS_FROM = threshold("other_points_from", 1.4, "1",
    "Minimum length-to-width ratio for an irregular object to have a direction: mice, cutlery, staplers and soap bars "
    "have 1.7 or more, lettuce leaves and crushed cans 1.31 or less.",
    "Larger: fewer objects can be rotated out of their place; more success, fewer execution_failure.")
CYLINDER_STANDS_FROM = threshold("cylinder_stands_from", 0.3, "1",
    "Ratio of height to smaller width from which a cylinder is upright and can be knocked over. Measured over all "
    "looks of the library: mugs, cans, jars, cups and bottles have 0.80 to 2.33, low sauce cups 0.43.",
    "Larger: fewer objects can be knocked over; more success, fewer execution_failure.")
OTHER_STANDS_FROM = threshold("other_stands_from", 1.15, "1",
    "Ratio of height to smaller width from which a box or an irregular object is upright and can be knocked over. "
    "Measured over all looks of the library: egg cups, staplers, speakers and boxes of fries have 1.31 or more; "
    "crushed cans, napkins and mice have 0.90 or less, and blocks, which rest on any face, 1.01 or less.",
    "Larger: fewer objects can be knocked over; more success, fewer execution_failure.")
# fmt: on
