"""Arrangement: on which side of an anchor an object lies or stands."""

import math

from betterbench.geometry import IDENTITY_QUATERNION, Vector, yaw_of
from betterbench.state import ObjectInfo, WorldState
from betterbench.tasks.relations.loose import lowest, middle
from betterbench.tasks.relations.placing import foot, slim_opening_m, standing_goals, turned_by
from betterbench.tasks.relations.relation import PlaceGoal, Relation, offers_each, register
from betterbench.tasks.relations.rest import upright
from betterbench.tasks.thresholds import threshold

SIDES = {
    "left": "to the left of",
    "right": "to the right of",
    "behind": "behind",
    "upper_right": "at the upper right of",
}
"""Regions that anchors offer, as somebody sees them who sits in front of the anchor, with the words of instructions."""

REACH = threshold(
    "side_reach",
    0.30,
    "m",
    "Distance from an anchor beyond which nothing is beside it; the farthest region ends there.",
)
HEIGHT = threshold("side_height", 0.012, "m", "Height above the anchor's foot up to which something is on the table.")
TURN = threshold(
    "side_turn", 0.35, "rad", "Angle up to which a long object lies along its anchor; 20 degrees look parallel."
)
LONG_RATIO = threshold(
    "long_ratio", 1.5, "1", "Length over width from which an object has a direction; a mug with its handle has 1.4."
)


def beside(state: WorldState, name: str, anchor: str) -> str | None:
    """Return the side of an anchor at which an object lies, or None.

    The center of the object's foot lies in the region of that side, on the table and not on something. It stands as it
    is meant to stand, and a long object lies along the anchor's front-to-back axis, either way round.
    """
    if not state.touching(name, "table"):  # the cheapest question first: it ends here while an object is carried
        return None
    side, height = _side(state, foot(state, name), anchor)
    if side is None or height > HEIGHT:
        return None
    return side if upright(state, name) and _aligned(state, name, anchor) else None


def _loosely(state: WorldState, name: str, anchor: str) -> str | None:
    """Return the side of an anchor at which an object is in any posture, on the table or on what lies there, or None.

    Its foot or its middle is over the region of that side; what the gripper holds above the table is not there yet.
    """
    if state.held == name and lowest(state, name) - state.pose(anchor).position[2] > HEIGHT:
        return None
    return _side(state, foot(state, name), anchor)[0] or _side(state, middle(state, name), anchor)[0]


def _side(state: WorldState, point: Vector, anchor: str) -> tuple[str | None, float]:
    """Return the side over whose region a point is, or None, and its height above the anchor's foot [m]."""
    x, y, z = state.pose(anchor).inverse().apply(point)
    if x * x + y * y > REACH**2:
        return None, z
    for region in state.info.object(anchor).regions:
        if region.name not in SIDES:
            continue
        if region.quaternion == IDENTITY_QUATERNION:
            dx, dy = x - region.position[0], y - region.position[1]
        else:
            dx, dy, _ = region.pose.inverse().apply((x, y, z))
        if abs(dx) <= region.half_size[0] and abs(dy) <= region.half_size[1]:
            return region.name, z
    return None, z


def _is_long(info: ObjectInfo) -> bool:
    length, width, _ = info.size_m
    return length >= LONG_RATIO * width


def _aligned(state: WorldState, name: str, anchor: str) -> bool:
    if not _is_long(state.info.object(name)):
        return True
    turn = yaw_of(state.pose(name).quaternion) - yaw_of(state.pose(anchor).quaternion)
    return abs((turn + 0.5 * math.pi) % math.pi - 0.5 * math.pi) <= TURN


def _goals(state: WorldState, name: str, anchor: str, side: str) -> tuple[PlaceGoal, ...]:
    """Return goals in the middle of a side; long objects lie along the anchor, either way round."""
    frame, info = state.pose(anchor), state.info.object(name)
    middle = (frame @ state.info.object(anchor).region(side).pose).position
    facing, now = yaw_of(frame.quaternion), yaw_of(state.pose(name).quaternion)
    if _is_long(info):
        yaws = sorted((facing, facing + math.pi), key=lambda yaw: abs(math.remainder(yaw - now, 2.0 * math.pi)))
    else:
        yaws = turned_by(state, name, (0.0, 0.4, -0.4, 0.8, -0.8, 1.6, -1.6))
    return standing_goals(state, name, middle, yaws, release_width_m=slim_opening_m(info))


BESIDE = register(
    Relation(
        name="beside",
        words="{object} is on the {region} side of {target}",
        where=beside,
        loosely=_loosely,
        regions=offers_each(*SIDES),
        needs=tuple(SIDES),
        tolerances=("side_reach", "side_height", "side_turn", "long_ratio"),
        goals=_goals,
        pairwise=True,
    )
)
