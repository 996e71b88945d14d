"""Relation "in_hole": an object stands in a hole of a rack."""

from betterbench.geometry import Pose, tilt_of
from betterbench.interface.state import ObjectInfo, WorldState
from betterbench.tasks.relations.loose import middle, nearest, reaches_into, rests_on
from betterbench.tasks.relations.placing import foot, slim_opening_m, standing_goals, turned_by
from betterbench.tasks.relations.relation import PlaceGoal, Relation, register, surface_of
from betterbench.tasks.thresholds import threshold

PREFIX = "hole_"
"""Prefix of the names of the regions on the floors of a rack's holes: "hole_1", "hole_2", ..."""

DEPTH = threshold(
    "hole_depth",
    0.004,
    "m",
    "An object stands on the floor of a hole if its base is at most this far above the floor.",
    "Larger: jars may stick higher in their holes; more success, fewer execution_failure and timeout.",
)
TILT = threshold(
    "hole_tilt",
    0.12,
    "rad",
    "Largest tilt of an upright object in a hole. The clearance allows 4°.",
    "Larger: jars may lean in their holes; more success, fewer execution_failure and timeout.",
)


def in_hole(state: WorldState, name: str, rack: str) -> str | None:
    """Return the name of the hole where an object stands upright, or None.

    The base of the object must be on the floor of the hole, as close to the center of the hole as the clearance allows.
    An object that leans on the rim or rests on the rack is not in a hole.
    """
    x, y, z = state.pose(rack).inverse().apply(foot(state, name))
    for region in state.info.object(rack).regions:
        if not region.name.startswith(PREFIX):
            continue
        hx, hy, hz = region.position
        if abs(x - hx) > region.half_size[0] or abs(y - hy) > region.half_size[1]:
            continue
        seated = abs(z - hz) <= DEPTH
        tilted = tilt_of(state.pose(name).quaternion) > TILT
        return region.name if seated and not tilted else None
    return None


def _loosely(state: WorldState, name: str, rack: str) -> str | None:
    """Return the hole that an object is in or over, in any posture, such as jammed, lying on the rack, or half out.

    An object that only leans against the rack with its foot on the table does not count.
    """
    frame, info = state.pose(rack), state.info.object(rack)
    holes = {r.name: frame.apply(r.position) for r in info.regions if r.name.startswith(PREFIX)}
    for hole, (x, y, z) in holes.items():
        _, _, depth = info.region(hole).half_size
        width = 0.25 * max(state.info.object(name).size_m[:2])
        if reaches_into(state, name, Pose((x, y, z + 0.5 * depth), frame.quaternion), (width, width, 0.5 * depth)):
            return hole
    return nearest(holes, middle(state, name)) if rests_on(state, name, rack) else None


def _holes(info: ObjectInfo) -> tuple[str, ...]:
    return tuple(r.name for r in info.regions if r.name.startswith(PREFIX))


def _goals(state: WorldState, name: str, rack: str, hole: str) -> tuple[PlaceGoal, ...]:
    """Return place goals on the floor of a hole.

    The object comes straight down and is released just above the floor of the hole.
    """
    floor = state.pose(rack).apply(state.info.object(rack).region(hole).position)
    yaws = turned_by(state, name, (0.0, 0.5, -0.5, 1.0, -1.0, 1.57, -1.57))
    return standing_goals(state, name, floor, yaws, release_width_m=slim_opening_m(state.info.object(name)))


IN_HOLE = register(
    Relation(
        name="in_hole",
        words="{object} stands in {region} of {target}",
        where=in_hole,
        loosely=_loosely,
        regions=_holes,
        needs=("hole_1", "hole_2", "hole_3"),
        tolerances=("hole_depth", "hole_tilt"),
        goals=_goals,
        surface=surface_of(),
    )
)
"""Relation "in_hole": the object stands in a hole of the rack."""
