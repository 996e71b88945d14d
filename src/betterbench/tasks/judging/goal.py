"""The goal of a condition, tracked over time: subgoals, order, harm, dwell and forbidden interactions."""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

from betterbench.interface.state import Contact, SceneInfo, WorldState
from betterbench.tasks.authoring.template import Template
from betterbench.tasks.axes import Expected
from betterbench.tasks.condition import Condition
from betterbench.tasks.judging.harm import Harm, HarmWatch
from betterbench.tasks.judging.picked_slots import picked_slots
from betterbench.tasks.judging.restraint import Restraint
from betterbench.tasks.judging.targets import Places, Targets, asked_by
from betterbench.tasks.relations import RestWatch, arm_still, is_at, released
from betterbench.tasks.thresholds import THRESHOLDS


class Truth(NamedTuple):
    """Goal state at one control step. A named tuple, because one is built at every control step.

    Attributes:
        relations: Whether each predicate is true, in the order of :attr:`GoalTracker.relation_names`.
        subgoals: Whether each subgoal is done now (related, released and at rest).
        in_order: False once a subgoal was done before an earlier one of an ordered instruction.
        goal: All subgoals done in order, without harm (see ``tasks.harm``).
        forbidden: Whether a forbidden interaction has happened so far.
        success: The episode has succeeded.
    """

    relations: tuple[bool, ...]
    subgoals: tuple[bool, ...]
    in_order: bool
    goal: bool
    forbidden: bool
    success: bool


