"""Relation "inside": an object is in a container that is open at the top."""

import math
from collections.abc import Mapping

from betterbench.geometry import Pose, Vector, conjugate, from_yaw, multiply, normalize, rotate, yaw_of
from betterbench.interface.state import ObjectInfo, Region, WorldState
from betterbench.tasks.relations.loose import middle, reaches_into, rests_on
from betterbench.tasks.relations.placing import RELEASE_GAP_M, far_apart, to_region
from betterbench.tasks.relations.relation import PlaceGoal, Relation, offers, register, single
from betterbench.tasks.relations.rest import lies_on_side
from betterbench.tasks.thresholds import threshold

MARGIN = threshold(
    "inside_margin",
    0.0,
    "m",
    "An object is inside a container if its center is at least this far inside the opening.",
    "Larger: objects must lie farther inside; less success, more execution_failure and timeout.",
)

SPOTS = ((-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (0.0, 1.0), (0.0, -1.0), (-1.0, 0.0), (1.0, 0.0))
"""Placements in a container that are tried, as fractions of the largest offset of an object from the center."""
FINGER_ROOM_M = 0.072
"""Distance from a wall at which the fingers have room to open fully [m].

It is the sum of half the gripper's opening, the thickness of a finger, and a margin.
"""
DROPS_M = (RELEASE_GAP_M, 0.015, 0.03, 0.045, 0.06, 0.085, 0.095, 0.115)
"""Heights above the floor of a container at which objects are released [m]. Lower heights are preferred."""


def inside(state: WorldState, name: str, container: str) -> bool:
    """Return whether an object is inside a container.

    The center of the object's bounding box must be inside the container's inner box, i.e. between the walls, above the
    floor and below the rim. An object that leans over the rim with most of its volume outside is not inside. An object
    that sticks out at the top is inside if its center is below the rim. Any posture is allowed, except that an object
    that must stay upright, such as a drink, must not lie on its side. An object that stands on the table is not inside.
    """
    thing, region = state.info.object(name), state.info.object(container).region("inside")
    if thing.keeps_upright and lies_on_side(state, name):
        return False
    height = thing.size_m[2]
    reach = height + math.hypot(*region.position) + math.hypot(*region.half_size)
    if far_apart(state, name, container, reach) or state.touching(name, "table"):
        return False
    x, y, z = to_region(state, container, region).apply(state.pose(name).apply((0.0, 0.0, 0.5 * height)))
    hx, hy, hz = region.half_size
    return abs(x) <= hx - MARGIN and abs(y) <= hy - MARGIN and -hz <= z <= hz


def _loosely(state: WorldState, name: str, container: str) -> str | None:
    """Return the region "" if an object is partly in a container or lies on its rim or content, and None otherwise."""
    region = state.info.object(container).region("inside")
    space = state.pose(container) @ region.pose
    if reaches_into(state, name, space, region.half_size):
        return ""
    x, y, z = space.inverse().apply(middle(state, name))
    over = abs(x) <= region.half_size[0] and abs(y) <= region.half_size[1] and z > 0.0
    return "" if over and rests_on(state, name, container) else None


def _goals(state: WorldState, name: str, container: str, _region: str) -> tuple[PlaceGoal, ...]:
    """Return place goals low over the floor of a container and in free space, with room for the opening fingers.

    Equally good goals are marked as alike. The expert may then choose any of them, so that demonstrations release
    objects all over the floor.
    """
    frame = state.pose(container)
    region = state.info.object(container).region("inside")
    item = 0.5 * max(state.info.object(name).size_m[:2]) + 0.005
    opening = rotate(multiply(conjugate(frame.quaternion), state.ee_pose.quaternion), (0.0, 1.0, 0.0))
    floor = region.position[2] - region.half_size[2]
    taken = _taken(state, name, container)
    now = yaw_of(state.pose(name).quaternion)
    goals: list[tuple[float, Pose]] = []
    for turn in (0.0, math.pi / 2, -math.pi / 2):
        x, y, _ = rotate(from_yaw(turn), opening)
        room_x, room_y = _room(region, item, along_x=abs(x) > abs(y))
        turned = normalize(from_yaw(now + turn))
        for fx, fy in SPOTS:
            spot = (region.position[0] + fx * max(room_x, 0.0), region.position[1] + fy * max(room_y, 0.0))
            gap = min((math.dist(spot, p[:2]) - 0.5 * max(o.size_m[:2]) for p, o in taken), default=1.0) - item
            crowding = max(0.0, -gap)
            for drop in DROPS_M:
                place = frame.apply((spot[0], spot[1], floor + drop))
                cost = 60.0 * crowding + 40.0 * drop + 0.15 * abs(turn)
                goals.append((cost, Pose(place, turned)))
    return tuple(PlaceGoal(pose, alike=cost) for cost, pose in sorted(goals, key=lambda g: g[0]))


def _room(region: Region, item: float, *, along_x: bool) -> tuple[float, float]:
    """Return how far an object's center may be from the container's center along x and y [m].

    The fingers need room to open.
    """
    hx, hy, _ = region.half_size
    if along_x:
        return min(hx - FINGER_ROOM_M, hx - item), hy - item
    return hx - item, min(hy - FINGER_ROOM_M, hy - item)


def _taken(state: WorldState, name: str, container: str) -> list[tuple[tuple[float, float, float], ObjectInfo]]:
    """Return the objects between the walls of a container, with their positions in the container's frame [m]."""
    region = state.info.object(container).region("inside")
    frame = state.pose(container)
    to_region, to_container = (frame @ region.pose).inverse(), frame.inverse()
    found = []
    for i, other in enumerate(state.info.objects):
        if other.name in (name, container) or other.fixed:
            continue
        x, y, _ = to_region.apply(state.positions[i])
        if abs(x) <= region.half_size[0] and abs(y) <= region.half_size[1]:
            found.append((to_container.apply(state.positions[i]), other))
    return found


def _floor(regions: Mapping[str, Region], _region: str) -> Vector:
    x, y, z = regions["inside"].position
    return (x, y, z - regions["inside"].half_size[2])


INSIDE = register(
    Relation(
        name="inside",
        words="{object} is inside {target}",
        where=single(inside),
        loosely=_loosely,
        regions=offers("inside"),
        needs=("inside",),
        tolerances=("inside_margin",),
        goals=_goals,
        surface=_floor,
        falls=True,
    )
)
"""Relation "inside": the object is inside the container."""
