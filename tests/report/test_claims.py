"""A headline claims what its own test shows, and one report has one number for each rate and gap."""

from __future__ import annotations

import csv
import io
import itertools
import re
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from factory import diagnosis, trial

from betterbench.cli.verbs.evaluate import TrialOptions
from betterbench.diagnosis import Label
from betterbench.report.claims import DESCRIBED, claim_of_habit, claim_of_weak_training
from betterbench.report.headline import NOTHING_YET, headline_of, verdict_line
from betterbench.report.pages.page import write_report
from betterbench.report.tables.exports import exports_of
from betterbench.report.wording import Figure
from betterbench.statistics import PairedTable, Rate, mcnemar_p

SLIP, RULE, HALT = Label.EXECUTION_FAILURE, Label.LEXICAL_KINEMATIC_SHORTCUT, Label.EARLY_HALT


def trained(seeds, label=Label.SUCCESS, **changes):
    return [trial(variation=None, seed=s, label=label, **changes) for s in seeds]


def varied(seeds, label=Label.SUCCESS, **changes):
    return [trial(seed=s, label=label, **changes) for s in seeds]


def lost(count, n=48, *, twins=0, label=RULE):
    """Return a run of n pairs: the variation fails in ``count`` of them, and the twin in ``twins`` other ones."""
    trials = [*varied(range(count), label), *varied(range(count, n))]
    return diagnosis([*trials, *trained(range(n - twins)), *trained(range(n - twins, n), label)])


@pytest.mark.parametrize("count", range(3, 12))
def test_a_claim_begins_where_the_test_of_the_gap_does(count):
    run = lost(count)
    p = mcnemar_p(PairedTable(48 - count, count, 0, 0))
    headline = headline_of(run)
    assert headline.claim.supported is (p <= 0.05), (count, p)
    assert headline.conclusion.startswith(NOTHING_YET) is (p > 0.05)
    assert ("words to motions" in headline.conclusion) is (p <= 0.05)
    assert (headline.family == "reasoning") is (p <= 0.05)
    assert bool(headline.claim.deciding) is (p > 0.05)
    if p > 0.05:
        assert f"{count} of 48 variation trials failed" in headline.conclusion
        assert "p = " in headline.conclusion
        assert headline.claim.p_value == pytest.approx(p)


def test_the_case_of_the_issue_claims_nothing():
    """4 of 48, an interval over zero, p = 0.13."""
    headline = headline_of(lost(4))
    assert headline.conclusion.startswith(
        "Nothing to conclude yet: 4 of 48 variation trials failed, and an illusion gap"
    )
    assert "p = 0.13" in headline.conclusion
    assert headline.claim.deciding.startswith("If the failure rate stays the same, it can be decided with")
    assert headline.claim.command.startswith("better eval --policy ")


def test_the_advised_run_has_the_settings_of_the_run():
    usual = {"action_space": "ee_delta", "camera_preset": "default", "render_quality": "standard", "looks": "seen"}
    versions = lost(4).versions
    blind = {"camera_preset": "None", "render_quality": "None", "looks": "seen | unseen"}
    for settings in (usual, blind):
        command = headline_of(replace(lost(4), versions={**versions, **settings})).claim.command
        assert not any(f"--{word}" in command for word in ("action-space", "observation", "quality", "looks")), command
    other = {"action_space": "joint_abs", "camera_preset": "official", "render_quality": "high", "looks": "unseen"}
    command = headline_of(replace(lost(4), versions={**versions, **other})).claim.command
    assert "--action-space joint_abs --observation official --quality high --looks unseen --seed" in command


@pytest.mark.parametrize("twins", [4, 8])
def test_failures_as_frequent_in_training_are_no_claim_about_variations(twins):
    assert headline_of(lost(8, twins=twins)).conclusion.startswith(NOTHING_YET)


def test_failures_of_most_trials_are_called_what_the_policy_does_in_training_too():
    run = lost(30, twins=18, label=SLIP)
    assert "It goes for the correct objects" in headline_of(run).conclusion


