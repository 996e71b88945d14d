"""The size at which answers become correct: known thresholds are found, and unknown ones are not concluded."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from tests.daily import others_slow

from betterbench.errors import InvalidInputError
from betterbench.statistics import Reading, fit_threshold
from betterbench.statistics.threshold import _Cells

KINDS = "abcd"
FEW = 40
"""Resamples that suffice for a test of the value."""


def readings(s, *, n=400, low=5.0, high=90.0, wrong=0.05, seed=0, guesses=True, eyes=None):
    """Returns answers of a reader of all sizes from s, for items that four kinds of guessing have equally often.

    ``eyes`` gives by condition the factor of the sizes, the factor of s and the share of further wrong answers.
    """
    draw = np.random.default_rng(seed)
    size = np.exp(draw.uniform(math.log(low), math.log(high), n))
    chance, kind, cluster = draw.choice([0.0, 0.25, 0.5], n), draw.choice(4, n), draw.integers(0, n // 10, n)
    found = []
    for name, (scale, higher, more) in (eyes or {"": (1.0, 1.0, 0.0)}).items():
        for i in range(n):
            reads = size[i] * scale >= s * higher
            right = draw.random() >= wrong + more if reads else guesses and draw.random() < chance[i]
            item = KINDS[kind[i]], str(cluster[i]), name
            found.append(Reading(float(size[i] * scale), float(right), float(chance[i]), *item))
    return found


def fitted(of, resamples=FEW):
    return fit_threshold(of, generator=np.random.default_rng(1), resamples=resamples)


@pytest.mark.parametrize("wrong", [0.05, 0.1])
@pytest.mark.parametrize("s", others_slow([8, 12, 20, 32], 4))
def test_a_known_threshold_is_found_within_a_tenth(s, wrong):
    found = fitted(readings(s, wrong=wrong))
    assert found.reason == ""
    assert found.value == pytest.approx(s, rel=0.1)
    assert found.low <= found.value * 1.001
    assert found.high >= found.value * 0.999
    assert found.guessing > 0.6
    assert np.mean(list(found.knowledge.values())) == pytest.approx(1 - wrong, abs=0.12)


def test_a_model_that_does_not_guess_has_the_same_threshold():
    found = fitted(readings(20, guesses=False))
    assert found.value == pytest.approx(20, rel=0.1)
    assert found.guessing < 0.2


@pytest.mark.parametrize("seed", others_slow([0, 1], 2))
def test_a_threshold_outside_the_sizes_is_not_concluded(seed):
    below, above = (fitted(readings(s, seed=seed)) for s in (2.0, 300.0))
    assert below.value is above.value is None
    assert re.search("a threshold would be below them|items are smaller", below.reason)
    assert "not better than guessing at any size" in above.reason
    assert below.to_json()["value"] is None


def test_a_threshold_at_the_edge_of_the_sizes_is_not_bracketed():
    assert fitted(readings(88.0, n=1200)).value is None


def test_a_kind_that_is_difficult_at_every_size_does_not_move_the_threshold():
    """Kind "a" has small objects and is never known; without a knowledge of its own, s would be overestimated."""
    of = [r for r in readings(12, n=600) if r.kind != "a" or r.size < 30]
    lost = [Reading(r.size, 0.0, 0.0, r.kind, r.cluster) if r.kind == "a" else r for r in of]
    found = fitted(lost)
    assert found.value == pytest.approx(12, rel=0.1)
    assert found.knowledge["a"] < 0.05


def test_few_items_are_too_few():
    assert "39 items in" in fitted(readings(12)[:39]).reason
    one = [Reading(r.size, r.score, r.chance, r.kind, "scene") for r in readings(12)]
    assert "400 items in 1 clusters are too few" in fitted(one).reason
    assert "0 items" in fitted([]).reason


def test_conditions_that_only_change_the_size_have_no_further_loss():
    eyes = {"native": (1.0, 1.0, 0.0), "half": (0.5, 1.0, 0.0)}
    found = fitted(readings(12, eyes=eyes), 100)
    assert found.value == pytest.approx(12, rel=0.1)
    assert not found.further["half"].is_supported
    assert abs(found.further["half"].value) < 0.03


@pytest.mark.parametrize(
    "half", others_slow([((0.5, 1.0, 0.2),), ((0.5, 1.5, 0.0),)], 2), ids=["knowledge", "threshold"]
)
def test_a_further_loss_is_found(half):
    found = fitted(readings(12, n=600, eyes={"native": (1.0, 1.0, 0.0), "half": half}), 100)
    loss = found.further["half"]
    assert loss.is_supported
    assert 0.0 < loss.low < loss.value < loss.high < 0.3


def test_the_gradient_is_the_derivative():
    eyes = {"native": (1.0, 1.0, 0.0), "half": (0.5, 1.0, 0.1)}
    cells = _Cells.of(readings(12, n=100, eyes=eyes))
    counts = cells.counts(np.ones(len(cells.clusters)))
    at = np.array([2.5, 1.5, 0.7, 0.6, 0.7, 0.8, 0.9])
    _, gradient = cells._loss(at, *counts)
    step = 1e-6
    moved = [
        (cells._loss(at + step * e, *counts)[0] - cells._loss(at - step * e, *counts)[0]) / (2 * step)
        for e in np.eye(len(at))
    ]
    np.testing.assert_allclose(gradient, moved, atol=1e-7)


def test_impossible_readings_are_refused():
    for reading in (
        Reading(0.0, 1.0, 0.5, "a", "x"),
        Reading(1.0, 2.0, 0.5, "a", "x"),
        Reading(1.0, 1.0, 1.0, "a", "x"),
    ):
        with pytest.raises(InvalidInputError, match="readings"):
            fitted([reading])