class GoalTracker:
    """Tracker of the goal in an episode, live or offline. Pass it every state from reset on, in order."""

    def __init__(self, condition: Condition, info: SceneInfo, *, template: Template, control_rate_hz: float) -> None:
        """Prepare for an episode; the dwell time is counted at the control rate."""
        self._condition, self._info = condition, info
        self._goals = condition.instruction.subgoals
        asked = asked_by(condition)
        self._targets = Targets(asked, info, placing=template.relation)
        self._harm = HarmWatch(asked, self._targets, info, exclusive=template.exclusive)
        self._rest = RestWatch(rate_hz=control_rate_hz)
        self._after = tuple(
            tuple(j for j in range(i) if asked[j].target in it.candidates) for i, it in enumerate(asked)
        )
        self._relations_at: tuple[dict[str | None, tuple[bool, ...]], ...] = tuple({} for _ in self._targets.watches)
        self._relations: tuple[bool, ...] = ()
        self._dwell_steps = round(template.dwell_s * control_rate_hz)
        self._settle_steps = round(THRESHOLDS.settle_time * control_rate_hz)
        self._limit = template.step_limit(condition)
        self._restraint = None
        if condition.expected is not Expected.SUCCEED:
            meant = frozenset(info.index(name) for it in asked for name in it.candidates)
            self._restraint = Restraint(
                condition.expected, info, asked=meant, rate_hz=control_rate_hz, step_limit=self._limit,
                picked=picked_slots(condition.task, info),
            )  # fmt: skip
        self._ever_done = [False] * len(self._goals)
        self._done_before: tuple[bool, ...] | None = None
        self._in_order = True
        self._forbidden = False
        self._held_for = 0
        self._still_for = 0
        self._goal_broken = False
        self._settling = False
        self._last: tuple[WorldState, Places] | None = None
        self._lasting: Truth | None = None
        """Goal state while no object moves and no contact changes; None if it also depends on time."""

    @property
    def relation_names(self) -> tuple[str, ...]:
        """Names of the relation columns, "inside(burger_1, box)"."""
        return tuple(
            watch.relation.label(name, watch.target, place)
            for watch in self._targets.watches
            for name in watch.subjects
            for place in watch.places
        )

    @property
    def subgoal_names(self) -> tuple[str, ...]:
        """Names of the subgoals."""
        return tuple(g.name for g in self._goals)

    @property
    def harm(self) -> tuple[Harm, ...]:
        """The harm up to the last state, which prevents success."""
        return () if self._last is None else self._harm.found(*self._last)

    @property
    def undecided_states(self) -> int:
        """Number of following states in which the episode cannot succeed yet, whatever happens."""
        if self._condition.expected is Expected.SUCCEED:
            return max(0, self._dwell_steps - self._held_for)
        return 0 if self._last is None else max(0, self._limit - self._last[0].step - 1)

    def update(self, state: WorldState) -> Truth:
        """Judge the next state of the episode."""
        self._rest.see(state)
        if self._last is None:
            at = self._targets.places(state)
            self._relations = self._relations_of(at)
        else:
            before, at = self._last
            changed = _changed(before, state)
            if changed:
                after = self._targets.places_after(state, at, changed)
                if after is not at:
                    at, self._relations = after, self._relations_of(after)
            elif self._lasting is not None:
                self._last = (state, at)
                return self._lasting
        self._last = (state, at)
        self._harm.see(state, at)
        done = self._what_is_done(state, at)
        if self._done_before is None:
            for i, now in enumerate(done):
                self._ever_done[i] = now and all(self._ever_done[:i])
        elif done != self._done_before:
            self._track_order(done, self._done_before)
        self._done_before = done
        in_order = self._in_order or not self._condition.instruction.ordered
        goal = all(done) and in_order and not self._harm.found(state, at)
        if self._restraint is not None:
            self._forbidden = self._restraint.breaks(state, self._there(at)) or self._forbidden
        success = self._succeeded(state, at, goal=goal)
        truth = Truth(self._relations, done, self._in_order, goal, self._forbidden, success)
        waits = goal or self._settling or self._restraint is not None
        self._lasting = None if waits else truth
        return truth

    def _relations_of(self, at: Places) -> tuple[bool, ...]:
        """Return the truth of the predicates, in the order of their names."""
        found: list[tuple[bool, ...]] = []
        for watch, table, places in zip(self._targets.watches, self._relations_at, at, strict=True):
            for place in places:
                if place not in table:
                    table[place] = tuple([is_at(place, region) for region in watch.places])
                found.append(table[place])
        return tuple(chain.from_iterable(found))

    def _there(self, at: Places) -> list[bool]:
        """Return for each object whether it is in some region of a target to which objects are carried."""
        there = [False] * len(self._info.objects)
        for watch, places in zip(self._targets.watches, at, strict=True):
            for name, place in zip(watch.subjects, places, strict=True):
                if place is not None and watch.relation.carried:
                    there[self._info.index(name)] = True
        return there

    def _what_is_done(self, state: WorldState, at: Places) -> tuple[bool, ...]:
        """Return which subgoals are done: their objects are at the target, at rest and released."""
        settled: dict[str, bool] = {}
        self._settling = False
        done: list[bool] = []
        for due, after in zip(self._targets.due, self._after, strict=True):
            there = 0
            names, places = self._targets.watches[due.watch].subjects, at[due.watch]
            for s in due.candidates:
                if not is_at(places[s], due.region):
                    continue
                name = names[s]
                if name not in settled:
                    settled[name] = released(state, name) and self._rest.at_rest(name)
                    self._settling = self._settling or not settled[name]
                there += settled[name]
            done.append(there >= due.least and (not after or all(done[j] for j in after)))
        return tuple(done)

    def _track_order(self, done: tuple[bool, ...], before: tuple[bool, ...]) -> None:
        for i, now in enumerate(done):
            if now and not before[i] and not self._ever_done[i]:
                if not all(self._ever_done[j] or done[j] for j in range(i)):
                    self._in_order = False
                self._ever_done[i] = True

    def _succeeded(self, state: WorldState, at: Places, *, goal: bool) -> bool:
        expected = self._condition.expected
        self._held_for = self._held_for + 1 if goal else 0
        if expected is Expected.SUCCEED:
            return self._held_for > self._dwell_steps
        self._still_for = self._still_for + 1 if arm_still(state) else 0
        settled = state.step >= self._limit and self._still_for >= self._settle_steps and not self._forbidden
        if expected is Expected.STAY_STILL:
            self._goal_broken = self._goal_broken or not goal
            return settled and not self._goal_broken
        return settled and not self._harm.found(state, at)


def _changed(before: WorldState, now: WorldState) -> set[str]:
    """Return the names of the bodies with a difference between two states that a relation may read.

    The compared data are the pose of an object, the contacts of a body, and whether it is held.
    """
    changed: set[str] = set()
    if before.positions != now.positions or before.quaternions != now.quaternions:
        poses = zip(now.info.objects, before.positions, now.positions, before.quaternions, now.quaternions, strict=True)
        for thing, was, there, turned, turn in poses:
            if was != there or turned != turn:
                changed.add(thing.name)
    if before.held != now.held:
        changed.update(name for name in (before.held, now.held) if name is not None)
    if not _same_pairs(before.contacts, now.contacts):
        touched, touching = ({pair[:2] for pair in contacts} for contacts in (before.contacts, now.contacts))
        changed.update(name for pair in touched ^ touching for name in pair)
    return changed


def _same_pairs(before: Sequence[Contact], now: Sequence[Contact]) -> bool:
    """Tell whether the same pairs are in contact, whatever their forces."""
    if before is now:
        return True
    if len(before) != len(now):
        return False
    for (a, b, _), (c, d, _) in zip(before, now, strict=True):  # noqa: SIM110 - half of the time of all()
        if a != c or b != d:
            return False
    return True
