"""Relation "layer": an object is a certain layer of a stack. Layers are counted from the base."""

import math

from betterbench.geometry import Vector, horizontal_distance, tilt_of
from betterbench.interface.state import ObjectInfo, WorldState
from betterbench.tasks.relations.loose import held_upon, rests_on
from betterbench.tasks.relations.placing import foot, foot_offset, slim_opening_m, standing_goals, turned_by
from betterbench.tasks.relations.relation import PlaceGoal, Relation, register, surface_of
from betterbench.tasks.thresholds import threshold

LAYERS = ("1", "2", "3", "4")
"""Layers that can be on a base. The highest stack of the suite has three."""

OFFSET = threshold(
    "layer_offset",
    0.024,
    "m",
    "A layer is centered if it is at most this far from the center of the base. Within this distance, two thirds of "
    "the base's radius, a layer cannot topple, and judges accept it as stacked (docs/sides.md).",
    "Larger: layers may be off center; more success, fewer execution_failure and timeout.",
)
GAP = threshold(
    "layer_gap",
    0.006,
    "m",
    "A layer rests on the layer below if the gap is at most this large. Leaves and buns are uneven.",
    "Larger: layers may be uneven; more success, fewer execution_failure and timeout.",
)
TILT = threshold(
    "layer_tilt",
    0.175,
    "rad",
    "Largest tilt of a layer that lies flat (10 degrees).",
    "Larger: layers may be at an angle; more success, fewer execution_failure and timeout.",
)
EITHER_WAY_UP = frozenset({"patty", "cheese_slice", "lettuce_leaf", "sponge"})
"""Categories of layers that look the same on both sides, unlike a bun with its cut face."""


def layer(state: WorldState, name: str, base: str) -> str | None:
    """Return the number of the layer that an object forms in a stack, or None if the object is not properly stacked.

    Every layer from the base up to the object must lie flat on the layer below, touch it, and be centered over the
    base. A patty, a slice or a leaf may lie with either side up, but a bun must be the right way up. The base must be
    upright.

    The number is returned as a string. Layer "1" lies directly on the base.
    """
    mine = _heights_over(state, name, base)
    if mine is None or mine[0] <= state.position(base)[2]:
        return None
    if tilt_of(state.pose(base).quaternion) > TILT:
        return None
    below, top, seen = base, _faces(state, base)[1][2], {base}
    for number in LAYERS:
        on = [
            o.name for o in state.info.objects if not o.fixed and o.name not in seen and state.touching(o.name, below)
        ]
        heights = {other: mine if other == name else _heights_over(state, other, base) for other in on}
        above = [(other, h[1]) for other, h in heights.items() if h is not None and abs(h[0] - top) <= GAP]
        if len(above) != 1:
            return None  # no object is there, or two objects share the layer
        below, top = above[0]
        if below == name:
            return number
        seen.add(below)
    return None


def _layers(info: ObjectInfo) -> tuple[str, ...]:
    return LAYERS if info.role == "container" and any(r.name == "top" for r in info.regions) else ()


def _heights_over(state: WorldState, name: str, base: str) -> tuple[float, float] | None:
    """Return the heights of the lower and upper face of an object that lies flat and centered over a base [m].

    Return None if the object is tilted or off center.
    """
    info, middle = state.info.object(name), state.position(base)
    # Distant objects are ruled out early: `reach` bounds the distance between the origin of an object and the centers
    # of its faces.
    reach = max(math.hypot(*foot_offset(info)), math.hypot(*_top(info)))
    if horizontal_distance(state.position(name), middle) > OFFSET + reach:
        return None
    tilt = tilt_of(state.quaternion(name))
    if tilt > TILT and not (_inverted(state, name) and math.pi - tilt <= TILT):
        return None
    lower, upper = _faces(state, name)
    return (lower[2], upper[2]) if horizontal_distance(lower, middle) <= OFFSET else None


def _inverted(state: WorldState, name: str) -> bool:
    """Return whether an object with two equal sides lies upside down, according to the axes of its asset."""
    either = state.info.object(name).category in EITHER_WAY_UP
    return either and tilt_of(state.quaternion(name)) > 0.5 * math.pi


def _faces(state: WorldState, name: str) -> tuple[Vector, Vector]:
    """Return the centers of a layer's lower and upper face, in the world frame [m]."""
    lower, upper = foot(state, name), state.pose(name).apply(_top(state.info.object(name)))
    return (upper, lower) if _inverted(state, name) else (lower, upper)


def _top(info: ObjectInfo) -> Vector:
    """Return the center of the face that carries the next layer of the stack, in the object's frame [m]."""
    for region in info.regions:  # this loop takes a third of the time of next(), and it runs at every control step
        if region.name == "top":
            return region.position
    return (0.0, 0.0, info.size_m[2])


def _loosely(state: WorldState, name: str, base: str) -> str | None:
    """Return the number of the first missing layer if an object rests on the stack or is held on it.

    Otherwise, the result is None. The posture of the object does not matter. The object rests on the base, or on an
    object that is on the base, with its center over the base.
    """
    if not (rests_on(state, name, base) or held_upon(state, name, base)):
        return None
    taken = {layer(state, o.name, base) for o in state.info.objects if not o.fixed and o.name != base}
    return next((number for number in LAYERS if number not in taken), LAYERS[-1])


def _goals(state: WorldState, name: str, base: str, region: str) -> tuple[PlaceGoal, ...]:
    """Return place goals on top of the layer below.

    The goals are centered over the base instead of the layer below, so that offsets do not add up.
    """
    beneath = {layer(state, o.name, base): o.name for o in state.info.objects if o.name != base}
    below = beneath.get(str(int(region) - 1), base)
    x, y, _ = state.pose(base).position
    z = state.pose(below).apply(state.info.object(below).region("top").position)[2]
    yaws = turned_by(state, name, (0.0, 0.4, -0.4, 0.8, -0.8, 1.6, -1.6))
    return standing_goals(state, name, (x, y, z), yaws, release_width_m=slim_opening_m(state.info.object(name)))


LAYER = register(
    Relation(
        name="layer",
        words="{object} is layer {region} of the stack on {target}",
        where=layer,
        loosely=_loosely,
        regions=_layers,
        needs=("top",),
        tolerances=("layer_offset", "layer_gap", "layer_tilt"),
        goals=_goals,
        surface=surface_of("floor", "top"),
        counted=True,
    )
)
"""Relation "layer": the object is a layer of the stack on the target."""
