"""Pick-and-place expert for LIBERO, and faulty policies that calibrate the diagnosis in LIBERO.

The policies act through robosuite's ``OSC_POSE`` controller, which adds each delta to the measured pose. Each action is
therefore the difference between the goal pose and the measured pose. The fingers close along the x axis of LIBERO's
tool frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from betterbench.errors import InvalidInputError
from betterbench.geometry import TOOL_DOWN, Pose, Vector, distance, from_yaw, horizontal_distance, multiply, rotate
from betterbench.interface.state import ObjectInfo, WorldState
from betterbench.policies.experts.motion import CLOSE, OPEN, Motion, delta_action, disturbed
from betterbench.policies.experts.registry import parse_address
from betterbench.policies.faulty import Fault
from betterbench.sim.worlds import ProcessScene
from betterbench.tasks import Label, TrainingDistribution, stream
from betterbench.tasks.worlds.libero_training import CARRIED, trained_in, word_of_sentence

FINGER_ROOM_M = 0.074
"""Largest width of an object that is grasped between the fingers [m]. The fingers open to 77 mm."""

TOOL_TIP_M = 0.011
"""Distance by which the fingers extend below the tool center point [m]."""

HAND_ABOVE_M = 0.035
"""Height of the bottom of the Panda hand above the tool center point [m]."""

HAND_HALF_M = (0.04, 0.11)
"""Half extents of the Panda hand, perpendicular to and along the axis on which the fingers close [m]."""

HOME_YAW = 0.5 * math.pi
"""Direction of the axis along which the fingers close, in the home pose [rad]."""

_TRIES = 3
_NEAR_M = 0.006
_STANDS_WITHIN_M = 0.06
_LIFT_M = 0.06
_STILL_STEPS, _STILL_M = 6, 0.002

POLICIES = {
    "expert": "brings the right object to the right target, and repeats a missed grasp",
    "zoo:lexical": "picks at the slot from which training picked for the same words of the instruction",
    "zoo:layout": "picks at the slot from which training picked most often, regardless of the instruction",
    "zoo:habit-place": "brings the right object to the trained position of the target",
    "zoo:clumsy": "reaches for the right object, but drops it or closes the gripper next to it",
}
"""Privileged policies that work in LIBERO, by address, with a description of their behavior."""


@dataclass(frozen=True, slots=True)
class _Aim:
    """Object to carry, and the position to which the center of its bottom face is brought [m].

    If this is the wrong target, ``fault`` describes the fault. It is recorded only after the object has been carried
    there.
    """

    object: str
    place: Vector
    fault: Fault | None = None


class LiberoAgent:
    """Privileged policy for one episode of a LIBERO task that requires only picking and placing objects."""

    def __init__(self, address: str, scene: ProcessScene) -> None:
        """Prepare the policy for an episode of a scene that has been reset.

        Raises:
            UnknownNameError: If no such policy exists.
            InvalidInputError: If the policy does not work in LIBERO, or if the task requires more than picking and
                placing objects.
        """
        asked = parse_address(address)
        if asked.name not in POLICIES:
            raise InvalidInputError("policy", f"{address} does not support LIBERO", f"Use one of {', '.join(POLICIES)}")
        self._name, self._rule, self._noise_m = address, asked.name, asked.action_noise_m
        self._scene = scene
        self._random = stream(scene.task.id, scene.seed, f"{asked.name}:{scene.condition.name}")
        self._applies = asked.strength >= 1.0 or self._random.random() < asked.strength
        self._miss = self._rule == "zoo:clumsy" and self._applies and self._random.random() < 0.5
        self._drop = self._rule == "zoo:clumsy" and self._applies and not self._miss
        self._fault: Fault | None = None
        self._mishap = ""
        self._run: Motion | None = None

    @property
    def name(self) -> str:
        """Address of the policy."""
        return self._name

    @property
    def ground_truth(self) -> dict[str, str]:
        """Ground truth about the episode.

        :class:`betterbench.policies.experts.PrivilegedAgent` describes the format.
        """
        fault = self._fault
        return {
            "truth": "" if fault is None else fault.label,
            "fault": "" if fault is None else f"decision {fault.decision}: {fault.text}",
            "mishap": self._mishap,
        }

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return the next action (7,) in the action space ``ee_delta``."""
        if self._run is None:
            self._run = self._actions(state)
            action = next(self._run)
        else:
            action = self._run.send(state)
        return disturbed(action, self._noise_m, self._random)

    def close(self) -> None:
        """End the episode and release its resources."""
        run, self._run = self._run, None
        if run is not None:
            run.close()

    def _actions(self, state: WorldState) -> Motion:
        home = state.ee_pose
        for number, step in enumerate(steps_of(self._scene)):
            for _ in range(_TRIES):
                if self._scene.truth().subgoals[step.number]:
                    break
                aim = self._decide(state, step, number)
                state = yield from self._bring(state, aim)
                if self._fault is not None:
                    break
        state = yield from _move(state, home, OPEN, limit=60)
        while True:
            state = yield _still(state, OPEN)

    def _decide(self, state: WorldState, step: CarriedStep, number: int) -> _Aim:
        """Decide which object to carry, and to which target.

        The first wrong decision about the object is recorded as a fault.
        """
        target = state.pose(step.target)
        right = _Aim(step.object, _place_of(state, step))
        if not self._applies or self._rule == "expert":
            return right
        if self._rule == "zoo:clumsy":
            self._note(Label.EXECUTION_FAILURE, number, f"takes {step.object} with a bad grasp")
            return right
        if self._rule == "zoo:habit-place":
            slots = self._trained.standing_kinds
            kind = state.info.object(step.target).kind
            for slot in state.info.slots:
                gap = horizontal_distance(slot.position, target.position)
                if kind in slots.get(slot.name, ()) and gap > _STANDS_WITHIN_M:
                    text = f"brings {step.object} to {slot.name}"
                    fault = Fault(Label.BEHAVIORAL_INERTIA, number, text)
                    return _Aim(step.object, _place_at(state, step, slot.position), fault)
            return right
        label, slots_asked = self._slots_of_rule(state, step)
        for name in slots_asked:
            taken = standing_in(state, name)
            if taken is None or taken == step.target:
                continue
            if taken != step.object:
                self._note(label, number, f"takes {taken} at {name}")
            return _Aim(taken, right.place)
        return right

    def _slots_of_rule(self, state: WorldState, step: CarriedStep) -> tuple[Label, tuple[str, ...]]:
        """Return the slots from which the faulty rule picks, in order of preference, and the label of a wrong pick."""
        here = {slot.name for slot in state.info.slots}
        trained = self._trained
        if self._rule == "zoo:layout":
            return Label.VISUAL_LAYOUT_BIAS, tuple({trained.favorite_slot} & here)
        word = word_of_sentence(self._scene.task.instruction, state.info.object(step.object).kind)
        slots = tuple(slot for slot in trained.word_slots.get(word, ()) if slot in here)
        return Label.LEXICAL_KINEMATIC_SHORTCUT, slots

    @property
    def _trained(self) -> TrainingDistribution:
        return trained_in(self._scene.settings.regime)

    def _note(self, label: Label, number: int, text: str) -> None:
        if self._fault is None:
            self._fault = Fault(label, number, text)

    def _bring(self, state: WorldState, aim: _Aim) -> Motion:
        """Pick up an object and release it at its target."""
        thing = state.info.object(aim.object)
        grasp = self._grasp(state, thing)
        clear = max(_top(state, o) for o in state.info.objects if not o.fixed) + thing.size_m[2] + 0.03
        above = _raised(grasp, max(grasp.position[2] + 0.08, 0.10 + _floor(state)))
        state = yield from _move(state, above, OPEN, limit=60)
        state = yield from _move(state, grasp, OPEN, limit=40, speed=0.4)
        for _ in range(10):
            state = yield _still(state, CLOSE)
        state = yield from _move(state, _raised(grasp, grasp.position[2] + _LIFT_M), CLOSE, limit=25, speed=0.6)
        if state.held != aim.object:
            if not self._miss:
                self._mishap = self._mishap or f"the gripper failed to grasp {aim.object}"
            state = yield from _move(state, above, OPEN, limit=25)
            return state
        hung = tuple(a - b for a, b in zip(state.ee_pose.position, state.pose(aim.object).position, strict=True))
        over = (aim.place[0] + hung[0], aim.place[1] + hung[1])
        high = max(clear + hung[2] - thing.size_m[2], state.ee_pose.position[2])
        carried = Pose((over[0], over[1], high), grasp.quaternion)
        state = yield from _move(state, _raised(grasp, high), CLOSE, limit=40)
        if self._drop:
            between = tuple(0.5 * (a + b) for a, b in zip(grasp.position[:2], over, strict=True))
            state = yield from _move(state, Pose((between[0], between[1], high), grasp.quaternion), CLOSE, limit=40)
            for _ in range(10):
                state = yield _still(state, OPEN)
            return state
        state = yield from _move(state, carried, CLOSE, limit=80, speed=0.8)
        if state.held == aim.object:
            self._fault = self._fault or aim.fault
        low = aim.place[2] + hung[2] + 0.005
        state = yield from _move(state, Pose((over[0], over[1], low), grasp.quaternion), CLOSE, limit=80, speed=0.5)
        for _ in range(8):
            state = yield _still(state, OPEN)
        state = yield from _move(state, carried, OPEN, limit=30)
        return state

    def _grasp(self, state: WorldState, thing: ObjectInfo) -> Pose:
        """Return the tool pose at which the gripper closes.

        If the policy is supposed to miss the object, the pose is next to the object.
        """
        grasp = grasp_of(state, thing)
        if not self._miss:
            return grasp
        beside = 0.5 * max(thing.size_m[:2]) + TOOL_TIP_M + 0.008
        x, y, _ = rotate(grasp.quaternion, (0.0, beside, 0.0))
        px, py, pz = grasp.position
        return Pose((px + x, py + y, pz), grasp.quaternion)


