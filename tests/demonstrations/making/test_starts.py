"""Starts: which seeds demonstrations begin from."""

from __future__ import annotations

import pytest
from tests.daily import others_slow

from betterbench.demonstrations.making.starts import (
    FIRST_AMPLIFIED_SEED,
    SPARE_ROUNDS,
    coverage_of,
    factors_of,
    levels_of,
    planned_starts,
    replacement,
)
from betterbench.errors import InvalidInputError
from betterbench.tasks import get_task
from betterbench.tasks.randomness import FIRST_DEMONSTRATION_SEED


def test_a_larger_set_holds_the_smaller_one():
    task = get_task("fast_food")
    few, many = (planned_starts(task, n, first_seed=FIRST_AMPLIFIED_SEED) for n in (3, 7))
    assert set(few) < set(many)


@pytest.mark.parametrize("name", others_slow(["fast_food", "office_drawer", "desk_meeting"], 3))
def test_no_seed_is_used_twice_and_none_is_that_of_a_test(name):
    """Of tasks with 2, 8 and 12 training conditions."""
    task = get_task(name)
    starts = planned_starts(task, 2, first_seed=FIRST_DEMONSTRATION_SEED)
    seeds = [start.seed for start in starts]
    seeds += [replacement(task, start, 1, first_seed=FIRST_DEMONSTRATION_SEED).seed for start in starts]
    assert len(set(seeds)) == len(seeds) == 4 * len(task.training)
    assert min(seeds) >= FIRST_DEMONSTRATION_SEED


def test_every_level_is_one_that_the_factor_has():
    task = get_task("office_drawer")
    for condition in task.training:
        factors = {f.name: f.levels for f in factors_of(task, condition)}
        levels = levels_of(task, condition, FIRST_DEMONSTRATION_SEED)
        assert set(levels) == set(factors)
        assert all(0 <= level < factors[name] for name, level in levels.items())


def test_chosen_starts_are_more_even_than_consecutive_seeds():
    task = get_task("fast_food")
    condition = task.training[0]
    starts = planned_starts(task, 48, first_seed=FIRST_AMPLIFIED_SEED)
    chosen = coverage_of(task, condition, [s.seed for s in starts if s.condition == condition.name])
    plain = coverage_of(task, condition, range(FIRST_AMPLIFIED_SEED, FIRST_AMPLIFIED_SEED + 48))
    assert min(f.evenness for f in chosen) >= 0.5
    assert sum(f.evenness for f in chosen) > 1.2 * sum(f.evenness for f in plain)
    assert all(sum(f.counts) == 48 for f in chosen)


def test_a_start_is_replaced_by_one_that_is_like_it_and_not_for_ever():
    task = get_task("fast_food")
    condition = task.training[0]
    start = planned_starts(task, 1, first_seed=FIRST_AMPLIFIED_SEED)[0]
    wanted, seen = levels_of(task, condition, start.seed), {start.seed}
    for round_ in range(1, SPARE_ROUNDS + 1):
        other = replacement(task, start, round_, first_seed=FIRST_AMPLIFIED_SEED)
        levels = levels_of(task, condition, other.seed)
        assert sum(levels[name] == level for name, level in wanted.items() if name.startswith("slot ")) >= 2
        assert other.seed not in seen
        seen.add(other.seed)
    assert replacement(task, start, SPARE_ROUNDS + 1, first_seed=FIRST_AMPLIFIED_SEED) is None


@pytest.mark.parametrize(("number", "seed"), [(0, FIRST_AMPLIFIED_SEED), (1, 9_999), (10_001, FIRST_AMPLIFIED_SEED)])
def test_numbers_out_of_range_are_refused(number, seed):
    with pytest.raises(InvalidInputError):
        planned_starts(get_task("fast_food"), number, first_seed=seed)
