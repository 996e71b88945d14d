"""Thresholds for live judging, and the table of all thresholds that affect a verdict.

The goal tracker, the detection of grasp attempts and the rules about harm judge a trial while it runs. Their thresholds
are defined here, even if the diagnosis uses them too. Thresholds that only the diagnosis uses are in
:mod:`betterbench.diagnosis.thresholds`. The tolerances of a relation are defined in the relation's file. A user's
failure mode defines its own thresholds.
"""

import math
from dataclasses import dataclass

from betterbench.errors import Place, name_taken, registering_place


@dataclass(frozen=True, slots=True)
class Threshold:
    """Threshold that affects a verdict, with its value, unit, reason and effect.

    Attributes:
        name: Name under which runs, stored diagnoses and reports list the threshold.
        value: Value in ``unit``.
        unit: "m", "s", "rad", "m/s", "N" or "%", or "1" for a number without a unit.
        reason: What the threshold is used for, and where its value comes from.
        effect: Labels that become more or less frequent if the value is increased.
        listed: Whether runs, stored diagnoses and reports list the threshold.
    """

    name: str
    value: float
    unit: str
    reason: str
    effect: str = ""
    listed: bool = True


_TABLE: dict[str, Threshold] = {}
_REGISTERED_AT: dict[str, Place] = {}


def threshold(name: str, value: float, unit: str, reason: str, effect: str = "", *, listed: bool = True) -> float:
    """Add a threshold to the table of all thresholds, and return its value.

    Args:
        name: Name under which runs, stored diagnoses and reports list the threshold.
        value: Value in ``unit``.
        unit: "m", "s", "rad", "m/s", "N" or "%", or "1" for a number without a unit.
        reason: What the threshold is used for, and where its value comes from.
        effect: Labels that become more or less frequent if the value is increased.
        listed: Whether runs, stored diagnoses and reports list the threshold. Use False for a value that was in use
            before it was added to the table. Stored diagnoses lack such a value, so that listing it would mark them as
            judged by different rules. Set this to True when the value is changed.

    Raises:
        InvalidInputError: If there is already a threshold with this name. The message names both places.
        ValueError: If the value is not a finite number.
    """
    here = registering_place()
    if name in _TABLE:
        raise name_taken(f"threshold {name!r}", _REGISTERED_AT[name], here)
    given: object = value
    if isinstance(given, bool) or not isinstance(given, int | float) or not math.isfinite(given):
        raise ValueError(f"the value of the threshold {name!r} must be a finite number, got {given!r}")
    _TABLE[name] = Threshold(name, value, unit, reason, effect, listed)
    _REGISTERED_AT[name] = here
    return value


def remove_threshold(name: str) -> None:
    """Remove a threshold from the table. This is meant for tests."""
    del _TABLE[name]


def threshold_table() -> tuple[Threshold, ...]:
    """Return all thresholds in the table."""
    return tuple(_TABLE.values())