@dataclass(frozen=True, slots=True)
class CarriedStep:
    """Pick-and-place step that establishes one relation of the goal.

    ``number`` is the index of the relation in the goal.
    """

    number: int
    relation: str
    object: str
    target: str


def steps_of(scene: ProcessScene) -> tuple[CarriedStep, ...]:
    """Return the pick-and-place steps that reach the goal of a task. The scene must have been reset.

    Raises:
        InvalidInputError: If a step requires more than picking and placing an object.
    """
    return tuple(carried_step(scene.info.objects, i, name) for i, name in enumerate(scene.subgoal_names))


def carried_step(objects: tuple[ObjectInfo, ...], number: int, name: str) -> CarriedStep:
    """Return the pick-and-place step for a relation in the goal, such as "in(milk_1, basket_1_contain_region)".

    Raises:
        InvalidInputError: If the relation cannot be established by picking and placing an object.
    """
    relation, _, rest = name.removesuffix(")").partition("(")
    about = rest.split(", ")
    known = {o.name: o for o in objects}
    target = next((n for n in known if len(about) == 2 and (about[1] == n or about[1].startswith(f"{n}_"))), None)
    if relation not in CARRIED or target is None or about[0] not in known or known[about[0]].fixed:
        raise InvalidInputError(
            "policy",
            f"the policy has no skill for {name}",
            "Choose a task that requires only picking and placing objects",
        )
    return CarriedStep(number, relation, about[0], target)


