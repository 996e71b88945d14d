"""Amplifier: a demonstrator that adapts the skills of source demonstrations to new scenes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from betterbench.demonstrations.making.failure import AttemptFailedError, FailureKind
from betterbench.demonstrations.making.retarget import CarriedOver, carry_pick, carry_place, carry_slide
from betterbench.demonstrations.making.sources import Library, Source, SourceSkill, key_of, other_goals, region_frame
from betterbench.demonstrations.making.transit import TransitChange, carry_transit, checkpoints
from betterbench.geometry import Pose, angle_between, distance
from betterbench.interface.state import WorldState
from betterbench.policies.experts.motion import CARRY, FREE, OPEN, Motion, Pace, delta_action, follow
from betterbench.policies.experts.planner import OUT_OF_REACH, Planner
from betterbench.policies.experts.privileged import measured_releases
from betterbench.policies.experts.skills import PRESS_M, SURE
from betterbench.records import SkillWindow
from betterbench.sim.scenes import Scene
from betterbench.tasks.demonstrated import HEIGHT_MM, REACH_MM
from betterbench.tasks.relations import relation

SourceChoice = Literal["random", "nearest_object", "nearest_robot"]
"""Method of choosing a source demonstration: at random, by the most similar pose of the object, or by the motion that
begins closest to the arm.
"""

NEAREST, NEAREST_SHARE = 3, 0.5
"""Minimum number of nearest sources, and minimum number as a fraction of all sources.

A source is drawn uniformly from the nearest sources. Their number is the larger of the two minimums.
"""
OTHER_INSTANCE_M = 0.05
"""Distance that is added between two objects of the same category if they are different instances [m]."""
BEGIN_WITHIN_M = (0.08, 0.13, 0.20)
"""Distances from the pose at which the gripper opens or closes, within which a skill may begin [m].

The distances are tried in this order. The motion before the beginning of the skill belongs to the transit.
"""
TURN_RAD = math.pi / 8.0
"""Angle between neighboring grasps of an object that can be grasped from any side [rad]."""
TURNS_RAD = tuple(sign * step * TURN_RAD for step in (2, 4, 6) for sign in (1.0, -1.0))
"""Rotations about the object's axis that are tried if an object can be grasped from any side [rad]."""
SETTLE_M, SETTLE_RAD, SETTLE_STEPS = 0.0015, 0.015, 14
"""Maximum distance [m] and angle [rad] between a settled arm and its goal, and maximum number of control steps of
waiting. The demonstrator waits before each gripper motion until the arm has settled.
"""
STILL_M, STILL_STEPS = 2e-4, 2
"""Maximum motion of still fingers per control step [m], and number of still steps before a lift."""
LEAVE_M = 0.10
"""Height by which the tool retreats from the released object if the source demonstration ends without a retreat [m]."""
NOISE_BLOCK = 256
"""Number of control steps for which noise is drawn at once."""
MOST_DEVIATIONS = 5.0
"""Number of standard deviations at which noise is clipped.

When a recording is replayed, noise of up to 6 standard deviations is accepted.
"""
TEMPO = 1.4
"""Maximum factor by which a skill is sped up or slowed down to match the tempo of the demonstration."""
TEMPO_DRAWN = 0.1
"""Maximum relative difference between the tempo of a demonstration and the tempo of its primary source demonstration.
"""
ASIDE_M, LOWER_M, HIGHER_M = 0.03, 0.02, 0.05
"""Maximum displacement of a transit's midpoint relative to the source demonstration: sideways, down and up [m]."""
LAST_STEPS = 60
"""Maximum number of control steps between the end of the last skill and the moment at which the goal is met."""
FULL_M = 0.003
"""Maximum distance from its stop at which a drawer counts as fully open [m]."""