@pytest.mark.parametrize(
    ("count", "n", "claims"), [(1, 1, False), (2, 3, False), (3, 3, True), (5, 10, True), (4, 10, False)]
)
def test_without_twins_more_than_a_fifth_has_to_fail(count, n, claims):
    run = diagnosis([*varied(range(count), RULE), *varied(range(count, n))])
    headline = headline_of(run)
    assert headline.conclusion.startswith(NOTHING_YET) is not claims
    assert claims or "no training twins" in headline.conclusion


@pytest.mark.parametrize(
    ("k", "n", "weak"), [(0, 5, False), (0, 6, True), (4, 20, True), (6, 20, False), (10, 20, False)]
)
def test_not_learned_is_said_where_training_is_surely_below_one_half(k, n, weak):
    assert claim_of_weak_training(Figure.of_rate(Rate(k, n))).supported is weak
    trials = [*varied(range(n), RULE), *trained(range(k)), *trained(range(k, n), RULE)]
    text = headline_of(diagnosis(trials)).conclusion
    assert ("has not learned the training conditions" in text) is weak
    assert weak or k * 2 >= n or f"It solved {k}/{n} training trials." in text


def test_a_habit_is_corrected_for_the_conditions_that_were_looked_at():
    assert claim_of_habit(3, 3, 5).supported
    assert not claim_of_habit(3, 3, 10).supported
    assert claim_of_habit(4, 4, 10).supported


def test_what_was_only_counted_needs_no_test():
    assert headline_of(diagnosis([*varied(range(40)), *varied([40], RULE)])).claim == DESCRIBED


def test_what_would_decide_is_a_command_that_names_the_variation_new_seeds_and_enough_trials():
    run = replace(lost(4), address="openpi://localhost:8000")
    text, command = headline_of(run).claim.deciding, headline_of(run).claim.command
    assert "fast_food/T1" in text
    words = shlex.split(command)
    assert words[:2] == ["better", "eval"]
    option = dict(itertools.pairwise(words))
    assert option["--policy"] == "openpi://localhost:8000"
    assert (option["--tasks"], option["--variations"], option["--seed"]) == ("fast_food", "T1", "48")
    assert 5 <= int(option["--trials"]) <= 100
    assert {"tasks", "variations", "seed", "trials"} <= set(TrialOptions.__dataclass_fields__)


def test_the_command_names_the_address_of_a_policy_whatever_it_is_called():
    called = "pi0 'of today'; touch CANARY #\x1b[2J\u202e"
    runs = [
        lost(4),
        diagnosis(varied(range(2))),
        diagnosis(trained(range(9))),
        diagnosis([*trained(range(3)), *trained(range(3, 7), SLIP), *varied(range(7))]),
    ]
    commands = [headline_of(replace(run, address="openpi://h:1").named(called)).claim.command for run in runs]
    assert all(commands)
    for command in commands:
        assert shlex.split(command)[:4] == ["better", "eval", "--policy", "openpi://h:1"]
    unsayable = replace(runs[0], address="openpi://h:1\0")
    assert headline_of(unsayable).claim.command == ""


