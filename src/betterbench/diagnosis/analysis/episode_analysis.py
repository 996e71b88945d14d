"""Analysis of an episode: compares the object of each grasp attempt with the next step of the instruction."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, TypeVar

import numpy as np

from betterbench.diagnosis.analysis.approaches import Stay, chosen_by_staying, find_pushes, find_shoves, is_down
from betterbench.diagnosis.analysis.harm import DatedHarm
from betterbench.diagnosis.analysis.trace import Trace, Whereabout, place_middle
from betterbench.diagnosis.thresholds import BETWEEN, DOUBT, SQUEEZES, UNDONE_WITHIN
from betterbench.diagnosis.verdict import Attempt, Evidence
from betterbench.geometry import rotate
from betterbench.interface.state import WorldState
from betterbench.tasks import THRESHOLDS, Condition, Expected, Instruction, Subgoal, TrainingDistribution
from betterbench.tasks.judging.attempts import (
    GraspAttempt,
    find_closings_on_nothing,
    find_grasps,
    find_squeezes,
    find_weak_closings,
)
from betterbench.tasks.judging.restraint import off_limits
from betterbench.tasks.relations import relation
from betterbench.tasks.relations.closed import DRAWN_OUT, PUSHED_IN
from betterbench.tasks.thresholds import DISPLACED
from betterbench.tasks.words import place_words
from betterbench.wording import listed


class AttemptTarget(StrEnum):
    """Relation of the attempted object to the instruction at the time of the attempt."""

    ASKED = "asked"
    """The current step of the instruction refers to the object."""
    LATER = "later"
    """Only a later step of the instruction refers to the object, and the instruction requires another step first."""
    REPEATED = "repeated"
    """Only a completed step refers to the object, or to another object that this step has stacked on it."""
    OTHER = "other"
    """Another instruction of the task refers to the object, or the object is a placement target."""
    FOREIGN = "foreign"
    """No instruction of the task refers to the object."""
    EMPTY = "empty"
    """There is no object: the gripper closes at an empty slot."""


class Means(StrEnum):
    """Behavior that shows which object the policy wants, such as a grasp, a push, or staying over the object."""

    GRASP = "grasp"
    """The gripper closes."""
    PUSH = "push"
    """The empty gripper pushes the object."""
    STAY = "stay"
    """The open gripper stays over the object and does not grasp anything afterward."""
    TRY = "try"
    """The policy commands the gripper to close around the object, but the fingers hardly move."""


_MEANS_WORDS = {
    Means.PUSH: " (pushed)",
    Means.STAY: " (the open gripper stays over it)",
    Means.TRY: " (its fingers hardly move)",
}
_INSTRUCTION_WORDS = ("steps left: ", "the instruction asks for", "the instruction puts")
"""An evidence text that contains one of these phrases already states the instruction."""


@dataclass(frozen=True, slots=True)
class Step:
    """One attempt of the policy, compared with the instruction.

    This is a grasp attempt. A push, a weak grip, or staying over an object can also count as an attempt.

    Attributes:
        grasp: Rows, object and slot of the attempt in the trace.
        attempt: The attempt as reports show it.
        at: Index of the attempted or missed object, or None if there is no object.
        target: Relation of the object to the instruction.
        goal: Index of the subgoal that was current, or None if no subgoal was open.
        asked_slots: Slots of the objects that were requested at the time of the attempt.
        means: Behavior that shows the attempt.
        between: Index of a second object that may have been the target. It was about as near as the requested object
            when the empty gripper closed. None if there is no such object.
    """

    grasp: GraspAttempt
    attempt: Attempt
    at: int | None
    target: AttemptTarget
    goal: int | None
    asked_slots: tuple[str, ...]
    means: Means = Means.GRASP
    between: int | None = None

    @property
    def missed(self) -> bool:
        """Whether the gripper closed next to the object and missed it."""
        return self.means is Means.GRASP and self.grasp.object is None and self.at is not None


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeAnalysis:
    """Episode compared with its condition and with the training distribution of its task.

    Attributes:
        trace: Motion and subgoals of the episode.
        condition: Condition of the trial.
        trained: Training distribution of the task.
        meant: For each subgoal, the indices of the objects that can satisfy it.
        steps: All grasp attempts, in chronological order.
        harm: Harm to objects that were not requested, in chronological order.
        others: Approaches to an object in which the gripper does not close, in chronological order.
        on_nothing: Attempts that closed the gripper far from all objects or next to an empty slot, in chronological
            order.
        fists: Attempts that closed the empty gripper in order to push a drawer shut, in chronological order.
        state: Function that returns the world state at a row of the trace. If None, placements are judged only by the
            target regions in the record.
        found_once: Results cached by :func:`once_per_episode`.
    """

    trace: Trace
    condition: Condition
    trained: TrainingDistribution
    meant: tuple[tuple[int, ...], ...]
    steps: tuple[Step, ...]
    harm: tuple[DatedHarm, ...] = ()
    others: tuple[Step, ...] = ()
    on_nothing: tuple[GraspAttempt, ...] = ()
    fists: tuple[GraspAttempt, ...] = ()
    state: Callable[[int], WorldState] | None = None
    found_once: dict[object, Any] = field(init=False, repr=False, compare=False, default_factory=dict)

    @property
    def decisions(self) -> tuple[Step, ...]:
        """All attempts that show which object the policy wants, in chronological order.

        These are grasp attempts and pushes. Staying over an object at the end of the episode is an attempt as well.
        Attempts to open or shut a drawer on the way to a wrong first choice are left out.
        """
        apart = (*self.opened_first, *self.shut_first)
        return tuple(s for s in self._in_order if s not in apart)

    @property
    def opened_first(self) -> tuple[Step, ...]:
        """Attempts that open a drawer to reach a wrong first choice, and that are therefore part of this choice.

        If the first choice is correct, opening a wrong drawer before it is a separate mistake and is not included.
        """
        first = self.first_choice
        if first is None or first.target is AttemptTarget.ASKED:
            return ()
        return tuple(s for s in self._in_order if s.grasp.start < first.grasp.start and self._opens(s))

    @property
    def shut_first(self) -> tuple[Step, ...]:
        """Attempts that shut a drawer before another drawer is opened to reach a wrong first choice.

        An open drawer blocks the drawer below it. Shutting it is therefore part of the wrong choice, just like opening
        the drawer below.
        """
        opened = self.opened_first
        return tuple(
            s
            for s in self._in_order
            if self.pushes_in(s)
            and not self._may_be_choice(s)
            and any(o.at != s.at and o.grasp.start > s.grasp.start for o in opened)
        )

    @property
    def _in_order(self) -> tuple[Step, ...]:
        """All attempts, pushes, and intervals in which the gripper stays over an object, in chronological order."""
        return tuple(sorted((*self.steps, *self.others), key=lambda s: s.grasp.start))

    def _opens(self, step: Step) -> bool:
        """Return whether an attempt at a drawer does not push the drawer in."""
        return not self._may_be_choice(step) and not self.pushes_in(step)

    def pushes_in(self, step: Step) -> bool:
        """Return whether an attempt pushes a drawer farther in."""
        if not self.trace.is_drawer(step.at) or step.at is None:
            return False
        last = min(step.grasp.release, self.trace.rows - 1)
        return self.trace.opening(last, step.at) <= self.trace.opening(step.grasp.start, step.at) - PUSHED_IN

    def _may_be_choice(self, step: Step) -> bool:
        """Return whether an attempt can show which object the policy chose.

        This is the case if the attempted object is not a drawer, or if the instruction asks for the drawer itself. A
        drawer that is opened or shut to reach an object does not show which object was chosen.
        """
        if not self.trace.is_drawer(step.at):
            return True
        due = self.open_goals(0)[:1] if self.instruction.ordered else self.open_goals(0)
        return any(self.trace.is_drawer(i) for g in due for i in self.meant[g])

    @property
    def idle_from(self) -> int:
        """Row of the trace where the last grasp and its effects end, or 0 if the gripper never closed.

        Closing the gripper on nothing counts as a grasp here.
        """
        grasps = [*(step.grasp for step in self.steps), *self.on_nothing, *self.fists]
        if not grasps:
            return 0
        last = max(grasps, key=_start)
        pushes = last in self.fists
        return min(self.trace.rows - 1, last.release if last.object is not None or pushes else last.end + 1)

    @property
    def instruction(self) -> Instruction:
        """Instruction of the condition, with its text and subgoals."""
        return self.condition.instruction

    @property
    def goals(self) -> tuple[Subgoal, ...]:
        """Subgoals of the instruction, in order."""
        return self.condition.instruction.subgoals

    @property
    def asked_indices(self) -> frozenset[int]:
        """Indices of all objects that the instruction may refer to."""
        return frozenset(i for names in self.meant for i in names)

    @property
    def first_choice(self) -> Step | None:
        """First attempt that shows which object the policy chose, or None.

        The attempt may be a grasp, a push, or staying over an object. Moving a drawer to reach an object does not
        count.
        """
        return next(filter(self._may_be_choice, self._in_order), None)

    @property
    def first_attempt(self) -> Step | None:
        """First grasp attempt that shows which object the policy chose, or None. Reports show this attempt."""
        return next(filter(self._may_be_choice, self.steps), None)

    @property
    def off_limits(self) -> tuple[int, ...]:
        """Indices of the objects that the policy must not touch.

        There are none unless the policy is expected to stay still or to refuse an impossible instruction.
        """
        if self.condition.expected is Expected.STAY_STILL:
            return self.trace.items
        return off_limits(self.trace.info, self.asked_indices) if self.condition.expected.lacks_target else ()

    @property
    def shoves(self) -> tuple[Stay, ...]:
        """Intervals in which the empty gripper moves an object, in chronological order.

        This includes movements that are too short to count as a push.
        """
        return find_shoves(self.trace, tuple(step.grasp for step in self.steps))

    def harm_words(self) -> tuple[str, ...]:
        """Return one clause for each harm to an object that was not requested, in chronological order."""
        return tuple(dated.harm.words(self.trace.info) for dated in self.harm)

    def kind(self, i: int) -> str:
        """Return the kind of an object."""
        return self.trace.info.objects[i].kind

    def name(self, i: int) -> str:
        """Return the name of an object."""
        return self.trace.info.objects[i].name

    def open_goals(self, row: int) -> tuple[int, ...]:
        """Return the indices of the subgoals that are open at a row of the trace.

        Subgoals whose object fell off the table are left out.
        """
        return _open_goals(self.trace, self.goals, row)

    def fills(self, goal: int) -> tuple[int, ...]:
        """Return the subgoals that put objects into a drawer before the given subgoal closes this drawer."""
        return tuple(_before(self.trace, self.goals, goal))

    def wanted(self, row: int) -> tuple[int, ...]:
        """Return the indices of the objects that may correctly be attempted at a row of the trace.

        If the instruction leaves the order free, these are the objects of all open subgoals.
        """
        _, now = _due(self.trace, self.instruction, row)
        return tuple(sorted({i for g in now for i in _wanted(self.trace, g, row)}))

    def completed_after(self, goal: int | None, row: int) -> bool:
        """Return whether a subgoal is done at a row of the trace or later. If so, an earlier failure was corrected."""
        return goal is not None and bool(self.trace.done[row:, goal].any())

    def attempted_after(self, goal: int, row: int) -> bool:
        """Return whether the policy attempts an object of a subgoal after a row of the trace."""
        return any(s.grasp.start > row and s.at in self.meant[goal] for s in self.steps)

    def attempted_before(self, goal: int, row: int) -> bool:
        """Return whether the policy attempts an object of a subgoal before a row of the trace."""
        return any(s.grasp.start < row and s.at in self.meant[goal] for s in self.steps)

    def let_go(self, step: Step) -> tuple[int, int] | None:
        """Return the rows where the object of an attempt left the gripper and where it came to rest.

        Returns:
            The two rows of the trace, or None if the attempt grasped no object or the gripper still holds it at the
            end.
        """
        trace, grasp, i = self.trace, step.grasp, step.grasp.object
        if i is None:
            return None
        rows = slice(grasp.end, min(trace.rows, grasp.release + trace.steps(THRESHOLDS.stop_time)))
        gripped = (trace.held[rows] == i) | (trace.left[rows, i] & trace.right[rows, i])
        if not gripped.any():
            return None
        gone = grasp.end + int(np.flatnonzero(gripped)[-1]) + 1
        if gone >= trace.rows:
            return None
        rest = min(trace.rows - 1, gone + trace.steps(THRESHOLDS.settle_after_release))
        again = np.flatnonzero(trace.left[gone : rest + 1, i] & trace.right[gone : rest + 1, i])
        return gone, rest if again.size == 0 else max(gone, gone + int(again[0]) - 1)

    def slipped(self, step: Step) -> bool:
        """Return whether the object of an attempt fell out of a gripper that was commanded to stay closed."""
        rows, i = self.let_go(step), step.grasp.object
        if rows is None or i is None:
            return False
        gone, rest = rows
        fall = float(self.trace.positions[gone, i, 2] - self.trace.positions[rest, i, 2])
        return gone < step.grasp.release and fall > THRESHOLDS.fall_height

    def telling_place(self, row: int, i: int) -> Whereabout | None:
        """Return the target region that contains an object if the policy must have brought it there, otherwise None.

        A wide region, such as one side of another object, does not count, because the object may have been there from
        the start.
        """
        place = self.trace.placed(row, i)
        if place is None or self.state is None or not relation(place.relation).wide:
            return place
        return None

    def put_down(self, step: Step) -> tuple[int, int, Whereabout] | None:
        """Return where and when an object was placed contrary to the instruction.

        An object that was deliberately released at a region counts as placed there, even if it fell over.

        Returns:
            The rows where the object was released and where it came to rest, and the region. None if the object was not
            placed in a region that contradicts the instruction.
        """
        i, rows = step.grasp.object, self.let_go(step)
        if rows is None or i is None or not step.grasp.secured:
            return None
        gone, rest = rows
        if self.trace.serves[rest, :, i].any() or self.slipped(step):
            return None
        place = self.telling_place(rest, i) or self._loosely_placed(step, i, rows)
        return None if place is None else (gone, rest, place)

    def _loosely_placed(self, step: Step, i: int, rows: tuple[int, int]) -> Whereabout | None:
        """Return the wrong region where an object was set down, or None. The object may have fallen over.

        An object counts as set down if the gripper released it there. It also counts if it stood there before it
        slipped out of the closed gripper or was dragged away. If the object is in a requested region, the result is
        None. It is also None if the object is about as close to the center of a requested region as to the center of
        the wrong region, since the policy then aimed at the requested region.
        """
        gone, rest = rows
        fall = float(self.trace.positions[gone, i, 2] - self.trace.positions[rest, i, 2])
        if self.state is None:
            return None
        name, objects = self.name(i), self.trace.info.objects
        found: Whereabout | None = None
        at = rest
        released = (gone, rest) if gone >= step.grasp.release else ()
        for row in (*self._set_down_before(step, i, gone), *released):
            state = self.state(row)
            for kind, t in dict.fromkeys((w.relation, w.target) for w in self.trace.whereabouts if w.object == i):
                wanted = relation(kind)
                region = None if wanted.counted else wanted.brought(state, name, objects[t].name)
                if region is None:
                    continue
                if self._is_asked_at(i, kind, t, region):
                    return None
                if found is None and (row < gone or wanted.falls or fall <= THRESHOLDS.fall_height):
                    found = Whereabout(i, kind, t, region, np.zeros(self.trace.rows, dtype=np.bool_))
                    at = row if row < gone else rest
        if found is None:
            return None
        away = self._distance_to(i, at, found.relation, found.target, found.region)
        asked = (
            self._distance_to(i, at, goal.relation, t, goal.region)
            for goal, t, names in zip(self.goals, self.trace.targets, self.meant, strict=True)
            if i in names and relation(goal.relation).carried
        )
        return None if any(gap <= away + DOUBT for gap in asked) else found

    def _set_down_before(self, step: Step, i: int, gone: int) -> tuple[int, ...]:
        """Return the first row where a carried object stood on a support, or an empty tuple.

        The row is returned as a tuple with one element. For example, a jar that jams at the edge of its hole counts as
        standing there, even if the closed gripper then drags it away.
        """
        trace, time = self.trace, self.trace.steps(THRESHOLDS.stop_time)
        carried = np.flatnonzero(trace.held[step.grasp.end : gone] == i)
        if carried.size == 0:
            return ()
        for row in range(step.grasp.end + int(carried[0]), gone - time):
            moved = float(np.linalg.norm(trace.positions[row + time, i] - trace.positions[row, i]))
            if moved <= THRESHOLDS.rest_travel and (trace.held[row : row + time] != i).all():
                return (row,)
        return ()

    def _is_asked_at(self, i: int, kind: str, target: int, region: str) -> bool:
        """Return whether a subgoal requires an object to be in a region."""
        return any(
            i in names and (goal.relation, t, goal.region) == (kind, target, region)
            for goal, t, names in zip(self.goals, self.trace.targets, self.meant, strict=True)
        )

    def _distance_to(self, i: int, row: int, kind: str, target: int, region: str) -> float:
        """Return the horizontal distance from an object to the center of a target region at a row of the trace [m]."""
        trace = self.trace
        middle = place_middle(trace.info.objects[target], kind, region)
        w, x, y, z = trace.quaternions[row, target].tolist()
        place = trace.positions[row, target] + np.array(rotate((w, x, y, z), middle))
        return math.dist(trace.positions[row, i, :2], place[:2])

    def wrong_place(self, step: Step) -> tuple[int, int, Whereabout] | None:
        """Return the wrong region where a requested object was placed, and when this happened.

        Returns:
            The rows where the object was released and where it came to rest, and the region. None if the object was
            placed in the correct region at any time, or was placed outside all target regions.
        """
        if step.target is not AttemptTarget.ASKED or self.completed_after(step.goal, step.grasp.end):
            return None
        return self.put_down(step)

    def last_try(self, step: Step) -> Step:
        """Return the decisive attempt among repeated attempts at the same object.

        This is the first attempt that lifted the object. If no attempt lifted it, this is the last attempt.
        """
        for later in self.steps:
            if later.grasp.start <= step.grasp.start:
                continue
            if step.grasp.secured or later.at != step.at:
                break
            step = later
        return step

    def taken_for(self, step: Step) -> int | None:
        """Return another object's subgoal if the attempt brought its object to the target of that subgoal, or None."""
        found, i = self.put_down(step), step.grasp.object
        if found is None or i not in self.asked_indices:
            return None
        place = found[2]
        for g, goal in enumerate(self.goals):
            same = (goal.relation, self.trace.targets[g], goal.region) == (place.relation, place.target, place.region)
            if same and i not in self.meant[g]:
                return g
        return None

    def memorized(self, i: int, place: Whereabout) -> bool:
        """Return whether objects of this kind are placed in this region during training."""
        where = (self.kind(place.target), place.relation, place.region)
        return where in self.trained.kind_targets.get(self.kind(i), ())

    def slots_in_training(self, i: int) -> tuple[str, ...]:
        """Return the slots that contain this kind of object in training, except the slot where this object starts."""
        info, start = self.trace.info, self.trace.positions[0, i, :2]
        trained = (slot for slot, there in sorted(self.trained.standing_kinds.items()) if self.kind(i) in there)
        return tuple(s for s in trained if math.dist(start, info.slot(s).position[:2]) > DISPLACED)

    def evidence(
        self,
        rule: str,
        text: str,
        *,
        rows: tuple[int, int],
        objects: tuple[int, ...] = (),
        shared: tuple[str, ...] = (),
        candidates: tuple[str, ...] = (),
    ) -> Evidence:
        """Return evidence from an interval of the trace.

        The time, the location of the first object and the next step of the instruction are appended to the text, unless
        the text already states them.
        """
        time, last = self.trace.time, self.trace.rows - 1
        first, end = (min(max(r, 0), last) for r in rows)
        facts = [f"Time: {float(time[first]):.1f} s"]
        place = self._place(first, objects[0]) if objects else ""
        if place and place not in text:
            facts.append(f"location: {place}")
        if not any(words in text for words in _INSTRUCTION_WORDS):
            facts.append(f"next step: {self.asked_at(first)}")
        said = f"{text.removesuffix('.')}. {'; '.join(facts)}."
        return Evidence(
            rule, said, float(time[first]), float(time[end]), tuple(self.name(i) for i in objects), shared, candidates
        )

    def asked_at(self, row: int) -> str:
        """Describe the steps that are due at a row of the trace, with the words and the kinds of their objects."""
        due = self.open_words(row)
        due = due[:1] if self.instruction.ordered else due
        return listed(due) or "none"

    def open_words(self, row: int) -> tuple[str, ...]:
        """Return the distinct words of the instruction for the subgoals that are open at a row of the trace."""
        return tuple(dict.fromkeys(map(self.asked_words, self.open_goals(row))))

    def asked_words(self, goal: int) -> str:
        """Return the instruction's word for an object. The object's kind is added if it differs: "'red' (red mug)"."""
        word = self.goals[goal].word
        kinds = dict.fromkeys(self.kind(i) for i in self.meant[goal])
        named = " or ".join(kind for kind in kinds if kind != word)
        return repr(word) + (f" ({named})" if named else "" if kinds else " (absent)")

    def _place(self, row: int, i: int) -> str:
        """Describe where an object is, by its target region, its slot or its coordinates.

        For a drawer, return an empty string.
        """
        trace = self.trace
        if trace.is_drawer(i):
            return ""
        place = trace.placed(row, i)
        if place is not None:
            return f"the {self.kind(place.target)}"
        slot = trace.slot_of(row, i, THRESHOLDS.slot_reach)
        if slot is not None:
            return f"slot {slot!r}"
        x, y, z = trace.positions[row, i].tolist()
        return f"x {100 * x:.0f}, y {100 * y:.0f}, z {100 * z:.0f} cm"

    def at_step(self, rule: str, text: str, step: Step, **details: tuple[str, ...]) -> Evidence:
        """Convert an attempt to evidence for a label."""
        objects = () if step.at is None else (step.at,)
        return self.evidence(rule, text, rows=(step.grasp.start, step.grasp.end), objects=objects, **details)

    def describe(self, step: Step, *, slots: bool = True) -> str:
        """Describe the object of an attempt. The description includes the object's slot unless ``slots`` is False."""
        slot = f" at slot {step.grasp.slot!r}" if slots and step.grasp.slot is not None else ""
        if step.at is None:
            return f"nothing (an air grasp{slot})"
        how = _MEANS_WORDS.get(step.means, "")
        return f"the {self.kind(step.at)}{slot}" + (" (missed)" if step.missed else how)

    def where(self, target: int, region: str) -> str:
        """Describe a target region, for example "the laptop (left)"."""
        return place_words(self.kind(target), region)

    def asked_where(self, step: Step) -> str:
        """Describe the target region that the object of an attempt should be brought to."""
        if step.goal is None:
            return "elsewhere"
        return f"at {self.where(self.trace.targets[step.goal], self.goals[step.goal].region)}"

    def shared_looks(self, at: int, targets: Iterable[int]) -> tuple[str, ...]:
        """Return the visual properties ("color", "shape") that an object shares with one or more others."""
        found, others = self.trace.info.objects[at], [self.trace.info.objects[i] for i in targets]
        shared = []
        if found.color and any(found.color == other.color for other in others):
            shared.append("color")
        if found.shape and any(found.shape == other.shape for other in others):
            shared.append("shape")
        return tuple(shared)

    def asked_for(self, step: Step) -> str:
        """Describe the objects that were requested at the time of an attempt."""
        if step.goal is None:
            return "nothing was left to do"
        return f"the instruction asks for {self.asked_words(step.goal)}"

    def intended(self) -> tuple[int, ...]:
        """Return the indices of the objects that would be correct to attempt first.

        If the policy attempted a correct object first, this object is listed first. The others are ordered by subgoal
        and slot, so that neither their names nor their order in the scene matter.
        """
        if self.condition.expected is Expected.STAY_STILL:
            return ()
        trace, goals = self.trace, self.open_goals(0)
        first = self.first_attempt
        right = None if first is None or first.target is not AttemptTarget.ASKED else first.at
        chosen = [] if right is None else [right]
        for g in goals[:1] if self.instruction.ordered else goals:
            wanted = _wanted(trace, g, 0) & set(self.meant[g])
            chosen += sorted(wanted, key=lambda i: (trace.info.objects[i].slot or "", *trace.positions[0, i].tolist()))
        return tuple(dict.fromkeys(chosen))

    def intention_correct(self) -> bool | None:
        """Return whether the first attempt was correct. If no attempt is correct, return whether the policy made none.

        An attempt at a wrong drawer makes the intention wrong, even if a correct object is grasped afterward.

        Returns:
            True or False. None if this cannot be decided, because the gripper first closed between two objects, or
            because it only closed far from all objects.
        """
        expected = self.condition.expected
        if expected is Expected.STAY_STILL:
            return not self.steps
        if expected.lacks_target:
            return not any(s.target in (AttemptTarget.OTHER, AttemptTarget.FOREIGN) for s in self.steps)
        telling = (s for s in self.steps if s.target is not AttemptTarget.ASKED or self._may_be_choice(s))
        first = next(telling, self.steps[0] if self.steps else None)
        if first is None:
            return None if self.on_nothing else False
        return None if first.between is not None else first.target is AttemptTarget.ASKED

    def progress(self) -> float:
        """Return the fraction of the requested subgoals that were completed in a valid order.

        If the policy is expected to refuse, subgoals that cannot be achieved are left out. If it is expected to stay
        still, the subgoals that are done at the start must still be done at the end.
        """
        done = self.trace.done
        if self.condition.expected is Expected.STAY_STILL:
            return float(done[-1].mean())
        first = [int(np.argmax(column)) if column.any() else None for column in done.T]
        refuse = self.condition.expected.lacks_target
        asked = [g for g in range(len(first)) if self.meant[g] or not refuse]
        if refuse and not asked:
            return 1.0
        valid = 0
        for g in asked:
            row, earlier = first[g], [first[j] for j in asked if j < g]
            in_order = row is not None and all(e is not None and e <= row for e in earlier)
            valid += in_order or (row is not None and not self.instruction.ordered)
        return valid / len(asked)


