"""What a variation can bring out: it follows from its test condition and from what training taught.

Each failure mode says, by a function of an :class:`Exposure`, whether the variation puts a policy with that fault to
the test. What this denies, a variation does not claim.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from betterbench.interventions import resolve_condition
from betterbench.tasks import (
    Condition,
    Expected,
    Label,
    Subgoal,
    Task,
    TrainingDistribution,
    get_task,
    training_distribution_of,
)


@dataclass(frozen=True, slots=True)
class Exposure:
    """A test condition beside its twin's condition and the regularities of training.

    Attributes:
        task: The task.
        base: Training condition that the variation is derived from.
        test: Test condition.
        trained: Regularities of the training regime.
    """

    task: Task
    base: Condition
    test: Condition
    trained: TrainingDistribution

    @classmethod
    def of(cls, task_id: str, variation: str) -> Exposure:
        """Return the exposure of a variation.

        Raises:
            UnknownNameError: If there is no such task or variation.
        """
        task = get_task(task_id)
        found = resolve_condition(task_id, variation)
        return cls(task, task.train(found.base), found.condition, training_distribution_of(task))

    @property
    def goals(self) -> tuple[Subgoal, ...]:
        """All subgoals of the test condition."""
        return self.test.instruction.subgoals

    def slots(self, goal: Subgoal) -> set[str]:
        """Return the slots in which what a subgoal means stands at the start."""
        return {self.test.layout[n] for n in self.test.resolve(goal.reference) if n in self.test.layout}

    @property
    def open_goals(self) -> tuple[Subgoal, ...]:
        """Subgoals for which something is left to be picked up, in order."""
        return tuple(goal for goal in self.goals if self.slots(goal))

    @property
    def due(self) -> tuple[Subgoal, ...]:
        """Subgoals that may rightly be worked on first."""
        return self.open_goals[:1] if self.test.instruction.ordered else self.open_goals

    @property
    def right_slots(self) -> set[str]:
        """Slots of everything that may rightly be picked first."""
        return {slot for goal in self.due for slot in self.slots(goal)}

    def movable_in(self, slot: str) -> str | None:
        """Return the kind of the movable object that stands in a slot at the start, or None."""
        name = self.test.occupant(slot)
        if name is None or self.test.object(name).role not in ("item", "distractor"):
            return None
        return self.test.object(name).kind

    def known(self, kind: str) -> bool:
        """Tell whether some instruction of the task means a kind of object."""
        asked = {self.test.object(n).kind for g in self.goals for n in self.test.resolve(g.reference)}
        return kind in asked or kind in self.trained.kind_slots

    def kinds(self, goal: Subgoal) -> set[str]:
        """Return the kinds of object that a subgoal means."""
        return {self.test.object(n).kind for n in self.test.resolve(goal.reference)}

    def items(self, condition: Condition) -> int:
        """Return the number of movable objects on the table at the start of a condition."""
        return sum(o.role in ("item", "distractor") and o.name in condition.layout for o in condition.objects)

    @property
    def longest_trained(self) -> int:
        """Largest number of subgoals of a training condition."""
        return max(len(c.instruction.subgoals) for c in self.task.training)


def word_leads_elsewhere(x: Exposure) -> bool:
    """A word of the instruction was picked in a slot that now holds another object that an instruction may mean."""
    for goal in x.open_goals:
        for slot in set(x.trained.word_slots.get(goal.word, ())) - x.slots(goal):
            kind = x.movable_in(slot)
            if kind is not None and x.known(kind):
                return True
    return False


def first_place_is_wrong(x: Exposure) -> bool:
    """The slot of the twin's first pick, or the one picked for most words, holds nothing that is to be picked now.

    What no instruction means is left out: an attempt at it shows another fault.
    """
    first = x.base.instruction.subgoals[0]
    slots = {x.base.layout[n] for n in x.base.resolve(first.reference) if n in x.base.layout}
    counts = Counter(slot for trained in x.trained.word_slots.values() for slot in trained)
    slots.add(min(counts, key=lambda slot: (-counts[slot], slot)))
    for slot in slots - x.right_slots:
        kind = x.movable_in(slot)
        if kind is None or x.known(kind):
            return True
    return False


def habit_is_wrong(x: Exposure) -> bool:
    """The first step, the target or the slot that training made frequent is not what is asked for."""
    ranked = x.trained.first_kinds
    frequent = ranked[0][0] if ranked and (len(ranked) == 1 or ranked[0][1] > ranked[1][1]) else None
    due = {kind for goal in x.due for kind in x.kinds(goal)}
    if frequent is not None and frequent not in due:
        return True
    here = {o.kind for o in x.test.objects}
    for goal in x.open_goals:
        asked = (x.test.object(goal.target).kind, goal.relation, goal.region)
        for kind in x.kinds(goal):
            trained = x.trained.kind_targets.get(kind, ())
            if trained and asked not in trained and any(target in here for target, _, _ in trained):
                return True
    memorized = {slot for goal in x.goals for slot in x.trained.word_slots.get(goal.word, ())}
    return any(x.base.occupant(slot) is not None and x.test.occupant(slot) is None for slot in memorized)


def progress_is_misread(x: Exposure) -> bool:
    """A step is done or repeated, fewer things are there than in the twin, or more steps are asked for than ever."""
    done = len(x.open_goals) < len(x.goals) and bool(x.test.preplaced)
    repeated = any(goal.count > 1 for goal in x.goals)
    fewer = x.items(x.test) < x.items(x.base) and not done
    return done or repeated or fewer or len(x.goals) > x.longest_trained


def look_alike_is_there(x: Exposure) -> bool:
    """Something that no instruction means stands in a slot that training picked from, or has the right color."""
    picked = {slot for slots in x.trained.kind_slots.values() for slot in slots}
    colors = {x.test.object(n).color for g in x.goals for n in x.test.resolve(g.reference)} - {None}
    for o in x.test.objects:
        slot = x.test.layout.get(o.name)
        if o.role != "distractor" or slot is None or x.known(o.kind) or slot == x.base.layout.get(o.name):
            continue
        if slot in picked or o.color in colors:
            return True
    return False


def order_is_new(x: Exposure) -> bool:
    """The order is part of the goal, and no demonstration had it."""
    sequence = tuple(kind for goal in x.goals for kind in sorted(x.kinds(goal))[:1])
    still_open = {kind for goal in x.open_goals for kind in x.kinds(goal)}
    return x.test.instruction.ordered and len(still_open) > 1 and sequence not in x.trained.sequences


def looks_mid_task(x: Exposure) -> bool:
    """The initial state looks like the middle of a demonstration."""
    return x.test.mid_task_look


def pairing_is_new(x: Exposure) -> bool:
    """Instruction and scene never met in training, and something is to be done."""
    met = {(c.instruction.text, _shown(c)) for c in x.task.training}
    return x.test.expected is Expected.SUCCEED and (x.test.instruction.text, _shown(x.test)) not in met


def target_moved(x: Exposure) -> bool:
    """What something is to be put at stands elsewhere than in the twin, or a slot is outside the training regime."""
    return any(_stand(x.test, goal.target) != _stand(x.base, goal.target) for goal in x.open_goals)


def chain_is_longer(x: Exposure) -> bool:
    """More steps are asked for than in any demonstration."""
    return len(x.open_goals) > x.longest_trained


def _stand(condition: Condition, name: str) -> str | None:
    """Return the slot in which a target, or the cabinet of a drawer, stands."""
    if name not in {o.name for o in condition.objects}:
        return None
    mount = condition.object(name).mount
    return condition.layout.get(name if mount is None else mount.target)


def _shown(condition: Condition) -> frozenset[tuple[str, str]]:
    """Return what the initial scene shows: which kind stands where, and which drawers are open."""
    places = {(condition.object(n).kind, slot) for n, slot in condition.layout.items()}
    places |= {(condition.object(n).kind, f"at {p.target} {p.region}") for n, p in condition.preplaced.items()}
    return frozenset(places | {(n, f"open {distance}") for n, distance in condition.opened.items()})


RULES: dict[Label, Callable[[Exposure], bool]] = {
    Label.LEXICAL_KINEMATIC_SHORTCUT: word_leads_elsewhere,
    Label.VISUAL_LAYOUT_BIAS: first_place_is_wrong,
    Label.BEHAVIORAL_INERTIA: habit_is_wrong,
    Label.CAUSAL_CONFUSION: progress_is_misread,
    Label.SEMANTIC_FEATURE_COLLAPSE: look_alike_is_there,
    Label.ORDER_VIOLATION: order_is_new,
    Label.PHASE_CONFLICT: looks_mid_task,
    Label.EARLY_HALT: pairing_is_new,
    Label.EXECUTION_FAILURE: target_moved,
    Label.TIMEOUT: chain_is_longer,
}


def exposed_labels(task_id: str, variation: str) -> tuple[Label, ...]:
    """Return the labels of the failure modes that a variation can bring out, in the order of the table."""
    exposure = Exposure.of(task_id, variation)
    return tuple(label for label, rule in RULES.items() if rule(exposure))
