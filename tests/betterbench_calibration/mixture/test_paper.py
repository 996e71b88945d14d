"""The paper's mixture: rows as printed, sums computed, and what its GPUs buy."""

from __future__ import annotations

import math

import pytest

from betterbench.errors import InvalidInputError
from betterbench_calibration.mixture import TokenPrices, budget_of, paper_mixture

PAPER = paper_mixture()


def prices(groups: tuple[str, ...] = ()) -> dict[str, float]:
    return {p.name: TokenPrices().of(PAPER.kind_of(p.group)) for p in PAPER.parts(groups)}


def test_totals_are_the_sums_of_the_rows():
    episodes, frames, samples = PAPER.totals()
    assert (episodes.rows, frames.rows, samples.rows) == (924_093, 47_696_800, 14_640_000)
    assert episodes.agrees
    assert samples.agrees
    assert not frames.agrees
    assert (frames.printed, frames.computed) == (47.69, 47.7)
    assert "not rounded" in frames.note


def test_shares_of_groups_are_80_and_5_percent():
    by_group: dict[str, float] = {}
    for part in PAPER.parts():
        by_group[part.group] = by_group.get(part.group, 0.0) + part.share
    assert by_group["OXE"] == pytest.approx(0.8)
    assert [round(by_group[g.name], 12) for g in PAPER.groups[1:]] == [0.05] * 4
    assert math.fsum(p.share for p in PAPER.parts(("OXE",))) == pytest.approx(1.0)


def test_rules_inside_the_actions():
    items = {p.name: p.share for p in PAPER.parts()}
    assert items["DROID"] == pytest.approx(0.8 * 27_044_326 / 47_696_800)
    assert {round(p.share, 9) for p in PAPER.parts(inside="equal") if p.group == "OXE"} == {round(0.8 / 6, 9)}
    soup = {p.name: p.share for p in PAPER.parts(inside="magic-soup-plus")}
    assert soup["KUKA"] / soup["DROID"] == pytest.approx(0.8341 * 2_455_879 / (0.06 * 27_044_326))


def test_both_runs_of_the_paper():
    alone, both = (
        budget_of(PAPER.parts(run.groups), prices(run.groups), gpus=run.gpus, steps=run.steps) for run in PAPER.runs
    )
    assert both.tokens / alone.tokens == pytest.approx(1.5)
    assert alone.tokens == 16 * 100_000 * 8192
    for budget in (alone, both):
        assert math.fsum(row.tokens for row in budget.rows) == pytest.approx(budget.tokens)
        assert math.fsum(row.samples for row in budget.rows) == pytest.approx(budget.samples)
        assert math.fsum(row.token_share for row in budget.rows) == pytest.approx(1.0)
    droid = {row.name: row for row in alone.rows}["DROID"]
    assert droid.passes == pytest.approx(alone.samples / 47_696_800)


def test_equal_samples_for_each_gpu_give_co_training_a_fifth_more_actions():
    ones = dict.fromkeys(prices(), 1.0)
    alone, both = (
        budget_of(PAPER.parts(run.groups), ones, gpus=run.gpus, steps=run.steps, tokens_per_gpu=32)
        for run in PAPER.runs
    )
    actions = sum(row.samples for row in both.rows[:6])
    assert actions / alone.samples == pytest.approx(24 * 0.8 / 16)


def test_hours_and_wrong_numbers():
    parts = PAPER.parts(("OXE",))
    budget = budget_of(parts, prices(), gpus=1, steps=10, tokens_per_gpu=1e6, parameters=2e9, utilization=0.5)
    assert budget.gpu_hours == pytest.approx(6 * 2e9 * 1e7 / 156e12 / 3600)
    with pytest.raises(InvalidInputError, match="gpus: 0"):
        budget_of(parts, prices(), gpus=0, steps=1)
    with pytest.raises(InvalidInputError, match="no value for DROID"):
        budget_of(parts, {}, gpus=1, steps=1)
