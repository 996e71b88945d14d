"""The goal of a condition, tracked over time: subgoals, order, exclusiveness, dwell and forbidden interactions."""

from __future__ import annotations

from dataclasses import dataclass

from betterbench.geometry import distance
from betterbench.state import SceneInfo, WorldState
from betterbench.tasks.axes import Expected
from betterbench.tasks.condition import Condition
from betterbench.tasks.predicates import arm_still, at_rest, relation, released
from betterbench.tasks.template import Template
from betterbench.tasks.thresholds import THRESHOLDS


@dataclass(frozen=True, slots=True)
class Truth:
    """What holds at one control step.

    Attributes:
        relations: Per movable object, in the order of :attr:`GoalTracker.relation_names`: is it at the target?
        subgoals: Per subgoal: is it done (related, released and at rest) now?
        in_order: False as soon as a subgoal was done before one that comes earlier in an ordered instruction.
        goal: All subgoals done in order, and nothing else at the target.
        forbidden: An interaction happened so far that the condition forbids.
        success: The episode has succeeded.
    """

    relations: tuple[bool, ...]
    subgoals: tuple[bool, ...]
    in_order: bool
    goal: bool
    forbidden: bool
    success: bool


class GoalTracker:
    """Follows one episode. Feed it every state from reset on, in order; live and offline use are the same."""

    def __init__(self, condition: Condition, info: SceneInfo, *, template: Template, control_rate_hz: float) -> None:
        """Prepare for an episode.

        Args:
            condition: The condition in force.
            info: The scene.
            template: The template of the task.
            control_rate_hz: Control rate [Hz], by which the dwell is counted.
        """
        self._condition = condition
        self._template = template
        goals = condition.instruction.subgoals
        self._goals = goals
        self._candidates = tuple(condition.resolve(g.reference) for g in goals)
        self._target = goals[0].target
        self._relation = relation(template.relation)
        self._movable = tuple(o.name for o in info.objects if o.role in ("item", "distractor") and not o.fixed)
        asked: dict[tuple[str, ...], int] = {}
        for goal, names in zip(goals, self._candidates, strict=True):
            asked[names] = max(asked.get(names, 0), goal.count)
        self._asked = asked
        self._meant = frozenset(name for names in self._candidates for name in names)
        self._dwell_steps = round(template.dwell_s * control_rate_hz)
        self._settle_steps = round(THRESHOLDS.settle_time * control_rate_hz)
        self._limit = template.step_limit(condition)
        self._ever_done = [False] * len(goals)
        self._in_order = True
        self._forbidden = False
        self._held_for = 0
        self._still_for = 0
        self._goal_broken = False

    @property
    def relation_names(self) -> tuple[str, ...]:
        """Names of the relation columns, "inside(burger_1, box)"."""
        return tuple(f"{self._template.relation}({name}, {self._target})" for name in self._movable)

    @property
    def subgoal_names(self) -> tuple[str, ...]:
        """Names of the subgoals."""
        return tuple(g.name for g in self._goals)

    def update(self, state: WorldState) -> Truth:
        """Judge the next state of the episode."""
        relations = tuple(self._relation(state, name, self._target) for name in self._movable)
        there = {name for name, holds in zip(self._movable, relations, strict=True) if holds}
        settled = {name for name in there if released(state, name) and at_rest(state, name)}
        done = tuple(
            sum(name in settled for name in names) >= goal.count
            for goal, names in zip(self._goals, self._candidates, strict=True)
        )
        self._track_order(done)
        exclusive = not self._template.exclusive or (
            there <= self._meant
            and all(sum(name in there for name in names) <= count for names, count in self._asked.items())
        )
        goal = all(done) and exclusive and (self._in_order or not self._condition.instruction.ordered)
        self._forbidden = self._forbidden or self._breaks_a_rule(state)
        return Truth(relations, done, self._in_order, goal, self._forbidden, self._succeeded(state, goal=goal))

    def _track_order(self, done: tuple[bool, ...]) -> None:
        newly = [i for i, now in enumerate(done) if now and not self._ever_done[i]]
        for i in newly:
            if not all(self._ever_done[j] or done[j] for j in range(i)):
                self._in_order = False
            self._ever_done[i] = True

    def _breaks_a_rule(self, state: WorldState) -> bool:
        if self._condition.expected is Expected.STAY_STILL:
            return interferes(state)
        if self._condition.expected is Expected.REFUSE:
            return any(name not in self._meant and state.touched_by_gripper(name) for name in self._movable)
        return False

    def _succeeded(self, state: WorldState, *, goal: bool) -> bool:
        expected = self._condition.expected
        self._held_for = self._held_for + 1 if goal else 0
        if expected is Expected.SUCCEED:
            return self._held_for > self._dwell_steps
        self._still_for = self._still_for + 1 if arm_still(state) else 0
        settled = state.step >= self._limit and self._still_for >= self._settle_steps and not self._forbidden
        if expected is Expected.STAY_STILL:
            self._goal_broken = self._goal_broken or not goal
            return settled and not self._goal_broken
        return settled


def interferes(state: WorldState) -> bool:
    """Tell whether the gripper touches an object, or closes away from home: forbidden where nothing is to be done."""
    if any(state.touched_by_gripper(o.name) for o in state.info.objects):
        return True
    return state.gripper_command > 0.0 and distance(state.ee_pose.position, state.info.home_position) > (
        THRESHOLDS.home_radius
    )
