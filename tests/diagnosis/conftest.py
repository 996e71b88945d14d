"""A stage for scripted culprits: a kinematic world that writes records without a simulator."""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from betterbench.diagnosis import trial
from betterbench.geometry import IDENTITY_QUATERNION, Pose, Quaternion, conjugate, from_yaw, multiply, rotate
from betterbench.interface.state import Contact, ObjectInfo, Region, SceneInfo, SlotInfo, WorldState
from betterbench.records import Record, RecordBuilder, RecordMetadata
from betterbench.tasks import Condition, GoalTracker, training_distribution_of
from betterbench.tasks.interventions.resolve import resolve_condition
from betterbench.tasks.relations import relation

HOME = (0.31, 0.0, 0.59)
RATE = 20.0
DOWN = (0.0, 1.0, 0.0, 0.0)
FAST = 0.5  # m/s, so that records stay short
RING = 0.02
HOLES = ((1, -0.085), (2, 0.0), (3, 0.085))

LOOKS = {  # size, color, shape
    "burger": ((0.066, 0.066, 0.052), "brown", "round"),
    "round_block": ((0.066, 0.066, 0.052), "brown", "round"),
    "fries_box": ((0.04, 0.06, 0.10), "red", "box"),
    "drink_cup": ((0.07, 0.07, 0.12), "white", "cylinder"),
    "takeaway_box": ((0.20, 0.14, 0.16), "brown", "box"),
    "mug": ((0.07, 0.07, 0.09), "", "cylinder"),
    "can": ((0.066, 0.066, 0.12), "red", "cylinder"),
    "coffee_machine": ((0.25, 0.20, 0.33), "black", "box"),
    "laptop": ((0.21, 0.25, 0.15), "silver", "box"),
    "computer_mouse": ((0.105, 0.061, 0.036), "black", "irregular"),
    "soap_bar": ((0.10, 0.06, 0.035), "gray", "irregular"),
    "speaker": ((0.067, 0.065, 0.10), "black", "box"),
    "place_plate": ((0.19, 0.19, 0.018), "white", "round"),
    "cereal_bowl": ((0.119, 0.119, 0.052), "white", "round"),
    "egg_cup": ((0.05, 0.05, 0.07), "white", "irregular"),
    "jam_jar": ((0.058, 0.059, 0.073), "red", "cylinder"),
    "salt_shaker": ((0.039, 0.039, 0.074), "white", "cylinder"),
    "cup": ((0.068, 0.067, 0.062), "blue", "cylinder"),
    "tumbler": ((0.066, 0.066, 0.088), "blue", "cylinder"),
    "fork": ((0.16, 0.031, 0.013), "silver", "irregular"),
    "spoon": ((0.16, 0.034, 0.013), "silver", "irregular"),
    "lunchbox": ((0.34, 0.26, 0.25), "blue", "box"),
    "apple": ((0.068, 0.07, 0.07), "red", "round"),
    "orange": ((0.069, 0.069, 0.069), "orange", "round"),
    "lemon": ((0.082, 0.057, 0.056), "yellow", "round"),
    "block": ((0.045, 0.045, 0.045), "red", "box"),
    "waste_bin": ((0.207, 0.206, 0.114), "black", "cylinder"),
    "keyboard": ((0.114, 0.283, 0.021), "black", "box"),
    "crumpled_napkin": ((0.061, 0.061, 0.054), "white", "irregular"),
    "crushed_can": ((0.068, 0.068, 0.058), "red", "irregular"),
    "drawer_cabinet": ((0.22, 0.24, 0.17), "white", "box"),
    "upper_drawer": ((0.244, 0.236, 0.076), "white", "box"),
    "lower_drawer": ((0.244, 0.236, 0.076), "white", "box"),
    "stapler": ((0.127, 0.035, 0.051), "red", "irregular"),
    "stapler_block": ((0.126, 0.036, 0.055), "red", "irregular"),
    "tape_roll": ((0.067, 0.067, 0.024), "blue", "round"),
    "bun_bottom": ((0.08, 0.08, 0.02), "brown", "round"),
    "bun_top": ((0.072, 0.072, 0.034), "brown", "round"),
    "patty": ((0.067, 0.067, 0.02), "brown", "round"),
    "cheese_slice": ((0.062, 0.062, 0.012), "yellow", "box"),
    "lettuce_leaf": ((0.066, 0.065, 0.012), "green", "round"),
    "sponge": ((0.063, 0.063, 0.0135), "yellow", "box"),
    "spice_rack": ((0.073, 0.27, 0.041), "brown", "box"),
    "spice_jar": ((0.043, 0.043, 0.085), "black", "cylinder"),
    "plain_salt_jar": ((0.043, 0.043, 0.085), "gray", "cylinder"),
    "plain_pepper_jar": ((0.043, 0.043, 0.085), "gray", "cylinder"),
    "plain_paprika_jar": ((0.043, 0.043, 0.085), "gray", "cylinder"),
    "pill_bottle": ((0.043, 0.043, 0.085), "white", "cylinder"),
    "serving_plate": ((0.196, 0.196, 0.0205), "white", "round"),
    "dinner_plate": ((0.158, 0.158, 0.0205), "white", "round"),
    "shallow_bowl": ((0.142, 0.142, 0.060), "red", "round"),
}
REGIONS = {
    "takeaway_box": (Region("inside", (0.0, 0.0, 0.075), (0.09, 0.06, 0.07)),),
    "coffee_machine": (
        Region("ring", (0.12, 0.0, RING), (0.04, 0.04, 0.001)),
        Region("spout", (0.12, 0.0, 0.2), (0.01, 0.01, 0.02)),
    ),
    "laptop": (
        Region("right", (0.023, 0.20, 0.0), (0.035, 0.035, 0.02)),
        Region("left", (0.023, -0.20, 0.0), (0.035, 0.035, 0.02)),
        Region("behind", (-0.172, 0.0, 0.0), (0.035, 0.035, 0.02)),
    ),
    "place_plate": (
        Region("left", (0.02, -0.14, 0.0), (0.03, 0.022, 0.02)),
        Region("right", (0.02, 0.14, 0.0), (0.03, 0.022, 0.02)),
        Region("upper_right", (-0.13, 0.10, 0.0), (0.03, 0.03, 0.02)),
    ),
    "lunchbox": (Region("inside", (0.054, 0.0, 0.035), (0.10, 0.12, 0.029)),),
    "waste_bin": (Region("inside", (0.0, 0.0, 0.06), (0.064, 0.064, 0.054)),),
    "drawer_cabinet": (
        Region("upper", (0.0325, 0.0, 0.091), (0.1055, 0.108, 0.036)),
        Region("lower", (0.0325, 0.0, 0.0105), (0.1055, 0.108, 0.036)),
    ),
    "upper_drawer": (
        Region("inside", (-0.003, 0.0, 0.032), (0.0825, 0.096, 0.026)),
        Region("knob", (0.1445, 0.07, 0.03), (0.008, 0.01, 0.015)),
    ),
    "lower_drawer": (
        Region("inside", (-0.003, 0.0, 0.032), (0.0825, 0.096, 0.026)),
        Region("knob", (0.1445, -0.07, 0.03), (0.008, 0.01, 0.015)),
    ),
    "bun_bottom": (Region("top", (0.0, 0.0, 0.02), (0.039, 0.039, 0.001)),),
    "spice_rack": tuple(Region(f"hole_{k}", (0.0, y, 0.006), (0.004, 0.004, 0.035)) for k, y in HOLES),
    **{
        plate: (Region("floor", (0.0, 0.0, 0.0105), (0.075, 0.075, 0.001)),)
        for plate in ("dinner_plate", "serving_plate", "shallow_bowl")
    },
}
LAYERS = ("bun_bottom", "bun_top", "patty", "cheese_slice", "lettuce_leaf", "sponge")
KNOB_M, RIM_M, DRAWER_TRAVEL = 0.02, 0.01, 0.16


