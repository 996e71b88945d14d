"""Choose initial states for demonstrations so that they cover the training distribution evenly.

An initial state is described by discrete levels of several factors. The factors are the appearance of the scene and,
for each slot of a relevant object, the object's position (a cell of the slot) and its rotation. Seeds are divided into
blocks of consecutive seeds. From each block, the seed with the least frequent levels so far is chosen. The blocks do
not overlap and do not depend on the number of initial states, so a larger set contains the smaller one. If a seed is
abandoned, it is replaced by the most similar seed of a spare block.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from betterbench.errors import require_between
from betterbench.sim.scenes.appearance import LOOK_SETS, look_set_of
from betterbench.sim.scenes.builder import slot_pose
from betterbench.tasks import Condition, Slot, Task, TrialId
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED

FIRST_AMPLIFIED_SEED = 1_000_000_000
"""Default first seed of amplified demonstrations, which is far from the seeds of their source demonstrations."""
GRID = 3
"""Number of cells along each axis of the region in which a slot places objects."""
BLOCK = 32
"""Number of consecutive seeds in a block. One seed is chosen from each block."""
SPARE_BLOCK = 256
"""Number of consecutive seeds from which the replacement of an abandoned seed is chosen."""
SLOT_WEIGHT = 3
"""Penalty for a different cell of a slot when a replacement is chosen.

A different rotation or appearance has penalty 1.
"""
SPARE_ROUNDS = 4
"""Maximum number of times that an initial state is replaced."""
SPARES_FROM = 20_000_000
"""Difference between the first seed for replacements and the first seed of the set."""
MOST_STARTS = 10_000
"""Maximum number of initial states per training condition.

