"""Draws: even, the same in any pieces and shards, and no item twice before all came once."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from betterbench.errors import InvalidInputError, RunConflictError
from betterbench_calibration.mixture import MixturePart, MixtureSampler, paper_mixture, shares_of
from betterbench_calibration.mixture.shares import WeightedGroup


def small(*sizes: int, weights: tuple[float, ...] | None = None) -> tuple[MixturePart, ...]:
    parts = tuple(MixturePart(f"set{i}", "all", size, weights[i] if weights else 1.0) for i, size in enumerate(sizes))
    return shares_of([WeightedGroup("all", 1.0, parts, "weights" if weights else "equal")])


def by_name(parts: tuple[MixturePart, ...]) -> dict[str, float]:
    return {part.name: part.share for part in parts}


def check_shares(found: Mapping[str, int], draws: int) -> None:
    """Checks that no part of the paper's mixture is ten draws away from its share."""
    for name, share in by_name(paper_mixture().parts()).items():
        assert abs(found[name] - draws * share) < 10.0


@pytest.mark.parametrize(
    ("draws", "counts"), [(20_000, (2,)), pytest.param(100_000, (2, 3, 4), marks=pytest.mark.slow)]
)
def test_shares_of_many_draws_over_shards_and_a_resume(draws, counts):
    parts = paper_mixture().parts()
    alone = [d.part for d in MixtureSampler(parts, seed=7, draws=draws)]
    assert len(alone) == draws
    check_shares(Counter(alone), draws)
    for shards in counts:
        state = None
        union: list[str | None] = [None] * draws
        for shard in range(shards):
            first = MixtureSampler(parts, seed=7, shard=shard, shards=shards, draws=draws)
            begun = list(itertools.islice(first, 5_000))
            state = first.state_dict()
            second = MixtureSampler(parts, seed=7, shard=shard, shards=shards, draws=draws)
            second.load_state_dict(state)
            mine = [*begun, *second]
            assert len(mine) == len(range(shard, draws, shards))
            ours = Counter(d.part for d in mine)
            assert all(abs(ours[name] / len(mine) - share) < 0.005 for name, share in by_name(parts).items())
            for d in mine:
                union[d.number] = d.part
        assert union == alone


def test_counts_of_100_000_draws_are_the_shares():
    check_shares(MixtureSampler(paper_mixture().parts(), seed=7).counts(100_000), 100_000)


def test_a_state_of_some_shards_goes_on_with_another_number_of_them():
    parts = small(30, 5, 900)
    whole = list(MixtureSampler(parts, draws=3_000))
    begun = [MixtureSampler(parts, shard=r, shards=3, draws=3_000) for r in range(3)]
    drawn = [d for s in begun for d in itertools.islice(s, 100)]
    assert len({str(s.state_dict()) for s in begun}) == 1
    for shard in range(4):
        later = MixtureSampler(parts, shard=shard, shards=4, draws=3_000)
        later.load_state_dict(begun[0].state_dict())
        assert len(later) == 675
        drawn += later
    assert sorted(drawn, key=lambda d: d.number) == whole


@given(st.lists(st.integers(1, 40), min_size=1, max_size=5), st.integers(0, 2**32), st.integers(0, 400))
def test_counts_are_those_of_the_draws(sizes, seed, draws):
    sampler = MixtureSampler(small(*sizes), seed=seed)
    found = Counter(sampler.draw(n).part for n in range(draws))
    assert sampler.counts(draws) == {f"set{i}": found[f"set{i}"] for i in range(len(sizes))}


@given(st.lists(st.integers(1, 40), min_size=1, max_size=4), st.integers(0, 2**32))
def test_every_item_comes_once_before_any_comes_again(sizes, seed):
    seen: dict[tuple[str, int], list[int]] = {}
    for d in MixtureSampler(small(*sizes), seed=seed, draws=250):
        seen.setdefault((d.part, d.epoch), []).append(d.item)
    for (name, epoch), items in seen.items():
        size = sizes[int(name.removeprefix("set"))]
        assert len(set(items)) == len(items)
        if (name, epoch + 1) in seen:
            assert sorted(items) == list(range(size))


def test_orders_of_epochs_and_seeds_differ_and_have_no_trend():
    first = [d.item for d in MixtureSampler(small(1_000), draws=2_000)]
    assert first[:1_000] != first[1_000:]
    assert first != [d.item for d in MixtureSampler(small(1_000), seed=1, draws=2_000)]
    ranks = sum(a < b for a, b in itertools.pairwise(first[:1_000]))
    assert 430 < ranks < 570


def test_no_set_waits_much_longer_than_its_share():
    parts = paper_mixture().parts()
    last: dict[str, int] = {}
    for d in MixtureSampler(parts, draws=20_000):
        if d.part in last:
            assert (d.number - last[d.part]) * by_name(parts)[d.part] < 3.0
        last[d.part] = d.number


def test_what_cannot_be_drawn_from():
    parts = small(3, 4)
    with pytest.raises(InvalidInputError, match="shard: 2 is out of range"):
        MixtureSampler(parts, shard=2, shards=2)
    with pytest.raises(InvalidInputError, match="add up to"):
        MixtureSampler((MixturePart("a", "g", 3),))
    with pytest.raises(RunConflictError, match="different mixture"):
        MixtureSampler(parts).load_state_dict(MixtureSampler(parts, seed=1).state_dict())
    with pytest.raises(InvalidInputError, match="not a number of draws"):
        MixtureSampler(parts).load_state_dict({"position": -1})
    for weights in ((0.0, 0.0), (1.0, -1.0), (1.0, float("nan"))):
        with pytest.raises(InvalidInputError, match=r"weight"):
            small(3, 4, weights=weights)
    with pytest.raises(InvalidInputError, match="no items to draw"):
        small(3, 0)
    with pytest.raises(InvalidInputError, match="have this name"):
        shares_of([WeightedGroup("g", 1.0, (MixturePart("a", "g", 1), MixturePart("a", "g", 2)))])


def test_a_set_of_weight_zero_is_never_drawn():
    parts = small(3, 4, 5, weights=(1.0, 0.0, 1.0))
    assert {d.part for d in MixtureSampler(parts, draws=500)} == {"set0", "set2"}
