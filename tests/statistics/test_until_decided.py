"""Laws of trials until a verdict: few wrong verdicts whenever one stops, and a schedule that outcomes alone decide."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from tests.daily import TODAY, others_slow

from betterbench.errors import InvalidInputError
from betterbench.statistics import (
    Decisions,
    Question,
    StoppingRule,
    Verdict,
    decide,
    e_benjamini_hochberg,
)

RULE = StoppingRule()
SEEDS = range(20)


def questions(n: int, *, twins: int = 1) -> list[Question]:
    return [Question(f"v{i}", f"t{i % twins}") for i in range(n)]


def drawn(asked: list[Question], rates: dict[str, float], generator: np.random.Generator) -> dict[str, list[bool]]:
    names = dict.fromkeys(name for q in asked for name in (q.condition, q.twin))
    return {name: (generator.random(len(SEEDS)) < rates[name[0]]).tolist() for name in names}


def decided(asked: list[Question], outcomes: dict[str, list[bool]], rule: StoppingRule = RULE) -> Decisions:
    return decide(asked, SEEDS, lambda name, seed: outcomes[name][seed], rule=rule)


# ------------------------------------------------------------------------------------------------------ the correction


def test_the_correction_rejects_the_most_that_support_each_other():
    generator = np.random.default_rng(3)
    for _ in range(300):
        evidence = np.exp(generator.normal(2.0, 2.0, generator.integers(1, 12))).tolist()
        found = e_benjamini_hochberg(evidence, level=0.05)
        size = max((k for k in range(len(evidence) + 1) if _supported(evidence, k)), default=0)
        assert len(found) == size
        assert all(evidence[i] >= len(evidence) / (0.05 * size) for i in found)


def _supported(evidence: list[float], k: int) -> bool:
    return k == 0 or sum(e >= len(evidence) / (0.05 * k) for e in evidence) >= k


def test_hypotheses_that_cannot_be_rejected_any_more_still_count():
    assert e_benjamini_hochberg([40.0, 40.0], level=0.05) == {0, 1}
    assert e_benjamini_hochberg([40.0, 40.0], level=0.05, hypotheses=60) == frozenset()


@pytest.mark.parametrize(("evidence", "level", "where"), [([-1.0], 0.05, "evidence"), ([1.0], 0.0, "level")])
def test_impossible_evidence_and_levels_are_refused(evidence, level, where):
    with pytest.raises(InvalidInputError, match=f"^{where}"):
        e_benjamini_hochberg(evidence, level=level)


# -------------------------------------------------------------------------------------------------------- false alarms


LOST = ((1.0, 0.5), (0.6, 0.1))
"""Success rates of a twin and of a variation that has lost much."""


@pytest.mark.parametrize(
    ("twin", "varied", "wrong"),
    [
        *others_slow([(0.5, 0.5, {Verdict.DROP}), (0.9, 0.9, {Verdict.DROP})], 2),
        *others_slow([(twin, varied, {Verdict.NO_DROP, Verdict.NOT_LEARNED}) for twin, varied in LOST], 2),
    ],
)
@pytest.mark.parametrize("twins", others_slow([1, 30], 2, day=TODAY // 2))
def test_any_wrong_verdict_in_a_suite_is_rarer_than_the_level(twin, varied, wrong, twins):
    generator = np.random.default_rng([1, round(10 * twin), twins])
    asked = questions(30, twins=twins)
    alarms = 0
    for _ in range(60):
        found = decided(asked, drawn(asked, {"t": twin, "v": varied}, generator))
        alarms += any(a.verdict in wrong for a in found.answers)
    assert alarms <= 3 + 3  # the level, and two standard deviations of so few suites; the documentation has 2,000


def test_each_question_alone_keeps_the_level_but_a_suite_of_them_does_not():
    generator = np.random.default_rng(2)
    asked = questions(30, twins=30)
    suites = [drawn(asked, {"t": 0.5, "v": 0.5}, generator) for _ in range(20)]
    drops = [[decided([q], suite).count(Verdict.DROP) for q in asked] for suite in suites]
    assert np.mean(drops) <= 0.05
    assert np.mean(np.any(drops, axis=1)) > 0.2, "so the correction is needed"


def test_verdicts_that_are_clear_take_the_first_rounds_and_are_right():
    generator = np.random.default_rng(4)
    asked = questions(60, twins=27)
    lost = {q.condition for q in asked[::4]}
    outcomes = drawn(asked, {"t": 1.0, "v": 1.0}, generator) | {name: [False] * 20 for name in lost}
    found = decided(asked, outcomes)
    assert {a.question.condition for a in found.answers if a.verdict is Verdict.DROP} == lost
    assert found.count(Verdict.NO_DROP) == 45
    assert max(a.pairs for a in found.answers) == 7
    assert not found.waiting


# ----------------------------------------------------------------------------------------------------------- the words


@pytest.mark.parametrize(
    ("twin", "varied", "verdict"),
    [
        (True, True, Verdict.NO_DROP),
        (True, False, Verdict.DROP),
        (False, False, Verdict.NOT_LEARNED),
        (False, True, Verdict.NOT_LEARNED),
    ],
)
def test_pairs_that_are_all_alike_decide_in_the_first_round(twin, varied, verdict):
    (answer,) = decided(questions(1), {"t0": [twin] * 20, "v0": [varied] * 20}).answers
    assert (answer.verdict, answer.pairs) == (verdict, RULE.first)
    assert (answer.solved, answer.twin_solved) == (varied * RULE.first, twin * RULE.first)


def test_what_is_neither_shown_nor_excluded_stays_open_to_the_last_pair():
    found = decided(questions(1), {"t0": [False, *[True] * 19], "v0": [True, True, True, False] * 5})
    assert found.answers[0].verdict is Verdict.OPEN
    assert found.answers[0].pairs == 20
    assert not found.waiting


@pytest.mark.parametrize(
    ("arguments", "where"), [({"level": 0.0}, "level"), ({"margin": 1.0}, "margin"), ({"first": 0}, "first")]
)
def test_a_rule_that_decides_nothing_is_refused(arguments, where):
    with pytest.raises(InvalidInputError, match=f"^{where}"):
        StoppingRule(**arguments)


# -------------------------------------------------------------------------------------------------------- the schedule


def played(
    asked: list[Question], outcomes: dict[str, list[bool]], generator: np.random.Generator
) -> tuple[Counter[tuple[str, int]], Decisions]:
    """Plays what is waiting, some of it at a time and in any order, and returns what was asked for and the end."""
    known: dict[tuple[str, int], bool] = {}
    run: Counter[tuple[str, int]] = Counter()
    while True:
        found = decide(asked, SEEDS, lambda name, seed: known.get((name, seed)), rule=RULE)
        if not found.waiting:
            return run, found
        count = max(1, len(found.waiting) // 2)
        for place in generator.permutation(len(found.waiting))[:count]:
            name, seed = found.waiting[place]
            known[name, seed] = outcomes[name][seed]
            run[name, seed] += 1


@pytest.mark.parametrize("rate", [0.05, 0.5, 0.95])
def test_what_is_run_depends_on_the_outcomes_alone(rate):
    asked = questions(12, twins=5)
    outcomes = drawn(asked, {"t": 0.95, "v": rate}, np.random.default_rng([5, round(100 * rate)]))
    runs = [played(asked, outcomes, np.random.default_rng(seed)) for seed in range(3)]
    assert all(run == runs[0] for run in runs)
    run, found = runs[0]
    assert set(run.values()) == {1}, "no trial is run twice"
    assert found == decided(asked, outcomes)
    for answer in found.answers:
        seeds = [seed for name, seed in run if name == answer.question.condition]
        assert sorted(seeds) == list(range(answer.pairs)), "and a decided one gets no more"
        assert {seed for name, seed in run if name == answer.question.twin} >= set(seeds), "each with its twin"


def test_a_round_runs_the_same_seeds_of_all_that_are_open():
    asked = questions(3, twins=3)
    known = {(name, seed): True for seed in range(5) for name in ("v0", "t0", "v1", "t1", "v2", "t2")}
    known |= {("v2", seed): seed % 2 == 0 for seed in range(5)}
    found = decide(asked, SEEDS, lambda name, seed: known.get((name, seed)), rule=RULE)
    assert set(found.waiting) == {("v0", 5), ("t0", 5), ("v1", 5), ("t1", 5), ("v2", 5), ("t2", 5)}
    known |= dict.fromkeys(found.waiting, True)
    after = decide(asked, SEEDS, lambda name, seed: known.get((name, seed)), rule=RULE)
    assert [a.decided for a in after.answers] == [True, True, False]
    assert set(after.waiting) == {("v2", 6), ("t2", 6)}
