"""Relation "on_ring": an object is centered on a marked ring, and its handle is clear of the spout."""

import math

from betterbench.geometry import Pose, from_yaw, horizontal_distance, rotate, yaw_of
from betterbench.interface.state import WorldState
from betterbench.tasks.relations.loose import middle
from betterbench.tasks.relations.placing import RELEASE_GAP_M, far_apart, foot, foot_offset
from betterbench.tasks.relations.relation import PlaceGoal, Relation, offers, register, single, surface_of
from betterbench.tasks.relations.rest import upright
from betterbench.tasks.thresholds import threshold

RADIUS = threshold(
    "ring_radius",
    0.015,
    "m",
    "A mug is centered in its ring if it is at most this far from the center. Judges accept 11 mm and are unsure up "
    "to 16 mm (docs/sides.md).",
    "Larger: mugs may be off center; more success, fewer execution_failure and timeout.",
)
HEIGHT = threshold(
    "ring_height",
    0.006,
    "m",
    "A mug stands on the ring if it is at most this far above the ring's plane.",
    "Larger: mugs may be higher, for example on an edge; more success, fewer execution_failure and timeout.",
)
SPOUT = threshold(
    "spout_margin",
    0.003,
    "m",
    "Free distance between handle and spout, seen from above.",
    "Larger: handles must be farther from the spout; less success, more execution_failure.",
)

ENTRY_M, ENTRY_RISE_M = 0.13, 0.012
"""Length and rise of the straight approach below the overhanging head of a fixture [m]."""
TURNS_RAD = (0.0, *(sign * step for step in (0.15, 0.3, 0.5, 0.7) for sign in (1.0, -1.0)))
"""Rotations from the heading at which the handle is farthest from the spout [rad], smallest first."""


def on_ring(state: WorldState, name: str, fixture: str) -> bool:
    """Return whether an object stands on the ring of a fixture.

    The object must be upright, and its base must be at the height of the ring and within 15 mm of the ring's center. If
    it has a handle, the handle must not be under the spout.
    """
    info = state.info
    region, offset = info.object(fixture).region("ring").position, foot_offset(info.object(name))
    reach = math.hypot(*region) + math.hypot(*offset) + RADIUS + HEIGHT
    if far_apart(state, name, fixture, reach):
        return False
    ring = state.pose(fixture).apply(region)
    position = foot(state, name)
    if horizontal_distance(position, ring) > RADIUS:
        return False
    if abs(position[2] - ring[2]) > HEIGHT or not upright(state, name):
        return False
    return handle_clear(state, name, fixture)


def _loosely(state: WorldState, name: str, fixture: str) -> str | None:
    """Return the region "" if an object is on or over the ring in any posture, and None otherwise.

    The object may be off center or on its side. The center or the foot of the object must be over the disc of the ring
    and below the spout. This includes objects that the gripper holds there.
    """
    target, frame = state.info.object(fixture), state.pose(fixture)
    ring, spout = target.region("ring"), target.region("spout")
    x, y, z = frame.apply(ring.position)
    top = frame.apply(spout.position)[2]
    over = (
        horizontal_distance(point, (x, y)) <= ring.half_size[0] and z - HEIGHT <= point[2] <= top
        for point in (foot(state, name), middle(state, name))
    )
    return "" if any(over) else None


def handle_clear(state: WorldState, name: str, fixture: str) -> bool:
    """Return whether all corners of an object's handle are clear of the fixture's spout, seen from above."""
    handles = [r for r in state.info.object(name).regions if r.name == "handle"]
    spout = state.info.object(fixture).region("spout")
    to_spout = (state.pose(fixture) @ spout.pose).inverse()
    hx, hy = spout.half_size[0] + SPOUT, spout.half_size[1] + SPOUT
    for handle in handles:
        to_world = state.pose(name) @ handle.pose
        sx, sy, sz = handle.half_size
        for cx in (-sx, 0.0, sx):
            for cy in (-sy, sy):
                x, y, _ = to_spout.apply(to_world.apply((cx, cy, sz)))
                if abs(x) < hx and abs(y) < hy:
                    return False
    return True


def _goals(state: WorldState, name: str, fixture: str, _region: str) -> tuple[PlaceGoal, ...]:
    """Return place goals on the ring of a fixture.

    The object slides in from the front of the fixture, below its overhanging head.
    """
    frame, info = state.pose(fixture), state.info.object(name)
    x, y, z = frame.apply(state.info.object(fixture).region("ring").position)
    facing = yaw_of(frame.quaternion)
    has_handle = any(r.name == "handle" for r in info.regions)
    base = 0.0 if has_handle else yaw_of(state.pose(name).quaternion) - facing
    front = rotate(frame.quaternion, (ENTRY_M, 0.0, 0.0))
    approach = (front[0], front[1], ENTRY_RISE_M)
    goals = []
    for turn in TURNS_RAD:
        turned = from_yaw(facing + base + turn)
        fx, fy, fz = rotate(turned, foot_offset(info))
        goals.append(PlaceGoal(Pose((x - fx, y - fy, z - fz + RELEASE_GAP_M), turned), approach))
    return tuple(goals)


ON_RING = register(
    Relation(
        name="on_ring",
        words="{object} stands on the ring of {target}",
        where=single(on_ring),
        loosely=_loosely,
        regions=offers("ring", "spout"),
        needs=("ring", "spout"),
        tolerances=("ring_radius", "ring_height", "spout_margin"),
        goals=_goals,
        surface=surface_of("ring"),
    )
)
"""Relation "on_ring": the object stands on the marked ring of the fixture."""