_Found = TypeVar("_Found")


def once_per_episode(find: Callable[[EpisodeAnalysis], _Found]) -> Callable[[EpisodeAnalysis], _Found]:
    """Cache the result of a function for each episode, so that it is computed only once.

    This is used for functions that several failure modes call. For example, four failure modes look for a halt. Over 37
    recorded trials of three policies, the saving was too small to measure (total CPU time 0.35 s, 2026-11-28).
    """

    @functools.wraps(find)
    def found(episode: EpisodeAnalysis) -> _Found:
        if find not in episode.found_once:
            episode.found_once[find] = find(episode)
        kept: _Found = episode.found_once[find]
        return kept

    return found


def analyze_episode(
    trace: Trace,
    condition: Condition,
    trained: TrainingDistribution,
    *,
    harm: tuple[DatedHarm, ...] = (),
    state: Callable[[int], WorldState] | None = None,
) -> EpisodeAnalysis:
    """Compare the attempts in an episode (grasps, pushes, and staying over an object) with the instruction.

    Objects are identified by kind and slot, so their names do not matter.

    Args:
        trace: Motion and subgoals of the episode.
        condition: Condition of the trial.
        trained: Training distribution of the task.
        harm: Harm to objects that were not requested.
        state: Function that returns the world state at a row of the trace. Without it, placements are judged only by
            the predicates in the record.
    """
    info = trace.info
    asked_kinds = {info.objects[i].kind for names in trace.meant for i in names}
    known = frozenset(trained.kind_slots) | asked_kinds
    closings, far = find_grasps(trace), find_closings_on_nothing(trace)
    fists = tuple(sorted((g for g in (*closings, *far) if _fist(trace, condition.instruction, g)), key=_start))
    grasps = tuple(g for g in closings if g not in fists)
    steps = tuple(_step(trace, condition.instruction, known, grasp) for grasp in grasps)
    beside: tuple[GraspAttempt, ...] = ()
    if condition.expected is Expected.SUCCEED:
        beside = tuple(s.grasp for s in steps if _beside_slot(trace, condition.instruction, s))
        tries = _tries(trace, condition.instruction, known, steps)
        steps = tuple(sorted((*steps, *tries), key=lambda s: s.grasp.start))
    on_nothing = tuple(sorted((*beside, *(g for g in far if g not in fists)), key=_start))
    steps = tuple(s for s in steps if s.grasp not in beside)
    episode = EpisodeAnalysis(
        trace, condition, trained, trace.meant, steps, harm, on_nothing=on_nothing, fists=fists, state=state
    )
    if trace.done.shape[1] and trace.done[-1].all():
        return episode
    without = [(Means.PUSH, push) for push in find_pushes(trace, grasps)]
    if condition.expected is Expected.SUCCEED:
        stay = chosen_by_staying(trace, episode.idle_from, episode.wanted(episode.idle_from))
        without += [] if stay is None else [(Means.STAY, stay)]
    others = (_shown(trace, condition.instruction, known, stay, means) for means, stay in without)
    return replace(episode, others=tuple(o for o in others if o.means is Means.STAY or not _went_on(episode, o)))