@functools.cache
def turned(posture: Quaternion, yaw: float) -> Quaternion:
    """A posture of an object that has been turned about the vertical."""
    return multiply(posture, from_yaw(yaw))


@functools.cache
def action_of(command: float) -> np.ndarray:
    return np.full(7, command)


STILL, MOVING = (0.0,) * 7, (0.3,) * 7
NO_JOINTS, NO_MOTORS = np.zeros(3), np.zeros(2)
"""State of a simulator that there is not; the same arrays in each row, so that they are read once."""


class Stage:
    """One episode, acted out step by step; every method that moves time appends rows."""

    def __init__(
        self, task: str, name: str, *, seed: int = 0, policy: str = "scripted", backwards: bool = False
    ) -> None:
        self.setting = resolve_condition(task, name)
        self.condition = self.setting.condition
        self.task = self.setting.task
        rng = np.random.default_rng(seed)
        self.info = self._scene(backwards=backwards)
        self.names = [o.name for o in self.info.objects]
        self.carriers = {o.name: o for o in self.info.objects if o.regions or o.category in LAYERS}
        self.bearing: tuple = ()
        self.supported: dict[str, tuple[tuple[float, ...], tuple[float, str]]] = {}
        self.positions = {}
        for o in self.condition.objects:
            if o.name in self.condition.layout:
                slot = self.task.slot(self.condition.layout[o.name])
                jitter = rng.uniform(-slot.jitter_m, slot.jitter_m, 2)
                self.positions[o.name] = np.array([slot.x + jitter[0], slot.y + jitter[1], 0.0])
        self.postures: dict[str, Quaternion] = {o.name: IDENTITY_QUATERNION for o in self.info.objects}
        self.yaws = {o.name: self.task.slot(o.slot).yaw if o.slot else 0.0 for o in self.info.objects}
        self.tool, self.width, self.command = np.array(HOME), 0.08, -1.0
        self.grip: str | None = None
        self.jams = False  # what is between the fingers stays there when they open
        self.slipped = ""
        self.rails: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for o in self.condition.objects:
            if o.mount is not None:
                self._mount(o.name, o.mount.target, o.mount.region)
        for preplaced, where in self.condition.preplaced.items():
            self.positions[preplaced] = self.place(self.task.template.relation, where.target, where.region)
        self.grip_offset = np.zeros(3)
        self.fall: dict[str, float] = {}
        self.tracker = GoalTracker(self.condition, self.info, template=self.task.template, control_rate_hz=RATE)
        variation = None if self.condition.name == self.setting.base else self.condition.name
        self.metadata = RecordMetadata(
            task=task, task_version=self.task.version, suite_version="1.0", package_version="0.1.0",
            condition=self.condition.name, variation=variation, axis=self.setting.axis,
            base_condition=self.setting.base if variation else None, interventions=(), seed=seed, policy=policy,
            instruction=self.condition.instruction.text, expected=self.condition.expected.value,
            action_space="ee_delta", action_components=("x", "y", "z", "rx", "ry", "rz", "gripper"),
            control_rate_hz=RATE, camera_preset=None, render_quality=None,
            engine={"mujoco": "3.17.0", "model": f"{seed:016x}"}, scene_hash="0f" * 16, scene=self.info,
            predicate_names=self.tracker.relation_names, subgoal_names=self.tracker.subgoal_names,
        )  # fmt: skip
        self.builder = RecordBuilder(self.metadata)
        self.previous = self.places()
        self.step, self.succeeded = 0, False
        self._append()

    def _scene(self, *, backwards: bool) -> SceneInfo:
        """Describes the scene; its objects can be listed in the opposite order."""
        trained = training_distribution_of(self.task)
        objects = []
        for o in self.condition.objects:
            size, color, shape = LOOKS[o.category]
            regions, slot = REGIONS.get(o.category, ()), self.condition.layout.get(o.name)
            info = ObjectInfo(
                o.name, o.kind, o.category, o.category, o.color or color, shape, o.role, o.fixed, 0.2, size,
                regions, slot, keeps_upright=o.category == "drink_cup",
            )  # fmt: skip
            objects.append(info)
        slots = tuple(
            SlotInfo(s.name, (s.x, s.y, 0.0), s.yaw, trained.standing_kinds.get(s.name, ())) for s in self.task.slots
        )
        return SceneInfo(tuple(reversed(objects)) if backwards else tuple(objects), slots, HOME, 0.08)

    def size(self, name: str) -> tuple[float, float, float]:
        return self.info.object(name).size_m

    def of(self, kind: str, slot: str | None = None) -> str:
        """Names an object of a kind."""
        return next(o.name for o in self.info.of_kind(kind) if slot is None or o.slot == slot)

    def at(self, slot: str) -> str:
        return next(o.name for o in self.info.objects if o.slot == slot)

    def slot(self, name: str) -> np.ndarray:
        return np.array(self.info.slot(name).position)

    def _mount(self, drawer: str, cabinet: str, at: str) -> None:
        """Puts a drawer on its rails: where it is when shut, and the way that it comes out."""
        frame = Pose(tuple(self.positions[cabinet]), from_yaw(self.yaws[cabinet]))
        shut = np.array(frame.apply(self.info.object(cabinet).region(at).position))
        out = np.array(frame.apply((1.0, 0.0, 0.0))) - np.array(frame.apply((0.0, 0.0, 0.0)))
        self.rails[drawer] = shut, out
        self.yaws[drawer] = self.yaws[cabinet]
        self.positions[drawer] = shut + self.condition.opened.get(drawer, 0.0) * out

    def grip_point(self, name: str) -> np.ndarray:
        """Where fingers take an object: in its middle, a plate at its rim, a drawer at its knob."""
        o, p = self.info.object(name), self.positions[name]
        frame = Pose(tuple(p), from_yaw(self.yaws[name]))
        if o.role == "drawer":
            return np.array(frame.apply(o.region("knob").position))
        if self.grip_width(name) == RIM_M:
            return p + np.array([0.5 * o.size_m[0] - 0.005, 0.0, 0.03])
        return p + np.array([0.0, 0.0, 0.5 * o.size_m[2]])

    def grip_width(self, name: str) -> float:
        """How far apart the fingers stay on an object."""
        o = self.info.object(name)
        if o.role == "drawer":
            return KNOB_M
        return RIM_M if min(o.size_m[:2]) > 0.08 else min(o.size_m[:2])

    def goal(self, k: int = 0) -> np.ndarray:
        """Where an object has to stand for a subgoal."""
        goal = self.condition.instruction.subgoals[k]
        return self.place(goal.relation, goal.target, goal.region)

    def place(self, relation: str, target: str, region: str = "") -> np.ndarray:
        """Where an object stands in a relation to a target."""
        info, at = self.info.object(target), self.positions[target]
        frame = Pose(tuple(at), from_yaw(self.yaws[target]))
        if relation == "inside":
            (x, y, z), half = info.region("inside").position, info.region("inside").half_size
            inside = sum(np.hypot(*(self.positions[n] - at)[:2]) < 0.12 for n in self.movable() if n in self.positions)
            return np.array(frame.apply((x - 0.05 + 0.04 * (inside % 3), y, z - half[2] + 0.001)))
        if relation == "layer":
            top = self.support("", at[:2], 1.0)[0]
            return np.array([at[0], at[1], top])
        name = {"on_ring": "ring", "on_plate": "floor"}.get(relation, region)
        return np.array(frame.apply(info.region(name).position))

    def goal_place(self) -> np.ndarray:
        """Where the next object has to stand to be at the target of the first subgoal."""
        return self.goal(0)

    def movable(self) -> list[str]:
        return [o.name for o in self.info.objects if not o.fixed and o.role in ("item", "distractor")]

    # -- time -------------------------------------------------------------------------------------------------

    def tick(self) -> None:
        """Advances one control step."""
        moving = 0.01 if self.command > 0 else -0.01 if self.command < 0 else 0.0
        width = min(0.08, max(0.0, self.width - moving))
        if self.command > 0:
            between = self.between()
            if between == self.slipped:
                between = None
            if between is not None and width <= self.grip_width(between):
                width = self.grip_width(between)
                if self.grip is None:
                    self.grip, self.grip_offset = between, self.positions[between] - self.tool
        else:
            self.slipped = ""
        if self.command < 0 and self.grip is not None and width > self.grip_width(self.grip) and not self.jams:
            if self.grip not in self.rails:
                self.fall[self.grip] = 0.0
            self.grip = None
        self.width = width
        if self.grip in self.rails:
            self._slide(self.grip)
        elif self.grip is not None:
            self.positions[self.grip] = self.tool + self.grip_offset
        for name in list(self.fall):
            self.fall[name] += 9.81 / RATE
            z, rest = self.positions[name][2], self.support(name)[0]
            self.positions[name] = np.array([*self.positions[name][:2], max(rest, z - self.fall[name] / RATE)])
            if self.positions[name][2] <= rest:
                del self.fall[name]
        self.step += 1
        self._append()

    def _slide(self, drawer: str) -> None:
        """Moves a drawer along its rails with the hand, and what is in it with the drawer."""
        shut, out = self.rails[drawer]
        opening = float(np.clip((self.tool + self.grip_offset - shut) @ out, 0.0, DRAWER_TRAVEL))
        step = shut + opening * out - self.positions[drawer]
        for name in self.movable():
            if self.support(name)[1] == drawer:
                self.positions[name] = self.positions[name] + step
        self.positions[drawer] = self.positions[drawer] + step

    def between(self) -> str | None:
        """Names the object between the fingers."""
        if self.grip is not None:
            return self.grip
        for name in (*self.movable(), *self.rails):
            if name in self.rails or self.grip_width(name) == RIM_M:
                if np.linalg.norm(self.tool - self.grip_point(name)) < 0.02:
                    return name
                continue
            x, y, z = self.tool - self.positions[name]
            if np.hypot(x, y) < 0.02 and 0.0 <= z <= self.size(name)[2]:
                return name
        return None

    def support(self, name: str, spot: np.ndarray | None = None, below: float | None = None) -> tuple[float, str]:
        """Returns the height on which an object comes to rest, and what carries it there."""
        x, y = (self.positions[name][:2] if spot is None else spot).tolist()
        height = self.positions[name].tolist()[2] if below is None else below
        found = [(0.0, "table")]
        for carrier, o in self.carriers.items():
            carried = carrier == self.grip and carrier not in self.rails
            if carrier == name or carried or carrier not in self.positions:
                continue
            at = self.positions[carrier].tolist()
            base = at[2]
            dx, dy, _ = rotate(conjugate(turned(IDENTITY_QUATERNION, self.yaws[carrier])), (x - at[0], y - at[1], 0.0))
            for region in o.regions:
                rx, ry = dx - region.position[0], dy - region.position[1]
                within = abs(rx) <= region.half_size[0] and abs(ry) <= region.half_size[1]
                if region.name == "inside" and within:
                    found.append((base + region.position[2] - region.half_size[2] + 0.001, carrier))
                if (region.name == "ring" and math.hypot(rx, ry) < 0.06) or (
                    (region.name.startswith("hole_") or region.name == "floor") and within
                ):
                    found.append((base + region.position[2], carrier))
            if o.category in LAYERS and math.hypot(dx, dy) < 0.035:
                found.append((base + o.size_m[2], carrier))
        return max((f for f in found if f[0] <= height + 1e-6), default=found[0])

    def places(self) -> dict[str, tuple[float, float, float]]:
        """Returns where each object is; the values stay when the arrays are written to."""
        return {n: tuple(p.tolist()) for n, p in self.positions.items()}

    def supports(self, places: dict[str, tuple[float, float, float]]) -> dict[str, tuple[float, str]]:
        """Returns what carries each object that is on no rails; worked out again if it or a carrier has moved."""
        bearing = (
            self.grip if self.grip in self.carriers else None, tuple(self.yaws.values()),
            *(places.get(name) for name in self.carriers),
        )  # fmt: skip
        if bearing != self.bearing:
            self.bearing, self.supported = bearing, {}
        known, found = self.supported, {}
        for name, at in places.items():
            if name not in self.rails:
                if name not in known or known[name][0] != at:
                    known[name] = at, self.support(name)
                found[name] = known[name][1]
        return found

    def state(self) -> WorldState:
        """Returns the state; while nothing moves, the one before at its own time."""
        places = self.places()
        there = (
            self.grip, self.pushing, self.width, self.command, self.tool.tolist(), places,
            list(self.yaws.values()), list(self.postures.values()),
        )  # fmt: skip
        if there != self.seen[0]:
            self.seen = there, None  # the next one may be the same, but for its speeds
            return self.new_state(places)
        if self.seen[1] is None:
            self.seen = there, self.new_state(places)
        return replace(self.seen[1], step=self.step, time_s=self.step / RATE)

    seen: tuple[tuple, WorldState | None] = ((), None)

    def new_state(self, places: dict[str, tuple[float, float, float]]) -> WorldState:
        supports = self.supports(places)
        contacts = []
        for name in self.names:
            if self.pushing == name:
                contacts.append(Contact(name, "left_finger", 3.0))
            if self.grip == name:
                contacts += [Contact(name, "left_finger", 10.0), Contact(name, "right_finger", 10.0)]
            if name in self.rails:
                continue
            height, carrier = supports[name]
            if places[name][2] - height <= 1e-3:
                contacts.append(Contact(name, carrier, 1.0))
        lifted = self.grip is not None and self.grip not in self.rails
        held = self.grip if lifted and places[self.grip][2] - supports[self.grip][0] > 0.003 else None
        before, at = self.previous, tuple(self.tool.tolist())
        moving = max(abs(now - last) for now, last in zip(at, self.last_tool, strict=True)) >= 1e-6
        tool = Pose(at, DOWN)
        return WorldState(
            info=self.info, step=self.step, time_s=self.step / RATE, positions=tuple(places[n] for n in self.names),
            quaternions=tuple(turned(self.postures[n], self.yaws[n]) for n in self.names),
            linear_speeds=tuple(
                0.0 if places[n] == before[n] else math.dist(places[n], before[n]) * RATE for n in self.names
            ),
            angular_speeds=(0.0,) * len(self.names), ee_pose=tool, commanded_pose=tool,
            finger_width_m=self.width, gripper_command=self.command, joint_positions=(*at, 0.0, 0.0, 0.0, 0.0),
            joint_velocities=MOVING if moving else STILL, contacts=tuple(contacts), held=held,
        )  # fmt: skip

    last_tool = HOME

    def _append(self) -> None:
        state = self.state()
        truth = self.tracker.update(state)
        action = None if self.step == 0 else action_of(self.command)
        self.builder.append(
            state, qpos=NO_JOINTS, qvel=NO_JOINTS, ctrl=NO_MOTORS, action=action, applied=action,
            predicates=truth.relations, subgoals=truth.subgoals, goal=truth.goal, forbidden=truth.forbidden,
        )  # fmt: skip
        self.succeeded, self.done = self.succeeded or truth.success, truth.subgoals
        self.previous, self.last_tool = self.places(), tuple(self.tool.tolist())

    pushing = ""

    def push(self, name: str, x: float, y: float, speed: float = 0.15) -> Stage:
        """Comes down beside an object with an open hand and pushes it by (x, y)."""
        way = np.array([x, y])
        start = self.positions[name][:2] - 0.06 * way / np.linalg.norm(way)
        self.over(start).go(*start, 0.03)
        self.pushing = name
        for _ in range(steps := round(np.linalg.norm(way) * RATE / speed)):
            self.tool = self.tool + np.array([x, y, 0.0]) / steps
            self.positions[name] = self.positions[name] + np.array([x, y, 0.0]) / steps
            self.tick()
        self.pushing = ""
        return self.lift()

    def lose(self) -> Stage:
        """Lets what is in the hand slip, although the hand stays closed."""
        assert self.grip is not None
        self.fall[self.grip], self.slipped, self.grip = 0.0, self.grip, None
        return self.wait(0.5)

    # -- motions ----------------------------------------------------------------------------------------------

    def wait(self, seconds: float) -> Stage:
        for _ in range(round(seconds * RATE)):
            self.tick()
        return self

    def go(self, *place: float, speed: float = FAST) -> Stage:
        goal = np.array(place)
        steps = max(1, int(np.ceil(np.linalg.norm(goal - self.tool) * RATE / speed)))
        start = self.tool.copy()
        for k in range(1, steps + 1):
            self.tool = start + (goal - start) * k / steps
            self.tick()
        return self

    def over(self, place: np.ndarray, height: float = 0.25) -> Stage:
        return self.go(*self.tool[:2], max(height, self.tool[2])).go(place[0], place[1], height)

    def close(self, seconds: float = 0.5) -> Stage:
        self.command = 1.0
        return self.wait(seconds)

    def open(self, seconds: float = 0.5) -> Stage:
        self.command = -1.0
        return self.wait(seconds)

    def hold(self) -> Stage:
        """Keeps the fingers where they are from now on."""
        self.command = 0.0
        return self

    def grasp(self, name: str, *, beside: tuple[float, float] = (0.0, 0.0)) -> Stage:
        """Goes to an object, or beside it, and closes the hand."""
        x, y, z = self.grip_point(name)
        place = np.array([x + beside[0], y + beside[1]])
        return self.over(place).go(place[0], place[1], z).close()

    def lift(self, height: float = 0.15) -> Stage:
        return self.go(*self.tool[:2], self.tool[2] + height)

    def carry(self, place: np.ndarray) -> Stage:
        """Carries what is in the hand to a place and lets go just above it."""
        x, y, z = place
        offset = self.grip_offset if self.grip is not None else np.zeros(3)
        self.over(place, 0.30)
        return self.go(x - offset[0], y - offset[1], z + 0.002 - offset[2]).open(0.4).lift()

    def bring(self, name: str, place: np.ndarray | None = None) -> Stage:
        return self.grasp(name).lift().carry(self.goal_place() if place is None else place)

    def draw(self, drawer: str, opening: float) -> Stage:
        """Draws a drawer out, or pushes it home."""
        shut, out = self.rails[drawer]
        self.grasp(drawer)
        way = self.tool + shut + opening * out - self.positions[drawer]
        return self.go(*way).open(0.4).lift()

    def opening(self, drawer: str) -> float:
        shut, out = self.rails[drawer]
        return float((self.positions[drawer] - shut) @ out)

    def serve(self, k: int) -> Stage:
        """Does a subgoal, whatever it is."""
        goal = self.condition.instruction.subgoals[k]
        if goal.relation == "closed":
            return self.draw(self.condition.resolve(goal.reference)[0], 0.0)
        for drawer in self.rails if goal.target in self.rails else ():
            above = self.positions[drawer][2] > self.positions[goal.target][2]
            if above and self.opening(drawer) > 0.01:
                self.draw(drawer, 0.0)
        if goal.target in self.rails and self.opening(goal.target) < 0.1:
            self.draw(goal.target, 0.15)
        where = relation(goal.relation).where
        waiting = [n for n in self.condition.resolve(goal.reference) if where(self.state(), n, goal.target) is None]
        return self.bring(waiting[self.metadata.seed % len(waiting)], self.goal(k))

    def air_grasp(self, slot: str) -> Stage:
        place = self.slot(slot)
        return self.over(place).go(place[0], place[1], 0.04).close().lift().open()

    def home(self) -> Stage:
        return self.go(*self.tool[:2], 0.4).go(*HOME)

    def wander(self, seconds: float) -> Stage:
        for k in range(round(seconds * RATE)):
            self.tool = np.array([0.35 + 0.08 * np.sin(0.5 * k), 0.1 * np.cos(0.5 * k), 0.4])
            self.tick()
        return self

    def end(self, *, termination: str | None = None, error: str | None = None) -> Record:
        """Ends the episode: a success if the goal was met, else at the step limit."""
        limit = self.task.step_limit(self.condition)
        if self.condition.expected.value != "succeed" and termination is None:
            while self.step < limit:
                self.tick()
        ended = termination or ("success" if self.succeeded else "step_limit")
        return self.builder.finish(termination=ended, success=self.succeeded and termination is None, error=error)


