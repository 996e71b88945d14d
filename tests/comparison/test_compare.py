"""A comparison: pairs by trial, tests by hand, corrected, put in words, and honest about what it cannot tell."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from tests.diagnosis.small_matrix import matrix

from betterbench.cli.output.comparison import print_comparison
from betterbench.comparison import compare, match_sides, name_sides
from betterbench.diagnosis import Label
from betterbench.diagnosis.measures import standing
from betterbench.errors import InvalidInputError, RunConflictError
from betterbench.statistics import PairedTable, Rate, boschloo_p, holm, mcnemar_p, smallest_paired_difference
from betterbench.tasks import all_labels

L1 = ("fast_food", "L1")
SHORTCUT, MISSED = Label.LEXICAL_KINEMATIC_SHORTCUT, Label.EXECUTION_FAILURE


def failing(label, *seeds):
    return dict.fromkeys(seeds, label)


def test_success_is_compared_pair_by_pair(two):
    found = compare(two)
    overall = found.group("success")
    contrast = overall.contrasts[0]
    assert contrast.table == PairedTable(27, 12, 1, 0)
    assert (contrast.first_rate, contrast.second_rate) == (Rate(39, 40), Rate(28, 40))
    assert contrast.p_value == contrast.p_adjusted == mcnemar_p(PairedTable(27, 12, 1, 0))
    assert contrast.difference.value == pytest.approx(11 / 40)
    assert contrast.different
    assert contrast.higher == "good"
    assert overall.letters == ("a", "b")
    assert found.group("success", "training").contrasts[0].table == PairedTable(19, 1, 0, 0)
    assert found.verdict[0].startswith(
        "good is better than bad: it succeeds in 39/40 (97.5 %) of the trials of variations, bad in 28/40 (70.0 %)."
    )
    assert "27.5 points" in found.verdict[0]
    assert "40 pairs" in found.verdict[0]
    assert "lexical_kinematic_shortcut (bad more, 0/40 to 12/40)" in found.verdict[1]


def test_families_are_corrected_together(two):
    found = compare(two)
    axes = [g for g in found.groups if g.scope.startswith("axis:")]
    assert [g.scope for g in axes] == ["axis:spatial_layout_shift", "axis:primitive_recomposition"]
    raw = [mcnemar_p(PairedTable(8, 12, 0, 0)), mcnemar_p(PairedTable(19, 0, 1, 0))]
    assert [g.contrasts[0].p_value for g in axes] == pytest.approx(raw)
    assert [g.contrasts[0].p_adjusted for g in axes] == pytest.approx(holm(raw))
    assert all(g.contrasts[0].family == 2 for g in axes)
    kinds = [g for g in found.groups if g.measure in ("reasoning", "execution", "system")]
    assert [g.contrasts[0].family for g in kinds] == [3, 3, 3]
    labels = [g.measure for g in found.groups if g.measure in {x.value for x in all_labels() if x is not Label.SUCCESS}]
    assert labels == ["lexical_kinematic_shortcut", "execution_failure"]  # on variations; nobody shows another one


def test_undecided_is_said_with_what_the_trials_could_have_shown(side):
    found = compare([side("one", {L1: failing(MISSED, 1, 2)}), side("two", {L1: failing(MISSED, 3)})])
    contrast = found.group("success").contrasts[0]
    expected = smallest_paired_difference(40, opposite=0.03)  # 1 of 40, in whole percents
    assert contrast.smallest == expected
    assert not contrast.different
    assert found.group("success").letters == ("a", "a")
    text = found.verdict[0]
    assert text.startswith("Nothing can be concluded about which of one and two is better on the trials of variations")
    assert f"a true difference must be {100 * expected.value:.1f} points" in text
    assert "1/40 (2.5 %) point in the other direction" in text
    assert len(found.verdict) == 1


def test_too_few_pairs_can_show_nothing(side):
    few = {"seeds": range(2), "conditions": (L1,)}
    found = compare([side("one", {L1: failing(MISSED, 0, 1)}, **few), side("two", {}, **few)])
    assert "no difference can be detected" in found.verdict[0]


def test_one_pair_is_not_called_pairs(side):
    single = {"seeds": range(1), "conditions": (L1,)}
    text = compare([side("one", {}, **single), side("two", {}, **single)]).verdict[0]
    assert "1 pair" in text
    assert "1 pairs" not in text


def test_the_order_of_the_sides_only_turns_the_sign(two):
    there, back = compare(two), compare(two[::-1])
    for group in there.groups:
        a, b = group.contrasts[0], back.group(group.measure, group.scope).contrasts[0]
        assert a.difference.value == pytest.approx(-b.difference.value)
        assert (a.difference.low, a.difference.high) == pytest.approx((-b.difference.high, -b.difference.low), abs=0.02)
        assert a.p_adjusted == pytest.approx(b.p_adjusted)
    assert there.verdict[0].split(".")[0] == back.verdict[0].split(".")[0]


def test_a_test_and_an_interval_that_disagree_conclude_nothing(side):
    # Six variations of one seed share one twin: 6 pairs against 0 are one scene, whose cluster may be drawn or not.
    names = tuple(("fast_food", v) for v in ("L1", "R1", "R2", "O1", "T1", "T2"))
    spoilt = {name: failing(MISSED, 0) for name in names}
    found = compare([side("one", {}, conditions=names), side("two", spoilt, conditions=names)])
    contrast = found.group("success").contrasts[0]
    assert contrast.p_adjusted == pytest.approx(2 / 64)
    assert contrast.difference.low <= 0.0
    assert not contrast.different


def test_letters_of_three_policies(side):
    best = side("best", {})
    middle = side("middle", {L1: failing(MISSED, *range(5))})
    worst = side("worst", {L1: failing(SHORTCUT, *range(5, 17))})
    found = compare([worst, best, middle])
    group = found.group("success")
    assert len(group.contrasts) == 3
    assert all(c.family == 3 for c in group.contrasts)
    apart = {(c.first, c.second): c.different for c in group.contrasts}
    assert apart == {("worst", "best"): True, ("worst", "middle"): False, ("best", "middle"): False}
    assert group.letters == ("b", "a", "ab")
    needed = 100 * max(c.smallest.value for c in group.contrasts if not c.different)
    assert found.verdict[0] == (
        "Variations: best 40/40 (100.0 %) a, middle 35/40 (87.5 %) ab, worst 28/40 (70.0 %) b. "
        "Policies that share a letter do not differ significantly. "
        f"To be detected at 80 % power, a true difference must be up to {needed:.1f} points."
    )
    assert len(found.verdict) > 1
    many = compare([worst, best, middle, side("fourth", {})])
    assert len(many.verdict) == 1  # letters say it shorter


def test_only_shared_trials_count_and_the_rest_is_counted(side):
    one = side("one", {}, seeds=range(10))
    two = side("two", {L1: failing(MISSED, *range(10, 20))}, conditions=(L1, ("morning_coffee", "L1")))
    found = compare([one, two])
    assert found.group("success").rates == (Rate(10, 10), Rate(10, 10))
    assert found.matching.left_out == (20, 30)
    assert "20 of 30 trials of one are left out: the other run does not plan them." in found.notes
    assert "30 of 40 trials of two are left out: the other run does not plan them." in found.notes
    assert found.group("success", "training") is None
    assert [t.key for t in found.matching.trials[0]] == [t.key for t in found.matching.trials[1]]


def test_broken_trials_stay_in_the_denominator_and_are_named(side):
    whole = side("whole", {})
    broken = side("broken", {L1: failing(Label.POLICY_ERROR, 0, 1, 2)})
    broken = replace(broken, unfinished=frozenset({"fast_food/L1/2"}))
    found = compare([whole, broken])
    assert found.group("success").rates[1] == Rate(37, 40)
    assert found.group("system").rates[1] == Rate(3, 40)
    assert any(note.startswith("1/60 trials of broken are not finished") for note in found.notes)
    assert any(note.startswith("2/60 trials of broken have no record because of an error") for note in found.notes)
    run = found.to_json()["runs"][1]
    assert (run["compared"], run["unfinished"], run["without_record"]) == (60, 1, 3)


def test_without_shared_seeds_the_trials_are_independent(side):
    one = side("one", {L1: failing(MISSED, 0)}, seeds=range(20))
    two = side("two", {L1: failing(SHORTCUT, *range(20, 32))}, seeds=range(20, 40))
    found = compare([one, two])
    contrast = found.group("success").contrasts[0]
    assert not found.matching.paired
    assert contrast.test == "Boschloo"
    assert contrast.table is None
    assert contrast.p_value == pytest.approx(boschloo_p(Rate(39, 40), Rate(28, 40)))
    assert any("share no seed" in note for note in found.notes)
    assert "40 trials a side" in found.verdict[0]
    with pytest.raises(InvalidInputError, match="--sequential"):
        compare([one, two], sequential=True)
    third = side("third", {}, seeds=range(20))
    assert any("These pairs of runs share trials: one and third." in n for n in compare([one, two, third]).notes)


def test_runs_without_a_common_condition_are_refused(side):
    with pytest.raises(InvalidInputError, match="have no condition in common"):
        compare([side("one", {}, conditions=(L1,)), side("two", {}, conditions=(("fast_food", "R1"),))])


@pytest.mark.parametrize("name", ["suite_version", "engine:mujoco", "task_version:fast_food"])
def test_other_versions_and_engines_are_refused_unless_allowed(two, name):
    good, bad = two
    bad = replace(bad, conventions={**bad.conventions, name: "9"})
    with pytest.raises(RunConflictError, match=f"{name} differs: .* in good, '9' in bad"):
        compare([good, bad])
    assert any(note.startswith(f"{name} differs") for note in compare([good, bad], allow_mixed=True).notes)


def test_other_conventions_are_noted(two):
    good, bad = two
    bad = replace(bad, conventions={**bad.conventions, "package_version": "2", "camera_preset": "official"})
    good = replace(good, conventions={**good.conventions, "camera_preset": "None"})
    notes = match_sides([good, bad]).notes
    assert "package_version differs: '1' in good, '2' in bad." in notes
    assert not any("camera_preset" in note for note in notes)  # one of them looked at no image


def test_sequential_evidence_is_that_of_the_pairs_in_the_order_of_the_run(side):
    one = side("one", {})
    two = side("two", {L1: failing(SHORTCUT, *range(12))})
    found = compare([one, two], sequential=True).sequential[0]
    assert (found.process.n, found.planned) == (40, 40)
    assert found.table == PairedTable(28, 12, 0, 0)
    # Seed by seed L1 and R1: the discordant pairs are 1, 3, 5, ...; seven one-sided ones reach 20.
    assert found.process.decided_at == 13
    assert found.different
    text = compare([one, two], sequential=True).verdict[0]
    assert text.startswith("Decided after 13 pairs, valid for any number of inspections: one is better than two")


def test_sequential_evidence_stops_at_the_first_unfinished_pair(side):
    one = side("one", {})
    two = side("two", {L1: failing(SHORTCUT, *range(12))})
    waiting = replace(two, unfinished=frozenset({"fast_food/R1/4", "fast_food/L1/9"}))
    found = compare([one, waiting], sequential=True)
    assert found.sequential[0].process.n == 9  # seeds 0 to 3 twice, and L1 of seed 4
    assert not found.sequential[0].different
    assert "31 of 40 pairs are left to run" in found.verdict[0]
    assert compare([waiting, one], sequential=True).sequential[0].process.n == 9


def test_sequential_contrasts_of_many_policies_are_corrected(side):
    sides = [side("a", {}), side("b", {L1: failing(SHORTCUT, *range(7))}), side("c", {})]
    found = {(s.first, s.second): s for s in compare(sides, sequential=True).sequential}
    assert found["a", "b"].process.p_value <= 0.05 < found["a", "b"].p_adjusted
    assert found["a", "b"].process.alpha == pytest.approx(0.05 / 3)
    assert not any(s.different for s in found.values())


def test_the_json_form_is_plain_json(two):
    form = json.loads(json.dumps(compare(two, sequential=True).to_json(), allow_nan=False))
    assert form["paired"] is True
    group = next(g for g in form["groups"] if (g["measure"], g["scope"]) == ("success", "overall"))
    assert [(s["name"], s["rate"]["k"], s["rate"]["n"], s["letters"]) for s in group["sides"]] == [
        ("good", 39, 40, "a"),
        ("bad", 28, 40, "b"),
    ]
    contrast = group["contrasts"][0]
    assert contrast["table"] == {"both": 27, "only_first": 12, "only_second": 1, "neither": 0}
    assert {"value", "low", "high"} <= set(contrast["difference"])
    assert form["sequential"][0]["e_value"] > 20
    assert all(
        {"p_value", "p_adjusted", "family", "different"} <= set(c) for g in form["groups"] for c in g["contrasts"]
    )


def test_runs_of_one_policy_are_told_apart_by_their_folder(two):
    good, bad = two
    alike = replace(bad, diagnosis=good.diagnosis)
    assert [s.name for s in name_sides([good, alike])] == ["good (good)", "good (bad)"]
    assert [s.name for s in name_sides([good, bad])] == ["good", "bad"]
    assert [s.name for s in name_sides([good, replace(alike, path="old/good")])] == ["good (good) #1", "good (good) #2"]


@pytest.mark.parametrize("alpha", [0.0, 1.0, 5.0, float("nan")])
def test_an_impossible_level_is_refused(two, alpha):
    with pytest.raises(InvalidInputError, match="--alpha"):
        compare(two, alpha=alpha)


def test_one_run_is_not_enough(two):
    with pytest.raises(InvalidInputError, match="at least two"):
        compare(two[:1])


def test_each_policy_stands_among_the_pretenders_on_the_compared_trials(side, monkeypatch, capsys):
    monkeypatch.setattr(standing, "power_matrix_of", lambda _tasks: matrix())
    shortcut = side("shortcut", {("fast_food", "L1"): failing(SHORTCUT, *range(20))})
    right = side("right", {})
    found = compare([shortcut, right])
    first, second = found.standings
    assert first.nearest is not None
    assert first.nearest.pretender == "zoo:lexical"
    assert first.scores == {"overall": 0.5, "axis:spatial_layout_shift": 0.0, "axis:primitive_recomposition": 1.0}
    assert second.expert is not None
    assert second.expert.agreement == 1.0
    assert found.to_json()["power"][0]["nearest_pretender"]["pretender"] == "zoo:lexical"
    print_comparison(found)
    text = " ".join(capsys.readouterr().out.split())
    assert "pretenders: success, %" in text
    assert "shortcut: Nearest pretender: zoo:lexical" in text


def test_without_a_matrix_a_comparison_says_so_and_goes_on(side, monkeypatch, capsys):
    monkeypatch.setattr(standing, "power_matrix_of", lambda _tasks: None)
    print_comparison(compare([side("one", {}), side("two", {})]))
    assert " ".join(capsys.readouterr().out.split()).count("better calibrate --power") == 1