With this limit, their blocks end before the spare seeds begin.
"""

Levels = Mapping[str, int]
"""Level of each factor in an initial state, by factor name."""


@dataclass(frozen=True, slots=True)
class Start:
    """Planned demonstration from one initial state.

    Attributes:
        condition: Name of the training condition.
        number: Index of the demonstration in its condition, from 0.
        round: Number of times that the seed has been replaced.
        seed: Seed of the initial state.
    """

    task: str
    condition: str
    number: int
    round: int
    seed: int

    @property
    def trial(self) -> TrialId:
        """Trial of this demonstration."""
        return TrialId(self.task, self.condition, self.seed)


@dataclass(frozen=True, slots=True)
class Factor:
    """Random factor of an initial state.

    Attributes:
        name: "slot first" for the position in a slot, "turn first" for the rotation in a slot, or "looks".
        levels: Number of levels.
    """

    name: str
    levels: int


def factors_of(task: Task, condition: Condition) -> tuple[Factor, ...]:
    """Return the random factors of a condition.

    The factors of objects to be moved come before the factors of targets.
    """
    slots = _slots(task, condition)
    return (
        *(Factor(f"slot {s.name}", GRID * GRID) for s in slots if s.jitter_m > 0.0),
        *(Factor(f"turn {s.name}", GRID) for s in slots if s.yaw_jitter > 0.0),
        Factor("looks", LOOK_SETS),
    )


def levels_of(task: Task, condition: Condition, seed: int) -> Levels:
    """Return the levels of all factors for a seed, without building the scene."""
    return _levels(task, _slots(task, condition), seed)


def _slots(task: Task, condition: Condition) -> tuple[Slot, ...]:
    names: dict[str, None] = {}
    for goal in condition.instruction.subgoals:
        names.update(dict.fromkeys(condition.resolve(goal.reference)))
    for goal in condition.instruction.subgoals:
        mount = condition.object(goal.target).mount
        names.setdefault(goal.target if mount is None else mount.target)
    return tuple(task.slot(condition.layout[name]) for name in names if name in condition.layout)


def _levels(task: Task, slots: Iterable[Slot], seed: int) -> dict[str, int]:
    found = {"looks": look_set_of(task.id, seed)}
    for slot in slots:
        (x, y, _), yaw = slot_pose(task, seed, slot.name)
        if slot.jitter_m > 0.0:
            across, along = (_level((v - m) / slot.jitter_m) for v, m in ((x, slot.x), (y, slot.y)))
            found[f"slot {slot.name}"] = GRID * across + along
        if slot.yaw_jitter > 0.0:
            found[f"turn {slot.name}"] = _level((yaw - slot.yaw) / slot.yaw_jitter)
    return found


def _level(share: float) -> int:
    """Return the level of a random number in [-1, 1]."""
    return min(GRID - 1, max(0, int(0.5 * (share + 1.0) * GRID)))


def planned_starts(task: Task, numbers: int | Sequence[int], *, first_seed: int) -> tuple[Start, ...]:
    """Choose the initial states for the demonstrations of a task.

    Args:
        task: The task.
        numbers: Number of demonstrations per training condition: either a single number, or a list with one number for
            each condition.
        first_seed: First seed to use.

    Raises:
        InvalidInputError: If a number is out of range, or the first seed is a test seed.
    """
    wanted = [numbers] * len(task.training) if isinstance(numbers, int) else list(numbers)
    require_between("--demos", min(wanted), 1, MOST_STARTS)
    require_between("--demos", max(wanted), 1, MOST_STARTS)
    require_between("--seed", first_seed, FIRST_DEMONSTRATION_SEED, 2_000_000_000)
    return tuple(
        Start(task.id, condition.name, i, 0, seed)
        for condition, number in zip(task.training, wanted, strict=True)
        for i, seed in enumerate(_seeds(task, condition, number, first_seed))
    )


def shared_out(total: int, parts: int) -> tuple[int, ...]:
    """Divide ``total`` demonstrations among ``parts`` conditions as evenly as possible.

    Each condition gets at least one demonstration, and the first conditions get the remainder. If the total grows, no
    condition gets fewer demonstrations, so a larger set contains the smaller one.
    """
    return tuple(max(1, total // parts + (part < total % parts)) for part in range(parts))


def _seeds(task: Task, condition: Condition, number: int, first_seed: int) -> tuple[int, ...]:
    slots, factors = _slots(task, condition), factors_of(task, condition)
    drawn: dict[str, Counter[int]] = {f.name: Counter() for f in factors}
    seeds = []
    for i in range(number):
        begin = first_seed + BLOCK * _block_number(task, condition, i)
        block = [(seed, _levels(task, slots, seed)) for seed in range(begin, begin + BLOCK)]

        def crowding(candidate: tuple[int, Levels]) -> tuple[int, int]:
            seed, levels = candidate
            return sum(f.levels * drawn[f.name][levels[f.name]] for f in factors), seed

        seed, levels = min(block, key=crowding)
        for f in factors:
            drawn[f.name][levels[f.name]] += 1
        seeds.append(seed)
    return tuple(seeds)


def _block_number(task: Task, condition: Condition, number: int) -> int:
    return number * len(task.training) + task.training.index(condition)


def replacement(task: Task, start: Start, round_: int, *, first_seed: int) -> Start | None:
    """Return a replacement for a planned initial state that had no accepted demonstration in ``round_`` rounds.

    Each replacement is chosen to be similar to the original initial state, not to the previous replacement. Return None
    if there have been too many replacements.
    """
    if round_ > SPARE_ROUNDS:
        return None
    condition = task.train(start.condition)
    slots, factors = _slots(task, condition), factors_of(task, condition)
    wanted = _levels(task, slots, start.seed)
    block = _block_number(task, condition, start.number) * SPARE_ROUNDS + round_ - 1
    begin = first_seed + SPARES_FROM + SPARE_BLOCK * block

    def unlike(seed: int) -> tuple[int, int]:
        levels = _levels(task, slots, seed)
        differing = (f.name for f in factors if levels[f.name] != wanted[f.name])
        return sum(SLOT_WEIGHT if name.startswith("slot ") else 1 for name in differing), seed

    seed = min(range(begin, begin + SPARE_BLOCK), key=unlike)
    return Start(start.task, start.condition, start.number, round_, seed)


def twin_starts(task: Task, numbers: Sequence[int], *, first_seed: int) -> tuple[Start, ...]:
    """Choose initial states like :func:`planned_starts`, but with the same seeds in all training conditions."""
    most = max(numbers)
    first = planned_starts(task, [most] + [1] * (len(task.training) - 1), first_seed=first_seed)
    seeds = [start.seed for start in first if start.condition == task.training[0].name]
    return tuple(Start(task.id, c.name, i, 0, seed) for c in task.training for i, seed in enumerate(seeds))


@dataclass(frozen=True, slots=True)
class FactorCoverage:
    """Coverage of the levels of a factor by initial states.

    Attributes:
        counts: Number of initial states at each level.
        filled: Number of levels with at least one initial state, divided by the maximum that is possible with this
            number of initial states.
        evenness: Number of initial states at the rarest level, divided by the mean over all levels.
    """

    factor: str
    counts: tuple[int, ...]
    filled: float
    evenness: float


def coverage_of(task: Task, condition: Condition, seeds: Sequence[int]) -> tuple[FactorCoverage, ...]:
    """Return the coverage of each factor of a training condition by the initial states with the given seeds."""
    slots = _slots(task, condition)
    drawn = [_levels(task, slots, seed) for seed in seeds]
    found = []
    for factor in factors_of(task, condition):
        counts = Counter(levels[factor.name] for levels in drawn)
        listed = tuple(counts[level] for level in range(factor.levels))
        reachable = max(1, min(factor.levels, len(seeds)))
        mean = len(seeds) / factor.levels
        filled = sum(c > 0 for c in listed) / reachable
        found.append(
            FactorCoverage(factor.name, listed, round(filled, 4), round(min(listed) / mean, 4) if mean else 0.0)
        )
    return tuple(found)