@pytest.fixture
def stage() -> Callable[..., Stage]:
    return Stage


@pytest.fixture
def changed_stage(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Stage]:
    """Makes stages whose condition is changed, for what no task of the suite asks for."""

    def make(task: str, name: str, change: Callable[[Condition], Condition]) -> Stage:
        known = resolve_condition(task, name)
        setting = replace(known, condition=change(known.condition))
        for module in (trial, sys.modules[Stage.__module__]):
            monkeypatch.setattr(module, "resolve_condition", lambda *_: setting)
        return Stage(task, name)

    return make


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> dict[str, tuple[tuple[float, float, float], str, str]]:
    for category in list(LOOKS):
        monkeypatch.setitem(LOOKS, category, LOOKS[category])  # restored after the test
    return LOOKS


def rename(record: Record, names: dict[str, str]) -> Record:
    """Returns the same episode with other object names."""

    def new(text: str) -> str:
        for old, name in names.items():
            text = text.replace(f"({old},", f"({name},")
            text = text.replace(f" {old})", f" {name})").replace(f" {old}.", f" {name}.")
        return text

    scene = record.metadata.scene
    objects = tuple(replace(o, name=names.get(o.name, o.name)) for o in scene.objects)
    metadata = replace(
        record.metadata,
        scene=SceneInfo(objects, scene.slots, scene.home_position, scene.gripper_opening_m),
        predicate_names=tuple(new(p) for p in record.metadata.predicate_names),
    )
    return replace(record, metadata=metadata, bodies=tuple(names.get(b, b) for b in record.bodies))