def _start(grasp: GraspAttempt) -> int:
    return grasp.start


def _beside_slot(trace: Trace, instruction: Instruction, step: Step) -> bool:
    """Return whether a gripper that closed at an empty slot may have missed an object elsewhere.

    The gripper may have missed an object if that object is about as near as the point where demonstrations close the
    gripper in this slot, or at least as near in the view from above. The view from above is considered because a
    gripper that closes above the rim of a plate has missed the plate, at any height. If the slot contains an
    object, or if training never picks from this slot, only the distance to the center of the slot is considered.
    """
    slot = step.grasp.slot
    if step.target is not AttemptTarget.EMPTY or slot is None:
        return False
    tool, picked = trace.tool[step.grasp.end], trace.picked_slot(slot)
    if picked is None or trace.emptied_slot(step.grasp.start, tool) != slot:
        return math.dist(tool[:2], trace.info.slot(slot).position[:2]) > THRESHOLDS.same_place
    beyond = picked.beyond(tool.tolist())
    row, needed = step.grasp.start, _needed(trace, instruction, step.grasp)
    gaps, sideways = trace.box_distances(row, tool), trace.sideways_distances(row, tool)
    return any(gaps[i] <= beyond + DOUBT or sideways[i] <= beyond for i in needed)


def _needed(trace: Trace, instruction: Instruction, grasp: GraspAttempt) -> set[int]:
    """Return the objects that would be correct to attempt.

    These are the objects requested now, and the drawers that block them.
    """
    _, now = _due(trace, instruction, grasp.start)
    return {i for g in now for i in _wanted(trace, g, grasp.start) | _drawn(trace, g, grasp)}