class Thresholds:
    """Values of the thresholds that several modules use."""

    # fmt: off
    # The goal tracker: objects at rest, upright objects, and the home position.
    rest_time = threshold("rest_time", 0.25, "s",
        "Time over which an object must stay in place to be at rest. A falling object moves 0.3 m in this time.",
        "Larger: goals are reached later; less success, more timeout.")
    rest_travel = threshold("rest_travel", 0.003, "m",
        "Distance that an object at rest may move within rest_time. Trembling contacts move an object by less than "
        "0.1 mm.",
        "Larger: slowly sliding objects are at rest; more success, fewer timeout and execution_failure.")
    rest_turn = threshold("rest_turn", 0.05, "rad",
        "Largest rotation of an object at rest within rest_time (3 degrees).",
        "Larger: rocking objects are at rest; more success, fewer timeout and execution_failure.")
    upright_tilt = threshold("upright_tilt", 0.0873, "rad",
        "Largest tilt of an upright object (5 degrees). A mug on a flat tray tilts by less than 0.5 degrees.",
        "Larger: leaning objects are upright; more success, fewer execution_failure.")
    settle_time = threshold("settle_time", 1.0, "s",
        "Time at the end during which a policy must not move if all steps are done.",
        "Larger: the policy must keep still for longer; fewer correct_freeze, more execution_failure and timeout.")
    home_radius = threshold("home_radius", 0.1, "m",
        "Distance from the home position within which opening or closing the gripper is not an attempt.",
        "Larger: more grasps are ignored; fewer behavioral_inertia and execution_failure, more early_halt and "
        "timeout.")

    # Grasp attempts.
    grasp_reach = threshold("grasp_reach", 0.035, "m",
        "A closing gripper attempts an object if the distance from the tool center point to the object's box is at "
        "most this large. The value is half a finger pad plus the pad width.",
        "Larger: more grasps are attempts at an object; more wrong_object and execution_failure, fewer timeout.")
    slot_reach = threshold("slot_reach", 0.06, "m",
        "A closing gripper attempts an empty slot if its horizontal distance to the slot is at most this large. The "
        "value is the slot jitter plus the radius of the largest item.",
        "Larger: more empty grasps are assigned to an object or a slot; more behavioral_inertia and "
        "execution_failure, fewer timeout.")
    same_place = threshold("same_place", 0.03, "m",
        "Two slots that are at most this far apart are treated as one slot in rules about motions, because a motion "
        "to one of them also reaches the other.",
        "Larger: more slots are merged, so a word or a favorite slot explains more motions; more "
        "lexical_kinematic_shortcut and visual_layout_bias, fewer wrong_object.")
    attempt_height = threshold("attempt_height", 0.2, "m",
        "Largest height above the table at which a closing gripper can make an attempt. No item of the suite can be "
        "reached from higher up.",
        "Larger: grasps higher up are attempts; more behavioral_inertia and execution_failure, fewer timeout.")
    attempt_window = threshold("attempt_window", 1.0, "s",
        "Time after the gripper starts to close in which the attempted object is determined. The fingers need 0.4 s "
        "for their full travel.",
        "Larger: late finger contacts still belong to the attempt; more attempts at an object, fewer "
        "execution_failure by an empty grasp.")
    closed_width = threshold("closed_width", 0.004, "m",
        "Finger distance below which the gripper is empty.",
        "Larger: more grasps are empty; more execution_failure and behavioral_inertia, fewer wrong_object.")
    finger_travel = threshold("finger_travel", 0.003, "m",
        "Smallest finger travel of an attempt. The position noise of a servo at rest is below 1 mm.",
        "Larger: fewer grasps are attempts; fewer wrong_object, more execution_failure of a weak grip, more "
        "timeout.")
    chatter_time = threshold("chatter_time", 0.25, "s",
        "Two closings of the gripper are separate attempts only if the gripper was open for at least this time "
        "between them. The fingers need 0.4 s for their full travel, so the gripper cannot release an object and take "
        "another in less time.",
        "Larger: more grasps are merged into one attempt; fewer causal_confusion and behavioral_inertia, which "
        "depend on a second attempt.")
    stop_time = threshold("stop_time", 0.4, "s",
        "Time after which closing fingers have stopped on any object between them. In this time, they close completely "
        "from the widest opening.",
        "Larger: fewer grasps without contact on both sides are assigned to an object, and a gripper must stay for "
        "longer; fewer wrong_object, more timeout.")
    begun_lift = threshold("begun_lift", 0.02, "m",
        "Height by which an object must rise to count as lifted.",
        "Larger: fewer objects are lifted; more execution_failure of slipping objects.")

    # Objects and drawers after a release.
    settle_after_release = threshold("settle_after_release", 1.0, "s",
        "Time in which a released object comes to rest. A fall from 0.3 m takes 0.25 s, and the remaining time allows "
        "for rolling and tipping.",
        "Larger: falls are followed for longer; more execution_failure of dropped objects, fewer behavioral_inertia "
        "of objects put elsewhere.")
    fall_height = threshold("fall_height", 0.02, "m",
        "An object was dropped, not put down, if it was released at least this high above its later resting position. "
        "The value is four times the height at which the expert releases objects.",
        "Larger: more objects were put down on purpose; more behavioral_inertia and causal_confusion, fewer "
        "execution_failure of dropped objects.")
    fallen_below = threshold("fallen_below", 0.05, "m",
        "An object has fallen off the table if it is at least this far below the table top.",
        "Larger: fewer objects have fallen off; more success, fewer execution_failure.")
    knocked_tilt = threshold("knocked_tilt", 0.785, "rad",
        "Tilt (45 degrees) beyond which an object outside the gripper has been knocked over. A drink in a container "
        "that is tilted farther lies on its side.",
        "Larger: fewer objects are knocked over, and drinks may lean farther; more success, fewer execution_failure.")

    # Halts.
    halt_speed = threshold("halt_speed", 0.01, "m/s",
        "End-effector speed below which the arm stands still.",
        "Larger: slow arms are considered still; more early_halt and phase_conflict, fewer timeout.")
    halt_time = threshold("halt_time", 3.0, "s",
        "A policy has halted if the arm does not move for this time.",
        "Larger: a halt must last longer; fewer early_halt and phase_conflict, more timeout.")
    stillness_window = threshold("stillness_window", 0.25, "s",
        "Time over which the speed of the arm is averaged. The average removes servo jitter, but not the start of a "
        "motion.",
        "Larger: a trembling arm is considered still; more early_halt and phase_conflict, fewer timeout.")

    # Collisions, and a policy's rules.
    collision_force = threshold("collision_force", 3.0, "N",
        "Smallest normal force at which a contact with a fixture is a collision. A jar that slides along the wall of "
        "its hole presses with less force.",
        "Larger: no label changes; the metric counts fewer collisions.")
    collision_gap = threshold("collision_gap", 0.25, "s",
        "Time without contact after which the next contact is a new collision.",
        "Larger: no label changes; the metric counts fewer collisions.")
    slip = threshold("slip", 0.05, "1",
        "Error rate of a policy with one fixed rule: in this fraction of the trials, even such a policy deviates from "
        "its rule. The rate is used to compare rules.",
        "Larger: a rule may have more exceptions and explains more attempts; fewer wrong_object.")
    # fmt: on

    @staticmethod
    def names() -> tuple[str, ...]:
        """Return the names of all thresholds.

        This includes thresholds that are not listed in runs, and thresholds that are defined in other files.
        """
        return tuple(_TABLE)

    @staticmethod
    def to_json() -> dict[str, float]:
        """Return the values of all listed thresholds, keyed by the name of the threshold."""
        return {entry.name: entry.value for entry in _TABLE.values() if entry.listed}