@pytest.fixture
def renamed() -> Callable[[Record, dict[str, str]], Record]:
    return rename


@pytest.fixture
def policies() -> dict[str, Callable[[str, str, int], Record]]:
    """Scripted policies that each follow one rule, by (task, name, seed); each plays an episode once for all tests."""
    return PLAYED_ONCE


def right(task: str, name: str, seed: int) -> Record:
    s = Stage(task, name, seed=seed)
    return _finish_right(s)


def _finish_right(s: Stage) -> Record:
    return do_right(s).end()


def do_right(s: Stage) -> Stage:
    """Does what is still to be done, in the order asked."""
    if s.condition.expected.value == "succeed":
        for k in range(len(s.condition.instruction.subgoals)):
            if not s.done[k]:
                s.serve(k)
        s.wait(1.0)
    return s


def _take_at(s: Stage, slot: str) -> None:
    there = [n for n in s.movable() if np.hypot(*(s.positions[n] - s.slot(slot))[:2]) < 0.06]
    if there:
        s.bring(there[0])
    else:
        s.air_grasp(slot)


def lexical(task: str, name: str, seed: int) -> Record:
    s = Stage(task, name, seed=seed)
    for k, goal in enumerate(s.condition.instruction.subgoals):
        places = training_distribution_of(s.task).word_slots[goal.word]
        earlier = sum(g.word == goal.word for g in s.condition.instruction.subgoals[:k])
        _take_at(s, places[min(earlier, len(places) - 1)])
    return s.wait(1.0).end()


def layout(task: str, name: str, seed: int) -> Record:
    s = Stage(task, name, seed=seed)
    _take_at(s, {"fast_food": "first", "morning_coffee": "far"}[task])
    return _finish_right(s)


def inertia(task: str, name: str, seed: int) -> Record:
    s = Stage(task, name, seed=seed)
    if task == "fast_food":
        s.bring(min(s.info.of_kind("burger"), key=lambda o: str(o.slot)).name)
    elif name == "T1":
        s.air_grasp("near")
    return _finish_right(s)


PLAYED_ONCE = {f.__name__: functools.lru_cache(maxsize=256)(f) for f in (right, lexical, layout, inertia)}
