"""The goal of a condition, tracked over time: subgoals, order, exclusiveness, dwell and forbidden interactions."""

from dataclasses import dataclass

from betterbench.geometry import distance
from betterbench.state import SceneInfo, WorldState
from betterbench.tasks.axes import Expected
from betterbench.tasks.condition import Condition
from betterbench.tasks.relations import Relation, arm_still, at_rest, relation, released
from betterbench.tasks.subgoal import Subgoal
from betterbench.tasks.template import Template
from betterbench.tasks.thresholds import THRESHOLDS


@dataclass(frozen=True, slots=True)
class Truth:
    """What holds at one control step.

    Attributes:
        relations: Per predicate, in the order of :attr:`GoalTracker.relation_names`: does it hold?
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


@dataclass(frozen=True, slots=True)
class _Watch:
    """One target that is watched: which of the subjects are at which of its places, all by name."""

    relation: Relation
    target: str
    subjects: tuple[str, ...]
    places: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Due:
    """What a subgoal needs: enough of its candidates at a place of a watched target, after other subgoals.

    Attributes:
        watch: Number of the watched target.
        place: TargetRegion of that target.
        candidates: Numbers, among the subjects, of the objects that it can mean.
        count: How many of them must be there.
        after: Subgoals that have to be done as well: a drawer is shut on what was to go into it.
    """

    watch: int
    region: str
    candidates: tuple[int, ...]
    count: int
    after: tuple[int, ...]


class GoalTracker:
    """Follows one episode. Feed it every state from reset on, in order; live and offline use are the same."""

    def __init__(self, condition: Condition, info: SceneInfo, *, template: Template, control_rate_hz: float) -> None:
        """Prepare for an episode; the dwell is counted by the control rate."""
        self._condition = condition
        self._exclusive, self._placing = template.exclusive, template.relation
        self._goals = condition.instruction.subgoals
        candidates = tuple(condition.resolve(g.reference) for g in self._goals)
        self._meant = frozenset(name for names in candidates for name in names)
        self._movable = tuple(o.name for o in info.objects if o.role in ("item", "distractor") and not o.fixed)
        self._watches = _watches(self._goals, info)
        self._due = tuple(self._what_is_due(i, names) for i, names in enumerate(candidates))
        self._columns = tuple(
            (w, s, place)
            for w, watch in enumerate(self._watches)
            for s in range(len(watch.subjects))
            for place in watch.places
        )
        self._allowed = self._what_is_allowed()
        self._dwell_steps = round(template.dwell_s * control_rate_hz)
        self._settle_steps = round(THRESHOLDS.settle_time * control_rate_hz)
        self._limit = template.step_limit(condition)
        self._ever_done = [False] * len(self._goals)
        self._done_before: tuple[bool, ...] | None = None
        self._at_start: list[list[str | None]] = []
        self._in_order = True
        self._forbidden = False
        self._held_for = 0
        self._still_for = 0
        self._goal_broken = False

    @property
    def relation_names(self) -> tuple[str, ...]:
        """Names of the relation columns, "inside(burger_1, box)"."""
        watches = self._watches
        return tuple(
            watches[w].relation.label(watches[w].subjects[s], watches[w].target, place) for w, s, place in self._columns
        )

    @property
    def subgoal_names(self) -> tuple[str, ...]:
        """Names of the subgoals."""
        return tuple(g.name for g in self._goals)

    def update(self, state: WorldState) -> Truth:
        """Judge the next state of the episode."""
        at = [[w.relation.where(state, name, w.target) for name in w.subjects] for w in self._watches]
        done = self._what_is_done(state, at)
        if self._done_before is None:
            self._at_start = at
            for i, now in enumerate(done):
                self._ever_done[i] = now and all(self._ever_done[:i])
        elif done != self._done_before:
            self._track_order(done, self._done_before)
        self._done_before = done
        goal = all(done) and (self._in_order or not self._condition.instruction.ordered) and self._nothing_else(at)
        self._forbidden = self._forbidden or self._breaks_a_rule(state)
        relations = tuple([at[w][s] == place for w, s, place in self._columns])
        return Truth(relations, done, self._in_order, goal, self._forbidden, self._succeeded(state, goal=goal))

    def _what_is_due(self, i: int, names: tuple[str, ...]) -> _Due:
        """Return what a subgoal needs."""
        goal = self._goals[i]
        watch = next(
            w for w, it in enumerate(self._watches) if it.relation.name == goal.relation and it.target == goal.target
        )
        subjects = self._watches[watch].subjects
        after = tuple(j for j in range(i) if self._goals[j].target in names)
        return _Due(watch, goal.region, tuple(subjects.index(n) for n in names if n in subjects), goal.count, after)

    def _what_is_allowed(self) -> dict[tuple[int, str], tuple[tuple[tuple[int, ...], int], ...]]:
        """Return, per place of a watched target, which subjects may be there and how many of them."""
        most: dict[tuple[int, str], dict[tuple[int, ...], int]] = {}
        for due in self._due:
            counts = most.setdefault((due.watch, due.region), {})
            counts[due.candidates] = max(counts.get(due.candidates, 0), due.count)
        return {where: tuple(counts.items()) for where, counts in most.items()}

    def _what_is_done(self, state: WorldState, at: list[list[str | None]]) -> tuple[bool, ...]:
        """Tell which subgoals are done: their objects are there, at rest and let go."""
        settled: dict[str, bool] = {}
        done: list[bool] = []
        for due in self._due:
            there = 0
            names, places = self._watches[due.watch].subjects, at[due.watch]
            for s in due.candidates:
                if places[s] != due.region:
                    continue
                name = names[s]
                if name not in settled:
                    settled[name] = at_rest(state, name) and released(state, name)
                there += settled[name]
            done.append(there >= due.count and all(done[j] for j in due.after))
        return tuple(done)

    def _nothing_else(self, at: list[list[str | None]]) -> bool:
        """Tell whether nothing is at a target now that neither was asked for there nor began there."""
        if not self._exclusive:
            return True
        for w, places in enumerate(at):
            if self._watches[w].relation.name != self._placing:
                continue  # a drawer that was shut on the way is nothing too much
            there: dict[str, list[int]] = {}
            for s, place in enumerate(places):
                if place is not None:
                    there.setdefault(place, []).append(s)
            for place, subjects in there.items():
                allowed = self._allowed.get((w, place), ())
                for s in subjects:
                    if self._at_start[w][s] != place and not any(s in group for group, _ in allowed):
                        return False
                if any(sum(s in group for s in subjects) > count for group, count in allowed):
                    return False
        return True

    def _track_order(self, done: tuple[bool, ...], before: tuple[bool, ...]) -> None:
        for i, now in enumerate(done):
            if now and not before[i] and not self._ever_done[i]:
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


def _watches(goals: tuple[Subgoal, ...], info: SceneInfo) -> tuple[_Watch, ...]:
    """Return the targets that subgoals name, then the others of their kind: the wrong drawer is watched too."""
    targets = dict.fromkeys((g.relation, g.target) for g in goals)
    for name, target in tuple(targets):
        like = info.object(target)
        for o in info.objects:
            if o.role == like.role and relation(name).regions(o):
                targets.setdefault((name, o.name))
    watches = []
    for name, target in targets:
        kind = relation(name)
        subjects = tuple(o.name for o in info.objects if o.role in kind.roles and not o.fixed and o.name != target)
        watches.append(_Watch(kind, target, subjects, kind.regions(info.object(target))))
    return tuple(watches)


def interferes(state: WorldState) -> bool:
    """Tell whether the gripper touches an object, or closes away from home: forbidden where nothing is to be done."""
    if any(state.touched_by_gripper(o.name) for o in state.info.objects):
        return True
    return state.gripper_command > 0.0 and distance(state.ee_pose.position, state.info.home_position) > (
        THRESHOLDS.home_radius
    )