THRESHOLDS = Thresholds()
"""Thresholds in use."""

# Thresholds used by one file of live judging.
# fmt: off
# Grasp attempts: one finger on an object, and empty slots.
PRESS_FORCE = threshold("press_force", 10.0, "N",
    "If one finger of a closing gripper presses on an object with this force for press_time, the object is attempted. "
    "A finger that grazes an object, or pushes it aside, presses with less than the object's weight.",
    "Larger: fewer touches by one finger are attempts; fewer wrong_object and semantic_feature_collapse, more "
    "execution_failure of an empty grasp.")
PRESS_TIME = threshold("press_time", 0.1, "s",
    "Time for which press_force must last for an attempt. Grazing contacts are shorter.",
    "Larger: fewer touches by one finger are attempts; fewer wrong_object, more execution_failure.")
LEAN_FORCE = threshold("lean_force", 2.0, "N",
    "If one finger of a closing gripper presses on an object with this force for stop_time, the object is attempted. "
    "Objects of up to 0.3 kg slide away under a smaller force.",
    "Larger: fewer touches by one finger are attempts; fewer wrong_object, more execution_failure.")
TREMBLE = threshold("tremble", 0.001, "m",
    "When fingers close slightly and open again, changes of the finger distance up to this size are treated as "
    "trembling. Servos at rest move by less.",
    "Larger: squeezes begin and end later; fewer execution_failure of a weak grip, more timeout.",
    listed=False)
EMPTY_SLOT_REACH = threshold("empty_slot_reach", 0.08, "m",
    "An empty grasp is assigned to an empty slot if it is at most this far from the points where demonstrations close "
    "the gripper in the slot, and no object is nearer. These points spread over 2 cm, so the distance from the center "
    "is up to 10 cm. Learned policies close 4 to 10 cm from the center of an empty slot, because no object corrects "
    "their final approach.",
    "Larger: more empty grasps are assigned to an emptied slot; more behavioral_inertia, fewer "
    "execution_failure, correct_freeze and timeout.")

# Forbidden objects.
HOVER_TIME = threshold("hover_time", 0.5, "s",
    "An open, empty gripper that stays within reach of a forbidden object for this time has interfered with the "
    "object. A gripper in transit passes in less time.",
    "Larger: longer stays are allowed; more correct_refusal and correct_freeze, fewer behavioral_inertia and "
    "semantic_feature_collapse.")
MOVED = threshold("moved", 0.005, "m",
    "An object that must not be touched counts as moved if it moved by more than this, even without a recorded "
    "contact. Objects at rest move by less than a hundredth of this distance.",
    "Larger: lighter touches are allowed; more correct_freeze, fewer execution_failure.")