def _tries(trace: Trace, instruction: Instruction, known: frozenset[str], steps: tuple[Step, ...]) -> list[Step]:
    """Return the weak grips on requested objects.

    A weak grip shows which object the policy wants, but is not a grasp attempt. In a weak grip, the fingers hardly move
    although the policy commands them to close for a long time, or they repeatedly close partly around the object and
    open again. Objects that the policy tried to grasp are left out.
    """
    seen = {step.at for step in steps}
    long: list[Step] = []
    brief: list[Step] = []
    for found, closings in ((long, find_weak_closings(trace)), (brief, find_squeezes(trace))):
        for closing in closings:
            tool = trace.tool[closing.end]
            reach, gaps = trace.within_reach(closing.start, tool), trace.box_distances(closing.start, tool)
            near = [i for i in _needed(trace, instruction, closing) if reach[i] and i not in seen]
            if not near:
                continue
            i = min(near, key=lambda i: (float(gaps[i]), i))
            if found is brief and not is_down(trace, i)[closing.end]:
                continue  # the fingers were set to the object's width before the descent
            grasp = replace(closing, aim=i, slot=trace.slot_of(closing.start, i, THRESHOLDS.slot_reach))
            found.append(replace(_step(trace, instruction, known, grasp, at=i), means=Means.TRY))
    told = [(step.grasp.start, step.grasp.release) for step in long]
    apart = [b for b in brief if not any(first <= b.grasp.release and b.grasp.start <= last for first, last in told)]
    return [*long, *(apart if len(apart) >= SQUEEZES else [])]


