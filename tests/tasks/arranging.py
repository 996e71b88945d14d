"""Arranges things in a real scene from one line of words, lets them settle where asked, and gives the state.

A clause is "THING PLACE key=value ...", clauses are separated by semicolons, and a later one sees what an earlier one
did. Lengths are in millimeters and angles in degrees.

Places: "TARGET.REGION" is the surface of a region (for an inside its floor), "TARGET" the top of its bounding box,
"slot:NAME" the table there, "from" where the thing stands at the start, "floor" the floor of the room.
Keys: x, y, z offset in the place's frame; turn about the vertical; tilt about the axis with the heading "about"
(0 if not given); flip for upside down; open for how far a drawer is drawn out.
Words on the state: "settle" lets physics run until nothing moves, but for at most 1.5 s, "hold" for 0.1 s; "held" has
the thing in the gripper alone, "fingers" has it rest on an open finger, "moving" gives it a speed.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import mujoco
import numpy as np

from betterbench.geometry import Pose, Quaternion, from_axis_angle, from_yaw, multiply, normalize, rotate, yaw_of
from betterbench.interface.actions import EE_DELTA
from betterbench.interface.state import Contact, WorldState
from betterbench.sim.scenes import Scene
from betterbench.sim.scenes.stage import quality_preset
from betterbench.tasks import Condition, get_task
from betterbench.tasks.interventions import vary

MM = 1e-3
SUNK_M = 2e-4
"""Depth by which what is posed without settling is sunk into what it stands on, so that the engine sees the contact."""
FLOOR_M = -0.74
STILL_M_S, STILL_RAD_S = 1e-4, 1e-3
STAY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0])
_FLAGS = ("settle", "hold", "held", "fingers", "moving", "flip")


def condition_of(setting: str) -> Condition:
    task_id, _, name = setting.partition("/")
    task = get_task(task_id)
    return task.train(name) if name.startswith("train") else vary(task, task.variation(name))[0]


@functools.cache
def scene_of(setting: str) -> Scene:
    condition = condition_of(setting)
    task = get_task(condition.task)
    return Scene(task, condition, seed=0, action_space=EE_DELTA, quality=quality_preset("fast"))


@dataclasses.dataclass(frozen=True)
class Clause:
    thing: str
    place: str
    numbers: dict[str, float]
    flags: frozenset[str]


def clauses_of(text: str) -> list[Clause]:
    found = []
    for part in text.split(";"):
        thing, place, *words = part.split()
        flags = {w for w in words if "=" not in w}
        assert flags <= set(_FLAGS), f"unknown words {flags - set(_FLAGS)} in {part!r}"
        numbers = {key: float(value) for key, _, value in (w.partition("=") for w in words if "=" in w)}
        found.append(Clause(thing, place, numbers, frozenset(flags)))
    return found


def arranged(setting: str, text: str) -> tuple[WorldState, WorldState]:
    """Returns the state at reset and the state after a line of words."""
    scene = scene_of(setting)
    start = scene.reset(check_premise=False)
    clauses = clauses_of(text)
    for clause in clauses:
        pose_thing(scene, clause)
    if any("settle" in c.flags for c in clauses):
        state = settled(scene)
    else:
        for _ in range(2 if any("hold" in c.flags for c in clauses) else 0):
            scene.step(STAY)
        state = scene.state()
    for clause in clauses:
        state = touched(state, clause)
    return start, state


def settled(scene: Scene) -> WorldState:
    """Returns the state after 1.5 s, or as soon as nothing has moved for a fifth of a second."""
    still = 0
    for _ in range(30):
        scene.step(STAY)
        state = scene.state()
        at_rest = max(state.linear_speeds) < STILL_M_S and max(state.angular_speeds) < STILL_RAD_S
        still = still + 1 if at_rest else 0
        if still == 4:
            break
    return state


@functools.cache
def states_of(setting: str, text: str) -> tuple[WorldState, WorldState]:
    """Returns what `arranged` returns, which several tests ask for; the scene itself is left as it is."""
    return arranged(setting, text)


def one_step_before(state: WorldState, text: str) -> WorldState:
    """Returns the state 50 ms earlier: what moves, at 0.2 m/s, was 1 cm away."""
    positions = list(state.positions)
    for clause in clauses_of(text):
        if "moving" in clause.flags:
            i = state.info.index(clause.thing)
            x, y, z = positions[i]
            positions[i] = (x - 0.01, y, z)
    return dataclasses.replace(state, positions=tuple(positions))


def pose_thing(scene: Scene, clause: Clause) -> None:
    state = scene.state()
    i = scene.info.index(clause.thing)
    address = scene.compiled.qpos_addresses[i]
    if "open" in clause.numbers:
        scene.data.qpos[address] = clause.numbers["open"] * MM
    else:
        pose = pose_of(state, clause)
        scene.data.qpos[address : address + 3] = pose.position
        scene.data.qpos[address + 3 : address + 7] = pose.quaternion
    mujoco.mj_forward(scene.model, scene.data)


def surface(state: WorldState, clause: Clause) -> Pose:
    """Returns the frame that a clause is told in."""
    if clause.place == "floor":
        return Pose((0.9, 0.0, FLOOR_M))
    if clause.place == "from":
        return state.pose(clause.thing)
    if clause.place.startswith("slot:"):
        slot = state.info.slot(clause.place.removeprefix("slot:"))
        return Pose(slot.position, from_yaw(slot.yaw))
    target, _, region = clause.place.partition(".")
    frame, info = state.pose(target), state.info.object(target)
    if not region:
        return Pose(frame.apply((0.0, 0.0, info.size_m[2])), frame.quaternion)
    found = info.region(region)
    x, y, z = found.position
    depth = found.half_size[2] if region == "inside" else 0.0
    return Pose(frame.apply((x, y, z - depth)), frame.quaternion)


def orientation(clause: Clause) -> Quaternion:
    n = clause.numbers
    about, tilt = math.radians(n.get("about", 0.0)), math.radians(n.get("tilt", 0.0))
    if "flip" in clause.flags:
        tilt += math.pi
    tipped = from_axis_angle((math.cos(about) * tilt, math.sin(about) * tilt, 0.0))
    return normalize(multiply(tipped, from_yaw(math.radians(n.get("turn", 0.0)))))


def pose_of(state: WorldState, clause: Clause) -> Pose:
    frame, n = surface(state, clause), clause.numbers
    level = Pose(frame.position, from_yaw(yaw_of(frame.quaternion)))
    q = normalize(multiply(level.quaternion, orientation(clause)))
    info = state.info.object(clause.thing)
    sx, sy, sz = info.size_m
    upright = n.get("tilt", 0.0) == 0.0
    base = next((r.position for r in info.regions if r.name == "base"), (0.0, 0.0, 0.0))
    anchor = base if upright else (0.0, 0.0, 0.5 * sz)
    corners = [rotate(q, (a * sx, b * sy, c * sz)) for a in (-0.5, 0.5) for b in (-0.5, 0.5) for c in (0.0, 1.0)]
    low = min(corner[2] for corner in corners)
    x, y, z = level.apply((n.get("x", 0.0) * MM, n.get("y", 0.0) * MM, n.get("z", 0.0) * MM))
    ax, ay, _ = rotate(q, anchor)
    return Pose((x - ax, y - ay, z - low - SUNK_M), q)


def touched(state: WorldState, clause: Clause) -> WorldState:
    """Returns the state with what the words of a clause say about the gripper."""
    thing = clause.thing
    if "held" in clause.flags:
        kept = tuple(c for c in state.contacts if thing not in (c.a, c.b))
        grip = (Contact(thing, "left_finger", 5.0), Contact(thing, "right_finger", 5.0))
        state = dataclasses.replace(state, contacts=kept + grip, held=thing)
    if "fingers" in clause.flags:
        state = dataclasses.replace(state, contacts=(*state.contacts, Contact(thing, "left_finger", 1.0)))
    return state