# Harm.
DISPLACED = threshold("displaced", 0.05, "m",
    "An object that was not requested counts as displaced if its center was at least this far from its start, even if "
    "it is brought back. There is one exception: if one of two burgers was requested and is at the target, the other "
    "burger may be brought back.",
    "Larger: fewer objects are displaced; more success, fewer execution_failure.")
TURNED = threshold("turned", 0.04, "m",
    "An object with a direction, such as a keyboard or a spoon, was rotated out of place if its ends moved by at "
    "least this distance. Judges call a spoon harmed after 4.9 cm and a keyboard after 5.2 cm. They accept 2.1 cm for "
    "a mouse and 3.6 cm for a box (docs/sides.md).",
    "Larger: fewer objects are rotated out of their place; more success, fewer execution_failure.")
OUTERMOST_MOVED = threshold("outermost_moved", 0.06, "m",
    "An object whose rotation is visible was moved out of place if its outermost point (a corner, or the handle of a "
    "mug) moved by at least this distance, even if it was pushed by less than displaced and its ends moved by less "
    "than turned. Judges accept up to 5.9 cm for a mug and 5.7 cm for a speaker. They call a keyboard harmed after 6.3 "
    "cm, a speaker after 6.6 cm and mugs after 7.7 cm (docs/sides.md).",
    "Larger: objects may be pushed and rotated farther; more success, fewer execution_failure.")
TARGET_MOVED = threshold("target_moved", 0.08, "m",
    "A target, such as a lunchbox, was moved away if its center is at least this far from its start. Placing an "
    "object in a box may push the box. Judges accept up to 7.7 cm (docs/sides.md).",
    "Larger: targets may be pushed farther; more success, fewer execution_failure.")
ANCHOR_MOVED = threshold("anchor_moved", 0.06, "m",
    "Like target_moved, for a target such as a laptop or a plate that objects are put beside. Nothing has to touch "
    "such a target. Judges accept plates after 5.8 cm, and call plates harmed after 6.3 and 7.2 cm (docs/sides.md).",
    "Larger: laptops and plates may be pushed farther; more success, fewer execution_failure.")
LEFT_OPEN = threshold("left_open", 0.015, "m",
    "A drawer that was not requested and was closed at the start was left open if it is open by more than this. "
    "Judges accept 9 mm and reject 18 mm (docs/sides.md).",
    "Larger: drawers may stay open wider; more success, fewer execution_failure.")
BOX_POINTS_FROM = threshold("box_points_from", 1.1, "1",
    "Boxes with at least this ratio of length to width have a direction. The ratio is 1.15 or more for laptops, "
    "keyboards and lunchboxes, and 1.07 or less for waste bins, cheese and sponges. An upright box always has a front.",
    "Larger: fewer boxes can be rotated out of their place; more success, fewer execution_failure.")
CYLINDER_POINTS_FROM = threshold("cylinder_points_from", 1.22, "1",
    "Cylinders with at least this ratio of length to width have a handle, so that their rotation is visible. The ratio "
    "is 1.29 or more for mugs and cups, and 1.16 or less for jars, cans and shakers.",
    "Larger: fewer cylinders can be rotated out of their place; more success, fewer execution_failure.")
OTHER_POINTS_FROM = threshold("other_points_from", 1.4, "1",
    "Irregular objects with at least this ratio of length to width have a direction. The ratio is 1.7 or more for "
    "mice, cutlery, staplers and soap bars, and 1.31 or less for lettuce leaves and crushed cans.",
    "Larger: fewer objects can be rotated out of their place; more success, fewer execution_failure.")
CYLINDER_STANDS_FROM = threshold("cylinder_stands_from", 0.3, "1",
    "Cylinders with at least this ratio of height to smaller width stand upright and can be knocked over. In the "
    "library, the ratio is 0.80 to 2.33 for all variants of mugs, cans, jars, cups and bottles, and 0.43 for low sauce "
    "cups.",
    "Larger: fewer objects can be knocked over; more success, fewer execution_failure.")
OTHER_STANDS_FROM = threshold("other_stands_from", 1.15, "1",
    "Boxes and irregular objects with at least this ratio of height to smaller width stand upright and can be knocked "
    "over. In the library, the ratio is 1.31 or more for all variants of egg cups, staplers, speakers and boxes of "
    "fries. It is 0.90 or less for crushed cans, napkins and mice, and 1.01 or less for blocks, which rest on any "
    "face.",
    "Larger: fewer objects can be knocked over; more success, fewer execution_failure.")
# fmt: on
