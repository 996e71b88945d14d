"""A stage for scripted culprits: a kinematic world that writes records without a simulator."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from betterbench.diagnosis import trial
from betterbench.diagnosis.trial import setting_of
from betterbench.geometry import Pose, from_yaw
from betterbench.recording import Record, RecordBuilder, RecordMetadata
from betterbench.state import Contact, ObjectInfo, Region, SceneInfo, SlotInfo, WorldState
from betterbench.tasks import Condition, GoalTracker, regime_of

HOME = (0.31, 0.0, 0.59)
RATE = 20.0
DOWN = (0.0, 1.0, 0.0, 0.0)
FAST = 0.5  # m/s, so that records stay short
RING = 0.02

LOOKS = {  # size, colour, shape
    "burger": ((0.066, 0.066, 0.052), "brown", "round"),
    "round_block": ((0.066, 0.066, 0.052), "brown", "round"),
    "fries_box": ((0.04, 0.06, 0.10), "red", "box"),
    "drink_cup": ((0.07, 0.07, 0.12), "white", "cylinder"),
    "takeaway_box": ((0.20, 0.14, 0.16), "brown", "box"),
    "mug": ((0.07, 0.07, 0.09), "", "cylinder"),
    "can": ((0.066, 0.066, 0.12), "red", "cylinder"),
    "coffee_machine": ((0.25, 0.20, 0.33), "black", "box"),
}
REGIONS = {
    "takeaway_box": (Region("inside", (0.0, 0.0, 0.075), (0.09, 0.06, 0.07)),),
    "coffee_machine": (
        Region("ring", (0.12, 0.0, RING), (0.04, 0.04, 0.001)),
        Region("spout", (0.12, 0.0, 0.2), (0.01, 0.01, 0.02)),
    ),
}


class Stage:
    """One episode, acted out step by step; every method that moves time appends rows."""

    def __init__(self, task: str, name: str, *, seed: int = 0, policy: str = "scripted") -> None:
        self.setting = setting_of(task, name)
        self.condition = self.setting.condition
        self.task = self.setting.task
        rng = np.random.default_rng(seed)
        self.info = self._scene()
        self.positions = {}
        for o in self.info.objects:
            if o.slot is not None:
                slot = self.task.slot(o.slot)
                jitter = rng.uniform(-slot.jitter_m, slot.jitter_m, 2)
                self.positions[o.name] = np.array([slot.x + jitter[0], slot.y + jitter[1], 0.0])
        self.yaws = {o.name: self.task.slot(o.slot).yaw if o.slot else 0.0 for o in self.info.objects}
        self.tool, self.width, self.command = np.array(HOME), 0.08, -1.0
        for o in self.info.objects:
            if o.slot is None:
                self.positions[o.name] = self.goal_place()
        self.grip: str | None = None
        self.grip_offset = np.zeros(3)
        self.fall: dict[str, float] = {}
        self.tracker = GoalTracker(self.condition, self.info, template=self.task.template, control_rate_hz=RATE)
        variation = None if self.condition.name == self.setting.base else self.condition.name
        self.metadata = RecordMetadata(
            task=task, task_version=self.task.version, suite_version="1.0", package_version="0.1.0",
            condition=self.condition.name, variation=variation, axis=self.setting.axis,
            base_condition=self.setting.base if variation else None, seed=seed, policy=policy,
            instruction=self.condition.instruction.text, expected=self.condition.expected.value,
            action_space="ee_delta", action_components=("x", "y", "z", "rx", "ry", "rz", "gripper"),
            control_rate_hz=RATE, camera_preset=None, render_quality=None,
            engine={"mujoco": "3.17.0", "model": f"{seed:016x}"}, scene_hash="0f" * 16, scene=self.info,
            predicate_names=self.tracker.relation_names, subgoal_names=self.tracker.subgoal_names,
        )  # fmt: skip
        self.builder = RecordBuilder(self.metadata)
        self.previous = dict(self.positions)
        self.step, self.succeeded = 0, False
        self._append()

    def _scene(self) -> SceneInfo:
        regime = regime_of(self.task)
        objects = []
        for o in self.condition.objects:
            size, colour, shape = LOOKS[o.category]
            regions, slot = REGIONS.get(o.category, ()), self.condition.layout.get(o.name)
            info = ObjectInfo(
                o.name, o.kind, o.category, o.category, o.colour or colour, shape, o.role, o.fixed, 0.2, size,
                regions, slot,
            )  # fmt: skip
            objects.append(info)
        slots = tuple(
            SlotInfo(s.name, (s.x, s.y, 0.0), s.yaw, regime.standing_kinds.get(s.name, ())) for s in self.task.slots
        )
        return SceneInfo(tuple(objects), slots, HOME, 0.08)

    def size(self, name: str) -> tuple[float, float, float]:
        return self.info.object(name).size_m

    def of(self, kind: str, slot: str | None = None) -> str:
        """Names an object of a kind."""
        return next(o.name for o in self.info.of_kind(kind) if slot is None or o.slot == slot)

    def at(self, slot: str) -> str:
        return next(o.name for o in self.info.objects if o.slot == slot)

    def slot(self, name: str) -> np.ndarray:
        return np.array(self.info.slot(name).position)

    def goal_place(self) -> np.ndarray:
        """Where the next object has to stand to be at the target."""
        target = self.condition.instruction.subgoals[0].target
        frame = Pose(tuple(self.positions[target]), from_yaw(self.yaws[target]))
        if "ring" in {r.name for r in self.info.object(target).regions}:
            return np.array(frame.apply((0.12, 0.0, RING)))
        inside = sum(np.hypot(*(self.positions[n] - self.positions[target])[:2]) < 0.12 for n in self.movable())
        return np.array(frame.apply((-0.05 + 0.04 * (inside % 3), 0.0, 0.006)))

    def movable(self) -> list[str]:
        return [o.name for o in self.info.objects if not o.fixed and o.role in ("item", "distractor")]

    # -- time -------------------------------------------------------------------------------------------------

    def tick(self) -> None:
        """Advances one control step."""
        moving = 0.01 if self.command > 0 else -0.01
        width = min(0.08, max(0.0, self.width - moving))
        if self.command > 0:
            between = self.between()
            if between is not None and width <= min(self.size(between)[:2]):
                width = min(self.size(between)[:2])
                if self.grip is None:
                    self.grip, self.grip_offset = between, self.positions[between] - self.tool
        elif self.grip is not None and width > min(self.size(self.grip)[:2]):
            self.fall[self.grip], self.grip = 0.0, None
        self.width = width
        if self.grip is not None:
            self.positions[self.grip] = self.tool + self.grip_offset
        for name in list(self.fall):
            self.fall[name] += 9.81 / RATE
            z, rest = self.positions[name][2], self.rest_height(name)
            self.positions[name] = np.array([*self.positions[name][:2], max(rest, z - self.fall[name] / RATE)])
            if self.positions[name][2] <= rest:
                del self.fall[name]
        self.step += 1
        self._append()

    def between(self) -> str | None:
        """Names the object between the fingers."""
        if self.grip is not None:
            return self.grip
        for name in self.movable():
            x, y, z = self.tool - self.positions[name]
            if np.hypot(x, y) < 0.02 and 0.0 <= z <= self.size(name)[2]:
                return name
        return None

    def rest_height(self, name: str) -> float:
        for o in self.info.objects:
            if o.role in ("container", "fixture"):
                gap = np.hypot(*(self.positions[name] - self.goal_place())[:2])
                if o.role == "fixture" and gap < 0.06:
                    return RING
                if o.role == "container" and np.hypot(*(self.positions[name] - self.positions[o.name])[:2]) < 0.09:
                    return 0.006
        return 0.0

    def state(self) -> WorldState:
        names = [o.name for o in self.info.objects]
        contacts = []
        for name in names:
            if self.grip == name:
                contacts += [Contact(name, "left_finger", 10.0), Contact(name, "right_finger", 10.0)]
            if self.positions[name][2] <= 1e-3:
                contacts.append(Contact(name, "table", 1.0))
        held = self.grip if self.grip is not None and self.positions[self.grip][2] > 0.003 else None
        speeds = tuple(float(np.linalg.norm(self.positions[n] - self.previous[n])) * RATE for n in names)
        tool = Pose(tuple(float(v) for v in self.tool), DOWN)
        joints = tuple(float(v) for v in (*self.tool, 0, 0, 0, 0))
        still = tuple([0.0] * 7) if np.allclose(self.tool, self.last_tool) else tuple([0.3] * 7)
        return WorldState(
            info=self.info, step=self.step, time_s=self.step / RATE,
            positions=tuple(tuple(float(v) for v in self.positions[n]) for n in names),
            quaternions=tuple(from_yaw(self.yaws[n]) for n in names),
            linear_speeds=speeds, angular_speeds=tuple([0.0] * len(names)), ee_pose=tool, commanded_pose=tool,
            finger_width_m=self.width, gripper_command=self.command, joint_positions=joints, joint_velocities=still,
            contacts=tuple(contacts), held=held,
        )  # fmt: skip

    last_tool = np.array(HOME)

    def _append(self) -> None:
        state = self.state()
        truth = self.tracker.update(state)
        action = None if self.step == 0 else np.full(7, self.command)
        self.builder.append(
            state, qpos=np.zeros(3), qvel=np.zeros(3), ctrl=np.zeros(2), action=action, applied=action,
            predicates=truth.relations, subgoals=truth.subgoals, goal=truth.goal, forbidden=truth.forbidden,
        )  # fmt: skip
        self.succeeded = self.succeeded or truth.success
        self.previous = {n: p.copy() for n, p in self.positions.items()}
        self.last_tool = self.tool.copy()

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

    def grasp(self, name: str, *, beside: tuple[float, float] = (0.0, 0.0)) -> Stage:
        """Goes to an object, or beside it, and closes the hand."""
        x, y, z = self.positions[name]
        place = np.array([x + beside[0], y + beside[1]])
        return self.over(place).go(place[0], place[1], z + 0.5 * self.size(name)[2]).close()

    def lift(self, height: float = 0.15) -> Stage:
        return self.go(*self.tool[:2], self.tool[2] + height)

    def carry(self, place: np.ndarray) -> Stage:
        """Carries what is in the hand to a place and lets go just above it."""
        x, y, z = place
        offset = self.grip_offset if self.grip is not None else np.zeros(3)
        self.over(place, 0.30)
        return self.go(x - offset[0], y - offset[1], z + 0.002 - offset[2]).open(0.4).lift()

    def bring(self, name: str) -> Stage:
        return self.grasp(name).lift().carry(self.goal_place())

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
        known = setting_of(task, name)
        setting = replace(known, condition=change(known.condition))
        for module in (trial, sys.modules[Stage.__module__]):
            monkeypatch.setattr(module, "setting_of", lambda *_: setting)
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
            text = text.replace(f"({old},", f"({name},").replace(f" {old})", f" {name})")
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
    """Scripted policies that each follow one rule, by (task, name, seed)."""
    return {"right": right, "lexical": lexical, "layout": layout, "inertia": inertia}


def right(task: str, name: str, seed: int) -> Record:
    s = Stage(task, name, seed=seed)
    return _finish_right(s)


def _finish_right(s: Stage) -> Record:
    if s.condition.expected.value == "succeed":
        for goal in s.condition.instruction.subgoals:
            waiting = [n for n in s.condition.resolve(goal.reference) if s.positions[n][1] < 0.1]
            done = len(s.condition.resolve(goal.reference)) - len(waiting)
            if done < goal.count and waiting:
                s.bring(waiting[s.metadata.seed % len(waiting)])
        s.wait(1.0)
    return s.end()


def _take_at(s: Stage, slot: str) -> None:
    there = [n for n in s.movable() if np.hypot(*(s.positions[n] - s.slot(slot))[:2]) < 0.06]
    if there:
        s.bring(there[0])
    else:
        s.air_grasp(slot)


def lexical(task: str, name: str, seed: int) -> Record:
    s = Stage(task, name, seed=seed)
    for k, goal in enumerate(s.condition.instruction.subgoals):
        places = s.setting.regime.word_slots[goal.word]
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
