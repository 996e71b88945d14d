"""Relation "on_plate": an object is in the middle of a plate."""

from betterbench.geometry import tilt_of
from betterbench.interface.state import WorldState
from betterbench.tasks.relations.loose import held_upon, rests_on
from betterbench.tasks.relations.placing import foot, standing_goals, turned_by
from betterbench.tasks.relations.relation import PlaceGoal, Relation, offers, register, single, surface_of
from betterbench.tasks.thresholds import THRESHOLDS, threshold

OFFSET = threshold(
    "plate_offset",
    0.049,
    "m",
    "An object that lies flat on a plate's floor is on the plate if it is at most this far from the plate's center. "
    "Judges accepted all plates up to 4.7 cm. They accepted none at 5.1 cm or more, where a plate rests on the rim "
    "(docs/sides.md).",
    "Larger: plates may be off center; more success, fewer execution_failure and timeout.",
)
GAP = threshold(
    "plate_gap",
    0.004,
    "m",
    "An object stands on a plate if its base is at most this far above the plate's floor.",
    "Larger: plates may rest higher, on a rim; more success, fewer execution_failure and timeout.",
)
RIM_RELEASE_M = 0.03
"""Gripper opening at the release of a plate whose rim is between the fingers [m]."""


def on_plate(state: WorldState, name: str, plate: str) -> bool:
    """Return whether an object stands on a plate.

    The object must lie flat on the floor of the plate, near the center, and touch the plate. An object that rests on
    the rim or on a third object is not on the plate.
    """
    if name == plate or not state.touching(name, plate):
        return False
    x, y, z = state.pose(plate).inverse().apply(foot(state, name))
    fx, fy, fz = state.info.object(plate).region("floor").position
    if (x - fx) ** 2 + (y - fy) ** 2 > OFFSET**2 or abs(z - fz) > GAP:
        return False
    return tilt_of(state.pose(name).quaternion) <= THRESHOLDS.upright_tilt


def _loosely(state: WorldState, name: str, plate: str) -> str | None:
    """Return the region "" if an object is on or over a plate in any posture, and None otherwise.

    The object rests on the plate, rests on another object on the plate, or is held over the plate.
    """
    there = name != plate and (rests_on(state, name, plate) or held_upon(state, name, plate))
    return "" if there else None


def _goals(state: WorldState, name: str, plate: str, _region: str) -> tuple[PlaceGoal, ...]:
    floor = state.pose(plate).apply(state.info.object(plate).region("floor").position)
    yaws = turned_by(state, name, (0.0, 0.4, -0.4, 0.8, -0.8, 1.6, -1.6))
    return standing_goals(state, name, floor, yaws, release_width_m=RIM_RELEASE_M)


ON_PLATE = register(
    Relation(
        name="on_plate",
        words="{object} stands on {target}",
        where=single(on_plate),
        loosely=_loosely,
        regions=offers("floor"),
        needs=("floor",),
        tolerances=("plate_offset", "plate_gap"),
        goals=_goals,
        surface=surface_of("floor"),
    )
)
"""Relation "on_plate": the object stands on the plate."""
