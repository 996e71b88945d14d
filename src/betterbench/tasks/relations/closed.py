"""Relation "closed" of drawers, and the drawers that must be moved before another drawer can be loaded."""

from betterbench.geometry import distance
from betterbench.interface.state import WorldState
from betterbench.tasks.condition import Condition, ObjectSpec
from betterbench.tasks.relations.relation import Relation, offers_each, register
from betterbench.tasks.thresholds import threshold

MOUNTS = ("upper", "lower")
"""Regions of a cabinet for drawers, at the origins of the closed drawers."""

GAP = threshold(
    "closed_gap",
    0.005,
    "m",
    "Distance from its closed position up to which a drawer is closed.",
    "Larger: drawers are closed earlier; more success, fewer execution_failure and timeout.",
)

DRAWN_OUT = threshold(
    "drawn_out",
    0.12,
    "m",
    "Minimum opening at which a drawer can be loaded. A gripper is 65 mm thick, a stapler 36 mm.",
    "Larger: a drawer must be opened wider before it can be loaded; more execution_failure of a drawer left halfway, "
    "fewer wrong_object.",
)
PUSHED_IN = threshold(
    "pushed_in",
    0.02,
    "m",
    "Opening of a drawer above which it blocks the drawer below.",
    "Larger: open drawers block others less often and need closing less often; more wrong_object.",
)


def closed(state: WorldState, drawer: str, cabinet: str) -> str | None:
    """Return the cabinet mount in which a drawer is closed, or None while it is open.

    The drawer is pushed into the cabinet, to within 5 mm of its closed position.
    """
    frame = state.pose(cabinet)
    position = state.pose(drawer).position
    for region in state.info.object(cabinet).regions:
        if region.name in MOUNTS and distance(position, frame.apply(region.position)) <= GAP:
            return region.name
    return None


def opening_m(state: WorldState, drawer: ObjectSpec) -> float:
    """Return the opening of a drawer [m].

    Raises:
        ValueError: If the object has no mount.
    """
    if drawer.mount is None:
        raise ValueError(f"{drawer.name} is not a drawer")
    mount = state.info.object(drawer.mount.target).region(drawer.mount.region)
    return distance(state.pose(drawer.name).position, state.pose(drawer.mount.target).apply(mount.position))


def drawer_to_move(condition: Condition, state: WorldState, target: str) -> tuple[str, bool] | None:
    """Return the drawer to move before an object can be put into a target, and the direction.

    A drawer above the target is closed first, and then the target itself is opened.

    Returns: Drawer name and True to open it, False to close it, or None if nothing is in the way.
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
"""Relation of a closed drawer in its cabinet."""
