"""Relation "closed" for drawers, and a search for drawers that must be moved before another drawer is loaded."""

from betterbench.geometry import distance
from betterbench.interface.state import WorldState
from betterbench.tasks.condition import Condition, ObjectSpec
from betterbench.tasks.relations.relation import Relation, offers_each, register
from betterbench.tasks.thresholds import threshold

MOUNTS = ("upper", "lower")
"""Regions of a cabinet in which drawers are mounted. Each is at the origin of the closed drawer."""

GAP = threshold(
    "closed_gap",
    0.005,
    "m",
    "A drawer is closed if it is at most this far from its closed position.",
    "Larger: drawers are closed earlier; more success, fewer execution_failure and timeout.",
)

DRAWN_OUT = threshold(
    "drawn_out",
    0.12,
    "m",
    "Smallest opening at which a drawer can be loaded. A gripper is 65 mm thick, and a stapler 36 mm.",
    "Larger: a drawer must be opened wider before it can be loaded; more execution_failure of a drawer left halfway, "
    "fewer wrong_object.",
)
PUSHED_IN = threshold(
    "pushed_in",
    0.02,
    "m",
    "A drawer that is open by more than this blocks the drawer below.",
    "Larger: open drawers block others less often and need closing less often; more wrong_object.",
)


def closed(state: WorldState, drawer: str, cabinet: str) -> str | None:
    """Return the mount that holds a closed drawer in its cabinet, or None if the drawer is open.

    A drawer is closed if it is pushed into the cabinet to within 5 mm of its closed position.
    """
    frame = state.pose(cabinet)
    position = state.pose(drawer).position
    for region in state.info.object(cabinet).regions:
        if region.name in MOUNTS and distance(position, frame.apply(region.position)) <= GAP:
            return region.name
    return None


def opening_m(state: WorldState, drawer: ObjectSpec) -> float:
    """Return how far a drawer is open [m].

    Raises:
        ValueError: If the object has no mount.
    """
    if drawer.mount is None:
        raise ValueError(f"{drawer.name} is not a drawer")
    mount = state.info.object(drawer.mount.target).region(drawer.mount.region)
    return distance(state.pose(drawer.name).position, state.pose(drawer.mount.target).apply(mount.position))


def drawer_to_move(condition: Condition, state: WorldState, target: str) -> tuple[str, bool] | None:
    """Return the drawer that must be moved before an object can be put into a target.

    Open drawers above the target drawer must be closed first. Then the target drawer itself must be opened.

    Returns:
        The name of the drawer, and True if it must be opened or False if it must be closed. The result is None if the
        target is not a drawer, or if nothing is in the way.
    """
    drawer = condition.object(target)
    if drawer.mount is None:
        return None
    height = state.pose(target).position[2]
    for other in condition.objects:
        above = other.mount is not None and state.pose(other.name).position[2] > height
        if above and opening_m(state, other) > PUSHED_IN:
            return other.name, False
    return None if opening_m(state, drawer) > DRAWN_OUT else (target, True)


CLOSED = register(
    Relation(
        name="closed",
        words="{object} is pushed home in {target}",
        where=closed,
        regions=offers_each(*MOUNTS),
        needs=MOUNTS,
        tolerances=("closed_gap",),
        roles=("drawer",),
    )
)
"""Relation "closed": the drawer is closed in its cabinet."""
