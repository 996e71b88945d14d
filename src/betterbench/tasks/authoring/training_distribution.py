"""Regularities in a task's training conditions, such as the slots that go with each word of the instructions.

These regularities are confounds, and variations break them. They are computed from the training conditions instead of
being written by hand, so that they always agree with the conditions.
"""

from collections import Counter
from dataclasses import dataclass

from betterbench.tasks.authoring.task import Task
from betterbench.tasks.condition import Condition


@dataclass(frozen=True, slots=True)
class TrainingDistribution:
    """Regularities of a task's training conditions.

    Attributes:
        word_slots: For each word of the instructions, the slots of the objects that the word refers to.
        kind_slots: For each kind of requested object, the slots where it is picked up.
        standing_kinds: For each slot, the kinds of objects that stand there at the start.
        first_kinds: Kinds of the object that is handled first in a demonstration, with their counts, most frequent
            first.
        kind_targets: For each kind of object, the targets that it is brought to. Each is given by the kind of the
            target, the relation and the region.
        sequences: For each training condition, the kinds of objects in the order of their handling.
        initial_items: Largest number of movable objects on the table at the start of a demonstration.
    """

    word_slots: dict[str, tuple[str, ...]]
    kind_slots: dict[str, tuple[str, ...]]
    standing_kinds: dict[str, tuple[str, ...]]
    first_kinds: tuple[tuple[str, int], ...]
    kind_targets: dict[str, tuple[tuple[str, str, str], ...]]
    sequences: tuple[tuple[str, ...], ...]
    initial_items: int

    @property
    def habit(self) -> str | None:
        """Kind of object that most demonstrations begin with, or None if there is a tie."""
        ranked = self.first_kinds
        if not ranked or (len(ranked) > 1 and ranked[0][1] == ranked[1][1]):
            return None
        return ranked[0][0]

    @property
    def fixed_sequence(self) -> tuple[str, ...] | None:
        """Longest sequence of kinds of objects, if every demonstration is this sequence or a beginning of it.

        The value is None if the demonstrations follow different sequences, or if the longest sequence has only one
        step.
        """
        whole = max(self.sequences, key=len)
        fixed = len(whole) > 1 and all(whole[: len(part)] == part for part in self.sequences)
        return whole if fixed else None

    @property
    def favorite_slot(self) -> str:
        """Slot to which most words of the instructions refer.

        If there is a tie, it is the first of these slots by name.
        """
        counts = Counter(slot for slots in self.word_slots.values() for slot in slots)
        return min(counts, key=lambda slot: (-counts[slot], slot))

    @property
    def longest(self) -> int:
        """Largest number of subgoals in any demonstration."""
        return max(len(sequence) for sequence in self.sequences)

    def known_kinds(self, condition: Condition) -> frozenset[str]:
        """Return the kinds of objects that the instruction of a condition or any training instruction refers to."""
        asked = {
            condition.object(n).kind for g in condition.instruction.subgoals for n in condition.resolve(g.reference)
        }
        return frozenset(asked | self.kind_slots.keys())


def training_distribution_of(task: Task) -> TrainingDistribution:
    """Compute the regularities of a task's training conditions."""
    word_slots: dict[str, set[str]] = {}
    kind_slots: dict[str, set[str]] = {}
    standing: dict[str, set[str]] = {}
    places: dict[str, set[tuple[str, str, str]]] = {}
    first: Counter[str] = Counter()
    sequences: list[tuple[str, ...]] = []
    items = 0
    for condition in task.training:
        items = max(items, len(on_table(condition)))
        for name, slot in condition.layout.items():
            standing.setdefault(slot, set()).add(condition.object(name).kind)
        kinds: list[str] = []
        for goal in condition.instruction.subgoals:
            names = condition.resolve(goal.reference)
            slots = {condition.layout[n] for n in names if n in condition.layout}
            word_slots.setdefault(goal.word, set()).update(slots)
            kind = condition.object(names[0]).kind
            kind_slots.setdefault(kind, set()).update(slots)
            places.setdefault(kind, set()).add((condition.object(goal.target).kind, goal.relation, goal.region))
            kinds.append(kind)
        first[kinds[0]] += 1
        sequences.append(tuple(kinds))
    return TrainingDistribution(
        {w: tuple(sorted(s)) for w, s in word_slots.items()},
        {k: tuple(sorted(s)) for k, s in kind_slots.items()},
        {s: tuple(sorted(k)) for s, k in standing.items()},
        tuple(sorted(first.items(), key=lambda item: (-item[1], item[0]))),
        {k: tuple(sorted(p)) for k, p in places.items()},
        tuple(sequences),
        items,
    )


def pairing(condition: Condition) -> tuple[str, frozenset[tuple[str, str]]]:
    """Return the instruction and the initial scene of a condition.

    The scene is described by the kind of object in each slot, the objects that start at a target, and the open drawers.
    """
    places = {(condition.object(n).kind, slot) for n, slot in condition.layout.items()}
    places |= {(condition.object(n).kind, f"at {p.target} {p.region}") for n, p in condition.preplaced.items()}
    places |= {(condition.object(n).kind, f"open {distance}") for n, distance in condition.opened.items()}
    return condition.instruction.text, frozenset(places)


def on_table(condition: Condition) -> tuple[str, ...]:
    """Return the names of the movable objects that start in a slot."""
    return tuple(o.name for o in condition.objects if o.role in ("item", "distractor") and o.name in condition.layout)