def standing_in(state: WorldState, slot: str) -> str | None:
    """Return the name of the movable object in a slot, or None if the slot is empty."""
    place = state.info.slot(slot).position
    near = [
        (horizontal_distance(state.pose(o.name).position, place), o.name) for o in state.info.objects if not o.fixed
    ]
    near = [entry for entry in near if entry[0] < _STANDS_WITHIN_M]
    return min(near)[1] if near else None


def grasp_of(state: WorldState, thing: ObjectInfo) -> Pose:
    """Return the tool pose for grasping an object from above, across its narrow side or at its rim."""
    pose = state.pose(thing.name)
    depth, width, height = thing.size_m
    x, y, z = pose.position
    low = z + max(height - 0.035, 0.5 * height, TOOL_TIP_M)
    heading = math.atan2(*rotate(pose.quaternion, (1.0, 0.0, 0.0))[1::-1])
    options = [
        (abs(_turned(yaw)) + 20.0 * max(0.0, across - 0.06), yaw)
        for across, yaw in ((depth, heading), (width, heading + 0.5 * math.pi))
        if across <= FINGER_ROOM_M
    ]
    if options:
        yaw = HOME_YAW + _turned(min(options)[1])
        return Pose((x, y, low), multiply(from_yaw(yaw), TOOL_DOWN))
    radius = 0.5 * min(depth, width) - 0.004
    others = [o for o in state.info.objects if o.name != thing.name]
    grasps = [
        Pose((x, side, z + height - 0.012), multiply(from_yaw(HOME_YAW), TOOL_DOWN))
        for side in (y + radius, y - radius)
    ]

    def room(grasp: Pose) -> tuple[bool, float]:
        gaps = [horizontal_distance(grasp.position, state.pose(o.name).position) for o in others]
        return not any(_strikes(state, grasp, o) for o in others), min(gaps, default=0.0)

    return max(grasps, key=room)