@dataclass(frozen=True, slots=True)
class AmplifierSettings:
    """Settings for adapting source demonstrations to a new scene.

    Attributes:
        select: Method of choosing the source demonstration for each subgoal.
        action_noise: Standard deviation of the noise on executed actions, in action units of translation (5 cm) and
            rotation (0.5 rad). The gripper command has no noise. No noise is added while the arm settles or the gripper
            opens or closes.
    """

    select: SourceChoice = "nearest_object"
    action_noise: float = 0.02


@dataclass(frozen=True, slots=True)
class _Hand:
    """State of the gripper during a transit: opening width [m], held object, and the object's pose in the gripper."""

    width_m: float
    held: str | None = None
    T_tcp_object: Pose | None = None


@dataclass(frozen=True, slots=True)
class _Candidate:
    """Candidate for the next skill, transferred from a source demonstration to the scene.

    Attributes:
        source: The skill in the source demonstration.
        moved: The same skill in this scene.
        change: Difference between the transit (the motion that leads to this skill) and the transit in the source
            demonstration.
        hand: State of the gripper during the transit.
        touched: Objects that the robot may touch during the skill.
    """

    source: SourceSkill
    moved: CarriedOver
    change: TransitChange
    hand: _Hand
    touched: frozenset[str]


@dataclass(frozen=True, slots=True)
class _WayIn:
    """Collision-free path to the start of a skill.

    Attributes:
        poses: Waypoints of a planned path. If the path instead repeats the transit of the source demonstration (the
            motion that leads to the skill), one pose per control step.
        planned: Whether the motion planner found the path.
        begin: Step of the skill from which the skill continues after the path.
    """

    poses: tuple[Pose, ...]
    planned: bool
    begin: int