@pytest.mark.parametrize(("count", "n"), [(1, 2), (2, 6), (1, 5), (4, 48)])
def test_as_many_pairs_as_are_advised_show_the_drop_in_four_runs_of_five(count, n):
    deciding = headline_of(lost(count, n)).claim.deciding
    number = int(re.search(r"failure rate stays the same, it can be decided with (\d+) pairs", deciding).group(1))
    draw = np.random.default_rng(n)
    runs = draw.binomial(number, count / n, 2000)
    assert np.mean([mcnemar_p(PairedTable(number - k, k, 0, 0)) <= 0.05 for k in runs.tolist()]) > 0.77
    fewer = draw.binomial(number // 2, count / n, 2000)
    assert np.mean([mcnemar_p(PairedTable(number // 2 - k, k, 0, 0)) <= 0.05 for k in fewer.tolist()]) < 0.7


def uneven():
    """Return a run whose training trials, twins and variations have three rates: one twin serves three variations."""
    trials = [*trained(range(6)), *trained(range(6, 10), SLIP), *trained(range(10), SLIP, condition="train2")]
    trials += [*varied(range(6), RULE, variation="T1"), *varied(range(6, 8), variation="T1")]
    for name in ("L1", "O1"):
        trials += varied(range(6), variation=name, axis="spatial_layout_shift")
    return diagnosis(trials)


def numbers(text):
    return [float(n.replace("−", "-")) for n in re.findall(r"[−-]?\d+(?:\.\d+)?", text)]


def test_a_gap_is_the_difference_of_the_two_numbers_beside_it():
    run = uneven()
    for scope in ("overall", "fast_food", "axis:spatial_layout_shift", "fast_food/T1"):
        gap = Figure.gap(run, scope)
        twins, paired = numbers(gap.from_sides())
        assert round(twins - paired, 2) == numbers(gap.number())[0], scope
        assert gap.sides[0].n == gap.sides[1].n == gap.n
    sentence = next(s for s in headline_of(run).sentences if s.startswith("Solves"))
    pairs, twins, varied_, points = numbers(sentence.replace("\N{NARROW NO-BREAK SPACE}", " ").partition(". In ")[2])[
        :4
    ]
    assert round(twins - varied_, 2) == points
    assert pairs == 20


def test_each_training_rate_says_which_trials_it_counts(tmp_path):
    run = uneven()
    headline = headline_of(run)
    assert headline.training.count() == "6/20"
    assert headline.twins_differ
    page = write_report([run], tmp_path).read_text(encoding="utf-8")
    assert "Success in all training trials" in page
    assert ">Training success<" not in page
    assert "one per pair" in page
    twins = run.metric("twin_success_rate", "overall")
    assert (twins.k, twins.n) == (18, 20)
    assert f"{twins.k}/{twins.n}" in page
    same = write_report([lost(10)], tmp_path / "same").read_text(encoding="utf-8")
    assert "Success in all training trials" not in same


def test_terminal_page_tables_and_json_hold_the_same_rates(tmp_path):
    run = uneven()
    twins, gap = run.metric("twin_success_rate", "fast_food"), run.metric("illusion_gap", "fast_food")
    paired = run.metric("paired_success_rate", "fast_food")
    assert twins.value - paired.value == pytest.approx(gap.value)
    tasks = next(e for e in exports_of([run], ()) if e.name == "tasks")
    (row,) = csv.DictReader(io.StringIO(tasks.csv))
    assert (int(row["training_k"]), int(row["training_n"])) == (twins.k, twins.n)
    assert float(row["training_success_rate"]) - float(row["paired_success_rate"]) == pytest.approx(gap.value)
    assert {m.name for m in run.metrics} >= {"twin_success_rate", "paired_success_rate", "illusion_gap"}
    form = next(m for m in run.to_json()["metrics"] if (m["name"], m["scope"]) == ("twin_success_rate", "fast_food"))
    assert form["k"] == twins.k
    assert headline_of(run).to_json()["conclusion"].rstrip(".") in verdict_line(run) or "(" in verdict_line(run)


def test_a_twin_of_many_variations_does_not_narrow_its_interval():
    once = diagnosis([*varied(range(8)), *trained(range(6)), *trained([6, 7], SLIP)])
    often = diagnosis(
        [*(t for name in ("T1", "L1", "O1", "R1") for t in varied(range(8), variation=name)),
         *trained(range(6)), *trained([6, 7], SLIP)]
    )  # fmt: skip
    for scope in ("overall",):
        a, b = once.metric("twin_success_rate", scope), often.metric("twin_success_rate", scope)
        assert (a.n, b.n) == (8, 32)
        assert (a.low, a.high) == pytest.approx((b.low, b.high))


def test_a_twin_that_has_not_ended_is_in_no_pair_of_any_number():
    trials = [*varied(range(8), RULE), *trained(range(6)), *trained([6, 7], Label.UNFINISHED)]
    run = diagnosis(trials)
    gap = Figure.gap(run, "overall")
    assert (gap.n, gap.sides[0].n) == (6, 6)
    assert run.metric("twin_success_rate", "fast_food/T1").n == 6