def _strikes(state: WorldState, grasp: Pose, other: ObjectInfo) -> bool:
    """Return whether the hand of the robot would hit the bounding box of an object.

    The fingers close along the world's y axis.
    """
    pose = state.pose(other.name)
    if _top(state, other) < grasp.position[2] + HAND_ABOVE_M:
        return False
    across, along = (rotate(pose.quaternion, axis)[:2] for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    (dx, dy), (width, length) = HAND_HALF_M, other.size_m[:2]
    x, y = grasp.position[0] - pose.position[0], grasp.position[1] - pose.position[1]
    # Separating axis test: two rectangles are disjoint if a line along a side of one of them separates them.
    return all(
        abs(x * a + y * b)
        <= dx * abs(a) + dy * abs(b) + 0.5 * width * abs(_dot(across, (a, b))) + 0.5 * length * abs(_dot(along, (a, b)))
        for a, b in ((1.0, 0.0), (0.0, 1.0), across, along)
    )


def _dot(a: tuple[float, ...], b: tuple[float, float]) -> float:
    return a[0] * b[0] + a[1] * b[1]


def _place_of(state: WorldState, step: CarriedStep) -> Vector:
    """Return the position to which a step brings the center of the object's bottom face [m]."""
    return _place_at(state, step, state.pose(step.target).position)


def _place_at(state: WorldState, step: CarriedStep, there: Vector) -> Vector:
    """Return the position to which a step brings an object [m], assuming that the target is at ``there`` [m].

    If the target is a container, the position is above its rim.
    """
    target, (x, y, z) = state.info.object(step.target), there
    if step.relation == "in":
        return (x, y, z + target.size_m[2] + 0.01)
    return (x, y, z + 0.6 * target.size_m[2])


def _turned(yaw: float) -> float:
    """Return how far the fingers must rotate from the home pose to a direction [rad].

    The angle is within ±90 degrees.
    """
    return (yaw - HOME_YAW + 0.5 * math.pi) % math.pi - 0.5 * math.pi


def _raised(pose: Pose, z: float) -> Pose:
    return Pose((pose.position[0], pose.position[1], z), pose.quaternion)


def _top(state: WorldState, thing: ObjectInfo) -> float:
    return state.pose(thing.name).position[2] + thing.size_m[2]


def _floor(state: WorldState) -> float:
    return min((slot.position[2] for slot in state.info.slots), default=0.0)


def _still(state: WorldState, gripper: float) -> np.ndarray:
    return delta_action(state.ee_pose, state.ee_pose, gripper)


def _move(state: WorldState, goal: Pose, gripper: float, *, limit: int, speed: float = 1.0) -> Motion:
    """Move until the tool is near a pose or has stopped moving, for at most ``limit`` control steps.

    ``speed`` is given as a fraction of the maximum speed.
    """
    way = [state.ee_pose.position]
    for _ in range(limit):
        stuck = len(way) > _STILL_STEPS and distance(way[-1], way[-1 - _STILL_STEPS]) < _STILL_M
        if stuck or distance(state.ee_pose.position, goal.position) < _NEAR_M:
            break
        action = delta_action(state.ee_pose, goal, gripper)
        longest = float(np.abs(action[:3]).max())
        if longest > speed:
            action[:3] *= speed / longest
        state = yield action
        way.append(state.ee_pose.position)
    return state