class Amplifier:
    """Demonstrator that repeats the motions of source demonstrations in a new scene.

    Like the expert, it knows the full state.

    Attributes:
        used: Names of the source demonstrations, one for each skill that was started.
        failure: Kind of failure and reason if the attempt failed; None if it did not fail.
    """

    def __init__(
        self, scene: Scene, library: Library, lead: Source, settings: AmplifierSettings, draw: np.random.Generator
    ) -> None:
        """Prepare one attempt.

        Args:
            scene: The scene.
            library: Source demonstrations of the task.
            lead: Primary source demonstration, which determines the order of the skills.
            settings: Settings of the transfer.
            draw: Random stream of the attempt.
        """
        self._planner = Planner(scene)
        self._library, self._lead, self._settings, self._draw = library, lead, settings, draw
        self._period_s = 1.0 / scene.control_rate_hz
        self._shut = {p.spec.name: p.shut for p in scene.placements if p.shut is not None}
        self._noise = np.random.Generator(np.random.PCG64(int(draw.integers(1 << 62))))
        tempo = float(draw.uniform(1.0 - TEMPO_DRAWN, 1.0 + TEMPO_DRAWN))
        self._speed, self._tempo_mps = tempo * lead.speed, tempo * lead.tempo_mps
        self._block, self._drawn = np.empty((0, 7)), 0
        self._trained = measured_releases(scene)
        self._blocked: list[str] = []
        self._quiet = False
        self._run: Generator[np.ndarray, WorldState, None] | None = None
        self.used: list[str] = []
        self.failure: tuple[FailureKind, str] | None = None

    @property
    def name(self) -> str:
        """Name of this demonstrator, which is the policy name in records."""
        return "demonstrator:amplified"

    def act_on_state(self, state: WorldState) -> np.ndarray:
        """Return the next action in the ``ee_delta`` action space without noise, as an array of shape (7,).

        Raises:
            AttemptFailedError: If the attempt can no longer succeed.
        """
        try:
            if self._run is None:
                self._run = self._actions(state)
                return next(self._run)
            return self._run.send(state)
        except AttemptFailedError as failed:
            self.failure = (failed.kind, failed.reason)
            raise

    def close(self) -> None:
        """Drop the reference to the episode, so that the memory of its scene (about 20 MB) can be freed."""
        run, self._run = self._run, None
        if run is not None:
            run.close()

    def disturb(self, action: np.ndarray) -> np.ndarray:
        """Return the action to execute, which is the given action plus noise. No noise is added while the arm settles.

        Values outside the action space are clipped when the action is executed.
        """
        if self._quiet or not self._settings.action_noise:
            return action
        if self._drawn >= len(self._block):
            # Noise is drawn in blocks to save time.
            drawn = self._noise.standard_normal((NOISE_BLOCK, 7)).clip(-MOST_DEVIATIONS, MOST_DEVIATIONS)
            drawn[:, 6] = 0.0
            self._block, self._drawn = self._settings.action_noise * drawn, 0
        noisy: np.ndarray = action + self._block[self._drawn]
        self._drawn += 1
        return noisy

    def _actions(self, state: WorldState) -> Generator[np.ndarray, WorldState, None]:
        """Yield the actions of an episode. If the primary source demonstration has no skills, the arm stays still."""
        self._quiet = not self._lead.skills
        while not self._lead.skills:
            state = yield delta_action(state.commanded_pose, state.commanded_pose, 0.0)
        for segment in self._lead.segments:
            source: str | None = None
            for window in segment.skills:
                if window.kind == "miss" or (window.kind == "place" and not window.target):
                    continue
                state, source = yield from self._carry_out(state, window, source)
        state = yield from self._leave(state)
        for _ in range(LAST_STEPS):
            state = yield delta_action(state.commanded_pose, state.commanded_pose, 0.0)
        raise AttemptFailedError("misplaced", self._what_is_open(state))

    def _what_is_open(self, state: WorldState) -> str:
        """Describe the first subgoal of the primary source demonstration that has not been reached."""
        for s in self._lead.segments:
            if s.subgoal and not relation(s.relation).holds(state, s.object, s.target, s.region):
                return f"{s.subgoal}: {s.object} is not {s.relation} {s.target}{'.' if s.region else ''}{s.region}"
        return "all relations hold, but the goal is not met"

    def _carry_out(
        self, state: WorldState, window: SkillWindow, source: str | None
    ) -> Generator[np.ndarray, WorldState, tuple[WorldState, str | None]]:
        """Execute one skill of the primary source demonstration.

        The motion is taken from the first source demonstration with a skill that fits the scene.
        """
        if window.kind == "place" and state.held != window.object:
            raise AttemptFailedError("dropped", f"{window.object} was lost on the way to {window.target}")
        slide_m = self._slide_m(state, window) if window.kind == "slide" else 0.0
        key = key_of(state.info, window, out=slide_m > 0.0)
        held = window.object if window.kind == "place" else None
        self._blocked.clear()
        ordered = self._ordered(state, key, window, source)
        aside, raised = self._draw.uniform(-ASIDE_M, ASIDE_M), self._draw.uniform(-LOWER_M, HIGHER_M)
        for skill, moved in self._candidates(state, window, ordered, slide_m, turn_rad=self._drawn_turn()):
            faster = self._faster(skill)
            change = TransitChange(float(aside), float(raised), faster)
            hand, touched = _Hand(max(skill.width_m, state.finger_width_m)), frozenset({window.object})
            if held is not None:
                hand = _Hand(state.finger_width_m, held, state.ee_pose.inverse() @ state.pose(held))
                touched = frozenset()
            way = self._way_in(state, _Candidate(skill, moved, change, hand, touched))
            if way is None:
                continue
            self.used.append(skill.source)
            state = yield from self._transit(state, way, held=held)
            if held is not None and state.held != held:
                raise AttemptFailedError("dropped", f"{held} slipped out on the way to {window.target}")
            state = yield from self._play(state, moved.from_step(way.begin, faster=faster))
            if window.kind == "pick" and state.held != window.object:
                raise AttemptFailedError("missed grasp", f"{window.object} is not in the gripper after the lift")
            return state, skill.source
        what = f"{window.kind} {window.object}" + (f" at {window.target}" if window.target else "")
        why = "; ".join(dict.fromkeys(self._blocked)) or "no source has this skill"
        raise AttemptFailedError("no free way", f"{what}: no source demonstration can be transferred ({why})")

    def _drawn_turn(self) -> float:
        """Draw a random rotation of the grasp [rad], for an object that can be grasped from any side."""
        return TURN_RAD * float(self._draw.integers(-1, 2))

    def _slide_m(self, state: WorldState, window: SkillWindow) -> float:
        """Return the distance by which a drawer must be moved [m].

        The drawer is closed completely, or opened as far as in the primary source demonstration.
        """
        opening = distance(state.pose(window.object).position, self._shut[window.object].position)
        lead = next(s for s in self._lead.skills if s.window == window)
        if lead.slid_m < 0.0:
            return -opening - PRESS_M
        drawn = float(lead.asset.parameters["travel_m"])
        full = abs(drawn - lead.slid_m) < FULL_M
        return (self._planner.travel_m(window.object) if full else lead.slid_m) - opening

    def _ordered(
        self, state: WorldState, key: tuple[str, str, str, str, str], window: SkillWindow, source: str | None
    ) -> list[SourceSkill]:
        """Return the matching skills of all source demonstrations, in the order in which they should be tried.

        For a placement, the source demonstration that was used for the pick comes first, because the object is then
        held in the same way.
        """
        found = list(self._library.skills(key))
        found = [found[i] for i in self._draw.permutation(len(found))]
        if self._settings.select != "random":
            by_object = self._settings.select == "nearest_object"
            far = self._from_object if by_object else self._from_robot
            found.sort(key=lambda skill: far(state, window, skill))
            nearest = found[: max(NEAREST, round(NEAREST_SHARE * len(found)))]
            found[: len(nearest)] = [nearest[i] for i in self._draw.permutation(len(nearest))]
        if window.kind == "place" and source is not None:
            found.sort(key=lambda skill: skill.source != source)
        return found

    def _from_object(self, state: WorldState, window: SkillWindow, skill: SourceSkill) -> float:
        """Return the difference between the object's pose in the source demonstration and its pose in the scene.

        For a placement, the poses of the target are compared instead. A rotation of 1 rad counts as 1 m.
        """
        here = state.pose(window.object) if window.kind != "place" else state.pose(window.target)
        there = skill.object_pose if window.kind != "place" else skill.target_pose
        other = skill.asset.identity != self._planner.asset(window.object).identity
        turned = angle_between(there.quaternion, here.quaternion)
        return distance(there.position, here.position) + turned + OTHER_INSTANCE_M * other

    def _from_robot(self, state: WorldState, window: SkillWindow, skill: SourceSkill) -> float:
        """Return the distance of the arm from the first pose of a skill. A rotation of 1 rad counts as 1 m."""
        found = next((moved for _, moved in self._candidates(state, window, [skill], skill.slid_m)), None)
        if found is None:
            return float("inf")
        begin = found.targets[found.begin_within(BEGIN_WITHIN_M[0])]
        turned = angle_between(begin.quaternion, state.ee_pose.quaternion)
        return distance(begin.position, state.ee_pose.position) + turned

    def _candidates(
        self,
        state: WorldState,
        window: SkillWindow,
        skills: Sequence[SourceSkill],
        slide_m: float,
        *,
        turn_rad: float = 0.0,
    ) -> Iterator[tuple[SourceSkill, CarriedOver]]:
        """Transfer skills of the source demonstrations to this scene, and yield each transferred skill with its source.

        For an object that can be grasped from any side, the grasp is first rotated about the object's axis by
        ``turn_rad``. If all skills are blocked, other rotations are tried. A container may contain other objects than
        in the source demonstration. The object may therefore be released at another position that the expert would
        choose, if some demonstrations release objects there.
        """
        asset = self._planner.asset(window.object)
        symmetric = any(grasp.symmetric_yaw for grasp in asset.grasps)
        for skill in skills:
            if window.kind == "pick":
                if symmetric and turn_rad:
                    yield skill, carry_pick(skill, state, window.object, asset, turn_rad=turn_rad)
                yield skill, carry_pick(skill, state, window.object, asset)
            elif window.kind == "slide":
                yield skill, carry_slide(skill, state, window.object, asset, slide_m=slide_m)
            elif (moved := carry_place(skill, state, window)) is not None:
                yield skill, moved
                if symmetric:
                    turned = carry_place(skill, state, window, keep_tool=True)
                    if turned is not None:
                        yield skill, turned
        if window.kind == "place" and skills and relation(window.relation).falls:
            for foot in filter(partial(self._is_trained, state, window), other_goals(state, window)):
                moved = carry_place(skills[0], state, window, foot=foot)
                if moved is not None:
                    yield skills[0], moved
        if window.kind == "pick" and symmetric:
            for skill, turn in itertools.product(skills[:NEAREST], TURNS_RAD):
                yield skill, carry_pick(skill, state, window.object, asset, turn_rad=turn)

    def _is_trained(self, state: WorldState, window: SkillWindow, foot: tuple[float, float, float]) -> bool:
        """Return whether demonstrations release objects at the given position of the object's base [m].

        If this was not measured for the target, return True.
        """
        trained = self._trained(window.target, window.relation, window.region)
        if trained is None:
            return True
        x, y, _ = region_frame(state, window).inverse().apply(foot)
        near = trained.aside_mm(1000.0 * x, 1000.0 * y) <= SURE * REACH_MM
        return near and abs(trained.off_mm(1000.0 * foot[2])) <= SURE * HEIGHT_MM

    def _way_in(self, state: WorldState, skill: _Candidate) -> _WayIn | None:
        """Return a collision-free path to the start of a skill, or to a later step of its approach.

        Return None if there is no such path.
        """
        tried: set[int] = set()
        for radius in BEGIN_WITHIN_M:
            begin = skill.moved.begin_within(radius)
            if begin in tried:
                continue
            tried.add(begin)
            blocked: str | None = "no collision-free path"
            for way, joints in self._free_ways(state, skill, begin):
                blocked = self._what_blocks(state, skill, begin, joints)
                if blocked is None:
                    return way
                if blocked != OUT_OF_REACH:
                    break  # no path to the start helps if the skill itself is blocked
            self._blocked.append(blocked or "")
        return None

    def _free_ways(self, state: WorldState, skill: _Candidate, begin: int) -> Iterator[tuple[_WayIn, list[float]]]:
        """Yield collision-free paths to a step of a skill, each with the joint positions at the end of the path [rad].

        The first paths repeat the transit of the source demonstration, with and without variation. The last path is
        planned.
        """
        goal, hand = skill.moved.targets[begin], skill.hand
        for change in (skill.change, TransitChange(faster=skill.change.faster)):
            way = carry_transit(skill.source, begin, state.commanded_pose, goal, change)
            if way is None:
                break
            joints = self._planner.free_way(
                state,
                checkpoints(way, self._planner.workspace.check_step_m),
                hand.width_m,
                held=hand.held,
                T_tcp_object=hand.T_tcp_object,
            )
            if joints is not None:
                yield _WayIn(way[1:-1], False, begin), joints
        found = self._planner.way_to(state, goal, hand.width_m, held=hand.held, T_tcp_object=hand.T_tcp_object)
        if found is not None:
            yield _WayIn(found[0], True, begin), found[1]

    def _what_blocks(self, state: WorldState, skill: _Candidate, begin: int, joints: Sequence[float]) -> str | None:
        """Return the first obstacle that a skill collides with, or None if the skill is free.

        The motion before the gripper opens or closes is checked and, for a placement, the opening of the gripper.
        """
        hand, points = skill.hand, skill.moved.checkpoints(begin, skill.moved.change)
        held, T_tcp_object = hand.held, hand.T_tcp_object
        blocked, joints = self._planner.check_way(
            joints, points, hand.width_m, held=held, T_tcp_object=T_tcp_object, ignore=skill.touched
        )
        if blocked is not None or held is None:
            return blocked
        opened = state.finger_width_m + skill.source.spread_m
        return self._planner.check_way(
            joints, (points[-1],) * 2, opened, held=held, T_tcp_object=T_tcp_object, ignore=frozenset({held})
        )[0]

    def _faster(self, skill: SourceSkill) -> float:
        """Return the factor that adapts the speed of a skill to the tempo of the primary source demonstration."""
        own, lead = skill.tempo_mps, self._tempo_mps
        return min(TEMPO, max(1.0 / TEMPO, lead / own)) if own > 0.0 and lead > 0.0 else 1.0

    def _transit(self, state: WorldState, way: _WayIn, *, held: str | None) -> Motion:
        """Move to the start of a skill at the tempo of the primary source demonstration."""
        self._quiet = False
        pace = CARRY if held is not None else FREE
        gripper = OPEN if held is None else 1.0
        if way.planned:
            return (
                yield from follow(
                    state, way.poses, gripper=gripper, pace=self._paced(pace), period_s=self._period_s, settle=3
                )
            )
        for pose in way.poses:
            state = yield delta_action(state.commanded_pose, pose, gripper)
        return state

    def _paced(self, pace: Pace) -> Pace:
        s = self._speed
        return replace(pace, speed=s * pace.speed, corner_speed=s * pace.corner_speed, turning=s * pace.turning)

    def _play(self, state: WorldState, moved: CarriedOver) -> Motion:
        """Execute a transferred skill. Before the gripper opens or closes, the arm settles without action noise."""
        before = OPEN if moved.gripper[moved.change] > 0.0 else 1.0
        for i, (target, gripper) in enumerate(zip(moved.targets, moved.gripper, strict=True)):
            changes = (gripper > 0.0) != (before > 0.0)
            if changes:
                state = yield from self._settle(state, moved.targets[max(0, i - 1)], before)
            before = gripper
            moving = i + 1 < len(moved.targets) and distance(target.position, moved.targets[i + 1].position) > STILL_M
            if gripper > 0.0 and moving and self._quiet:
                state = yield from self._close(state, target)
            self._quiet = changes or (self._quiet and not moving)
            state = yield delta_action(state.commanded_pose, target, gripper)
        self._quiet = False
        return state

    def _settle(self, state: WorldState, goal: Pose, gripper: float) -> Motion:
        """Hold the goal pose until the arm has reached it."""
        self._quiet = True
        for _ in range(SETTLE_STEPS):
            near = distance(state.ee_pose.position, goal.position) < SETTLE_M
            if near and angle_between(state.ee_pose.quaternion, goal.quaternion) < SETTLE_RAD:
                break
            state = yield delta_action(state.commanded_pose, goal, gripper)
        return state

    def _close(self, state: WorldState, goal: Pose) -> Motion:
        """Close the fingers until they stop.

        The recorded gripper motion is not repeated, because the object may be narrower than in the source
        demonstration.
        """
        still = 0
        for _ in range(SETTLE_STEPS):
            width = state.finger_width_m
            state = yield delta_action(state.commanded_pose, goal, 1.0)
            still = still + 1 if abs(state.finger_width_m - width) < STILL_M else 0
            if still >= STILL_STEPS:
                break
        return state

    def _leave(self, state: WorldState) -> Motion:
        """Retreat upward at the end. The source demonstration may have ended before its gripper had left the object."""
        if state.held is not None:
            return state
        goal = state.commanded_pose.translated(z=LEAVE_M)
        return (
            yield from follow(state, (goal,), gripper=0.0, pace=self._paced(CARRY), period_s=self._period_s, settle=2)
        )