def _fist(trace: Trace, instruction: Instruction, grasp: GraspAttempt) -> bool:
    """Return whether the empty gripper closed in order to push a drawer shut."""
    if grasp.object is not None:
        return False
    _, now = _due(trace, instruction, grasp.start)
    return bool(now) and all(not relation(instruction.subgoals[g].relation).carried for g in now)


def _shown(trace: Trace, instruction: Instruction, known: frozenset[str], stay: Stay, means: Means) -> Step:
    """Convert a push or a stay to an attempt that is compared with the instruction.

    A stay is an interval in which the gripper stays over an object.
    """
    slot = trace.slot_of(stay.start, stay.object, THRESHOLDS.slot_reach)
    grasp = GraspAttempt(stay.start, stay.end, trace.rows, None, stay.object, slot, secured=False)
    return replace(_step(trace, instruction, known, grasp, at=stay.object), means=means)


def _went_on(episode: EpisodeAnalysis, push: Step) -> bool:
    """Return whether the policy tried to grasp another object after it pushed one.

    If so, the pushed object was only in the gripper's way.
    """
    return any(s.grasp.start >= push.grasp.start and s.at != push.at for s in episode.steps)


def _due(trace: Trace, instruction: Instruction, row: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the subgoals that are open at a row of the trace, and those of them that may be done next."""
    due = _open_goals(trace, instruction.subgoals, row)
    return due, due[:1] if instruction.ordered else due


def _open_goals(trace: Trace, goals: tuple[Subgoal, ...], row: int) -> tuple[int, ...]:
    """Return the indices of the open subgoals at a row of the trace.

    Subgoals with objects that fell off the table are left out. A subgoal that closes a drawer becomes open as soon as
    the object that belongs in the drawer is inside.
    """
    reached = [_reached(trace, goals, g, row) for g in range(len(goals))]
    return tuple(
        g
        for g in range(len(goals))
        if not reached[g]
        and all(reached[j] for j in _before(trace, goals, g))
        and any(not trace.serves[row, g, i] and trace.on_table(row, i) for i in trace.meant[g])
    )


def _reached(trace: Trace, goals: tuple[Subgoal, ...], g: int, row: int) -> bool:
    if int(trace.serves[row, g, list(trace.meant[g])].sum()) < goals[g].count:
        return False
    return all(_reached(trace, goals, j, row) for j in _before(trace, goals, g))


def _before(trace: Trace, goals: tuple[Subgoal, ...], g: int) -> list[int]:
    """Return the earlier subgoals that have the given subgoal's object as their target.

    For example, the subgoal that fills a drawer comes before the subgoal that closes it.
    """
    if relation(goals[g].relation).carried:
        return []
    return [j for j in range(g) if trace.targets[j] in trace.meant[g]]


def _wanted(trace: Trace, g: int, row: int) -> set[int]:
    """Return the indices of the objects that would be correct to attempt for a subgoal.

    These are the objects of the subgoal itself, and the drawers that must be moved first.
    """
    busy = trace.serves[row].any(axis=0)
    wanted = {i for i in trace.meant[g] if not trace.serves[row, g, i] and not busy[i]}
    drawers = {i for i, _, _ in trace.drawers}
    for i in drawers & {trace.targets[g]}:
        if trace.opening(row, i) < DRAWN_OUT:
            wanted.add(i)
        height = trace.positions[row, i, 2]
        above = {j for j in drawers - {i} if trace.positions[row, j, 2] > height}
        wanted |= {j for j in above if trace.opening(row, j) > PUSHED_IN}
    return wanted


def _drawn(trace: Trace, g: int, grasp: GraspAttempt) -> set[int]:
    """Return the drawer that a subgoal puts an object into, if the attempt grasped this drawer without pushing it in.

    Returns:
        Set with the index of the drawer, or an empty set if the attempt did something else.
    """
    i, last = grasp.object, min(grasp.release, trace.rows - 1)
    if i is None or i != trace.targets[g] or not trace.is_drawer(i):
        return set()
    return {i} if trace.opening(last, i) > trace.opening(grasp.start, i) - PUSHED_IN else set()


def _missed(trace: Trace, grasp: GraspAttempt, needed: set[int]) -> int | None:
    """Return the object that the gripper missed when it closed on nothing. Requested objects take precedence."""
    if grasp.aim is None or grasp.aim in needed:
        return grasp.aim
    gaps = trace.box_distances(grasp.start, trace.tool[grasp.end])
    near = [i for i in sorted(needed) if gaps[i] <= gaps[grasp.aim] + DOUBT]
    return min(near, key=lambda i: float(gaps[i]), default=grasp.aim)


def _step(
    trace: Trace, instruction: Instruction, known: frozenset[str], grasp: GraspAttempt, *, at: int | None = None
) -> Step:
    """Compare an attempt with the current steps of the instruction.

    Args:
        trace: Motion and subgoals of the episode.
        instruction: Instruction of the trial.
        known: Kinds of objects that occur in the task's training or in the instruction.
        grasp: Rows, object and slot of the attempt.
        at: Index of the attempted object if the attempt is not a grasp, otherwise None.
    """
    step = _compared(trace, instruction, known, grasp, at=at, chosen=grasp.start)
    if step.target is not AttemptTarget.LATER:
        return step
    before = _before_undone(trace, instruction, grasp.start)
    return step if before is None else _compared(trace, instruction, known, grasp, at=at, chosen=before)


def _before_undone(trace: Trace, instruction: Instruction, row: int) -> int | None:
    """Return the last row, shortly before the given row, where all steps that are due now were still done.

    Such a row exists only if a finished step was undone. Return None if there is no such row.
    """
    _, now = _due(trace, instruction, row)
    first = max(0, row - trace.steps(UNDONE_WITHIN))
    done = np.flatnonzero(trace.done[first:row, list(now)].all(axis=1)) if now else np.array([], int)
    return first + int(done[-1]) if done.size else None


def _compared(
    trace: Trace, instruction: Instruction, known: frozenset[str], grasp: GraspAttempt, *, at: int | None, chosen: int
) -> Step:
    """Compare an attempt with the steps that were due at row ``chosen``, when the policy chose its target."""
    row = grasp.start
    due, now = _due(trace, instruction, chosen)
    wanted = {g: _wanted(trace, g, chosen) | _drawn(trace, g, grasp) for g in due}
    needed = {i for g in now for i in wanted[g]}
    astride = _astride(trace, grasp, needed) if at is None else None
    if astride is not None:
        at = astride[0]
    if at is None:
        at = grasp.object if grasp.object is not None else _missed(trace, grasp, needed)
    open_now = {i for g in due for i in wanted[g]}
    target = _target_of(trace, at, needed=needed, due=open_now, known=known)
    if target is AttemptTarget.OTHER and finished_on(trace, instruction, chosen, at):
        target = AttemptTarget.REPEATED
    between = _between(trace, grasp, at, needed) if target is AttemptTarget.ASKED else None
    if astride is not None:
        between, grasp = astride[1], replace(grasp, object=None)
    goal = next((g for g in now if at in wanted[g]), due[0] if due else None)
    slots = sorted(
        {slot for i in needed if (slot := trace.slot_near(trace.positions[row, i], THRESHOLDS.slot_reach)) is not None}
    )
    name = None if grasp.object is None else trace.info.objects[grasp.object].name
    result = "null" if grasp.object is None else "target" if target is AttemptTarget.ASKED else "distractor"
    slot = grasp.slot if between is None else None
    attempt = Attempt(float(trace.time[row]), float(trace.time[grasp.end]), name, slot, result, grasp.secured)
    moved = sorted(i for i in needed if trace.info.objects[i].slot == grasp.slot)
    if at is None and grasp.slot is not None and moved:  # the requested object has been moved out of the slot
        at, target = moved[0], AttemptTarget.ASKED
        goal = next(g for g in now if at in wanted[g])
    return Step(grasp, attempt, at, target, goal, tuple(slots), between=between)


def finished_on(trace: Trace, instruction: Instruction, row: int, at: int | None) -> tuple[int, ...]:
    """Return the objects that a finished step has stacked on the given object.

    A container does not form a stack with its contents, and objects next to each other on the table do not form a
    stack.
    """
    return tuple(
        i
        for g, goal in enumerate(instruction.subgoals)
        if at is not None and trace.targets[g] == at and at in trace.items and trace.done[row, g]
        if relation(goal.relation).surface is not None and not relation(goal.relation).falls
        for i in trace.meant[g]
        if trace.serves[row, g, i]
    )


def _astride(trace: Trace, grasp: GraspAttempt, needed: set[int]) -> tuple[int, int] | None:
    """Return a requested object and another object if one finger came down on each of the two, otherwise None.

    An object that was lifted, or was between the two fingers, was the only target. The result is then None.
    """
    i = grasp.object
    if i is None or grasp.secured or trace.is_drawer(i):
        return None
    rows = slice(
        max(0, grasp.start - trace.steps(THRESHOLDS.attempt_window)),
        grasp.end + trace.steps(THRESHOLDS.attempt_window),
    )
    left, right = trace.left[rows], trace.right[rows]
    if (left[:, i] & right[:, i]).any():
        return None
    lefts, rights = (set(np.flatnonzero(np.any(side, axis=0)).tolist()) for side in (left, right))
    items = {k for k in trace.items if not trace.is_drawer(k)}
    for one, other in ((lefts, rights), (rights, lefts)):
        asked, unasked = sorted(one & needed & items), sorted((other & items) - needed)
        if asked and unasked and i in (*asked, *unasked):
            return asked[0], unasked[0]
    return None


def _between(trace: Trace, grasp: GraspAttempt, at: int | None, needed: set[int]) -> int | None:
    """Return another object that was about as near as the requested object when the empty gripper closed, or None."""
    if grasp.object is not None or at is None:
        return None
    row = grasp.start
    gaps = trace.box_distances(row, trace.tool[grasp.end])
    others = (i for i in trace.items if i not in needed and not trace.is_drawer(i))
    near = [
        (float(gaps[i]), i)
        for i in others
        if gaps[i] <= gaps[at] + BETWEEN and trace.on_table(row, i) and not trace.there[row, i]
    ]
    return min(near)[1] if near else None


def _target_of(
    trace: Trace, at: int | None, *, needed: set[int], due: set[int], known: frozenset[str]
) -> AttemptTarget:
    if at is None:
        return AttemptTarget.EMPTY
    if at in needed:
        return AttemptTarget.ASKED
    if at in due:
        return AttemptTarget.LATER
    if any(at in names for names in trace.meant):
        return AttemptTarget.REPEATED
    found = trace.info.objects[at]
    other = found.kind in known or found.role in ("container", "fixture") or at in trace.targets
    return AttemptTarget.OTHER if other else AttemptTarget.FOREIGN
