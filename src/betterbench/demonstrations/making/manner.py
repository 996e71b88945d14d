"""Motion styles of demonstrations, which are drawn at random to imitate differences between people."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import asdict, dataclass, replace

import numpy as np

from betterbench.errors import PlanningError
from betterbench.geometry import Pose, angle_between
from betterbench.interface.state import WorldState
from betterbench.policies.experts.motion import (
    APPROACH,
    FREE,
    OPEN,
    Motion,
    Pace,
    close_gripper,
    follow,
    hold,
    open_gripper,
)
from betterbench.policies.experts.skills import Skills

MISS_GAP_M = 0.012
"""Minimum height above the object at which the gripper closes in a missed grasp [m]."""
MISS_STEPS = 12
"""Maximum number of control steps for which the gripper stays closed in a missed grasp."""


@dataclass(frozen=True, slots=True)
class DemonstrationManner:
    """Motion style of one demonstration.

    Attributes:
        speed: Speed as a fraction of the expert's speed.
        acceleration: Acceleration as a fraction of the expert's acceleration.
        approach_height_m: Height above the grasp at which the final approach begins [m].
        approach_offset_m: Horizontal distance from the grasp at which the final approach begins [m].
        approach_bearing_rad: Direction of this horizontal offset in the world frame [rad].
        grasp_turn_rad: Strength of the random preference among gripper rotations. When grasps are ranked, a random
            value of at most this size is added to or subtracted from the cost of each rotation [rad].
        raise_m: Additional height of transits [m].
        detour_m: Largest sideways displacement of the midpoint of a transit (the motion between two skills) [m].
        pause_s: Mean duration of a pause [s].
        pause_rate: Probability of a pause at each moment where a pause is possible.
        miss_rate: Probability of a missed grasp, in which the gripper closes too early and opens again.
    """

    speed: float = 1.0
    acceleration: float = 1.0
    approach_height_m: float = 0.08
    approach_offset_m: float = 0.0
    approach_bearing_rad: float = 0.0
    grasp_turn_rad: float = 0.0
    raise_m: float = 0.0
    detour_m: float = 0.0
    pause_s: float = 0.0
    pause_rate: float = 0.0
    miss_rate: float = 0.0

    def to_json(self) -> dict[str, float]:
        """Return the motion style as a JSON-serializable dict."""
        return {name: float(value) for name, value in asdict(self).items()}


def draw_manner(draw: np.random.Generator) -> DemonstrationManner:
    """Draw a motion style from a random stream.

    Teleoperators are up to three times slower than a scripted expert. They pause before contact, approach at an angle,
    and sometimes close the gripper too early. The ranges of the motion styles are assumptions and were not measured.
    """
    return DemonstrationManner(
        speed=round(float(np.clip(0.75 * math.exp(0.22 * draw.standard_normal()), 0.45, 1.1)), 4),
        acceleration=round(float(draw.uniform(0.5, 1.0)), 4),
        approach_height_m=round(float(draw.uniform(0.05, 0.11)), 4),
        approach_offset_m=round(float(draw.uniform(0.0, 0.03)), 4),
        approach_bearing_rad=round(float(draw.uniform(-math.pi, math.pi)), 4),
        grasp_turn_rad=round(float(draw.uniform(0.0, 0.5)), 4),
        raise_m=round(float(draw.uniform(0.0, 0.08)), 4),
        detour_m=round(float(draw.uniform(0.0, 0.08)), 4),
        pause_s=round(float(draw.uniform(0.1, 0.5)), 4),
        pause_rate=round(float(draw.uniform(0.2, 0.8)), 4),
        miss_rate=round(float(draw.choice([0.0, 0.0, 0.25])), 4),
    )


@dataclass
class VariedSkills(Skills):
    """Skills of the expert, executed in a given motion style.

    Detours and missed grasps are planned like all other motions. A detour or missed grasp is left out if an obstacle
    blocks it.

    Attributes:
        manner: The motion style.
        chance: Random stream of the demonstration, used for pauses, detours and missed grasps.
    """

    manner: DemonstrationManner = DemonstrationManner()
    chance: np.random.Generator | None = None

    def paced(self, pace: Pace) -> Pace:
        """Scale the speeds and the acceleration of a motion as the motion style requires."""
        m = self.manner
        return replace(
            pace,
            speed=m.speed * pace.speed,
            corner_speed=m.speed * pace.corner_speed,
            acceleration=m.acceleration * pace.acceleration,
            turning=m.speed * pace.turning,
        )

    def wait(self, state: WorldState, *, gripper: float) -> Motion:
        """Pause with the probability that the motion style defines."""
        if self._stream.random() >= self.manner.pause_rate:
            return state
        seconds = min(float(self._stream.exponential(self.manner.pause_s)), 1.0)
        return (yield from hold(state, round(seconds / self.period_s), gripper=gripper))

    def passing(
        self, state: WorldState, way: tuple[Pose, ...], width_m: float, *, held: str | None = None
    ) -> tuple[Pose, ...]:
        """Return a path up, across and down, with a detour if the detour is free of collisions."""
        *_, up, over, goal = way
        raised = self.manner.raise_m
        aside = float(self._stream.uniform(-1.0, 1.0)) * self.manner.detour_m
        dx, dy = (b - a for a, b in zip(up.position[:2], over.position[:2], strict=True))
        length = math.hypot(dx, dy)
        if length < 0.05:
            return way
        up, over = up.translated(z=raised), over.translated(z=raised)
        x, y, z = (0.5 * (a + b) for a, b in zip(up.position, over.position, strict=True))
        middle = Pose((x - aside * dy / length, y + aside * dx / length, z), up.quaternion)
        varied = (up, middle, over, goal)
        T_tcp_object = None if held is None else state.ee_pose.inverse() @ state.pose(held)
        blocked, _ = self.planner.check_way(
            state.joint_positions,
            (state.commanded_pose, *varied),
            width_m,
            held=held,
            T_tcp_object=T_tcp_object,
            lenient_start=True,
        )
        return way if blocked else varied

    def reach(self, state: WorldState, name: str) -> Generator[np.ndarray, WorldState, tuple[WorldState, Pose]]:
        """Move to the start of the final approach next to the grasp, and from there to the grasp.

        Raises PlanningError if the motion is blocked.
        """
        m = self.manner
        turns = self._stream.uniform(-m.grasp_turn_rad, m.grasp_turn_rad, 16)

        def cost(T_world_tcp: Pose) -> float:
            heading = angle_between(T_world_tcp.quaternion, state.ee_pose.quaternion)
            return float(turns[round(heading / (math.pi / 8.0)) % 16])

        plan = self.planner.plan_pick(state, name, cost=cost)
        grasp, way = plan.grasp, plan.way
        aside = m.approach_offset_m
        before = grasp.translated(
            aside * math.cos(m.approach_bearing_rad), aside * math.sin(m.approach_bearing_rad), m.approach_height_m
        )
        found = self.planner.way_to(state, before, plan.width_m)
        alone = frozenset({name})
        if found and self.planner.check_way(found[1], (before, grasp), plan.width_m, ignore=alone)[0] is None:
            way = found[0]
        way = self.passing(state, way, plan.width_m)
        state = yield from follow(state, way, gripper=OPEN, pace=self.paced(FREE), period_s=self.period_s)
        state = yield from self.wait(state, gripper=OPEN)
        if self._stream.random() < m.miss_rate:
            state = yield from self._miss(state, name, way[-1], grasp)
        state = yield from follow(state, (grasp,), gripper=OPEN, pace=self.paced(APPROACH), period_s=self.period_s)
        state = yield from self.wait(state, gripper=OPEN)
        state = yield from self.close_up(state, plan, grasp)
        return state, grasp

    def _miss(self, state: WorldState, name: str, start: Pose, grasp: Pose) -> Motion:
        """During the descent to a grasp, close and reopen the gripper above the object.

        Skip this if anything is in the way.
        """
        info = state.info.object(name)
        top = state.pose(name).position[2] + info.size_m[2] + MISS_GAP_M
        low, high = grasp.position[2], start.position[2]
        if high <= low or top >= high:
            return state
        share = (top - low) / (high - low)
        x, y = (g + share * (s - g) for g, s in zip(grasp.position[:2], start.position[:2], strict=True))
        there = Pose((x, y, top), grasp.quaternion)
        blocked, _ = self.planner.check_way(state.joint_positions, (start, there), 0.0)
        if blocked is not None:
            return state
        state = yield from follow(state, (there,), gripper=OPEN, pace=self.paced(APPROACH), period_s=self.period_s)
        state = yield from close_gripper(state, steps=MISS_STEPS)
        state = yield from self.wait(state, gripper=1.0)
        return (yield from open_gripper(state, width_m=0.07))

    @property
    def _stream(self) -> np.random.Generator:
        if self.chance is None:
            raise PlanningError("VariedSkills requires a random stream; set its attribute chance")
        return self.chance
