"""An audit says which rules so few demonstrations could not have shown, and planted rules prove what it says."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest
from tests.daily import others_slow
from tests.demonstrations.shortcuts.conftest import findings_alone
from tests.demonstrations.shortcuts.strangers import make
from tests.demonstrations.shortcuts.test_audit import facts_of

from betterbench.cli.main import main
from betterbench.demonstrations.shortcuts.examine import ALPHA, audit_dataset
from betterbench.demonstrations.shortcuts.facts import EpisodeFacts, ShownStep
from betterbench.demonstrations.shortcuts.page import audit_lines, doubt
from betterbench.demonstrations.shortcuts.prediction import predict
from betterbench.demonstrations.shortcuts.smallest import POWER, most_permutations, said_of, share_text

SETS = 40
"""Planted data sets per size."""


def planted(draw, episodes, share, *, kinds=2):
    """Return demonstrations in which a word decides the first place in a share of them, and chance in the others."""
    words = np.arange(episodes) % kinds
    places = words.copy()
    free = draw.permutation(episodes)[: episodes - round(share * episodes)]
    places[free] = draw.permutation(places[free])
    return [
        EpisodeFacts(str(i), "stranger", f"put {'abcdef'[w]}{w} away", (ShownStep("", "", f"place {p}", "there"),))
        for i, (w, p) in enumerate(zip(words.tolist(), places.tolist(), strict=True))
    ]


def found(facts):
    with findings_alone():
        (group,) = audit_dataset("planted", facts).groups
    return any(f.verdict == "shortcut" for f in group.of("words_first_place"))


def smallest(facts, question="words_first_place"):
    (group,) = audit_dataset("planted", facts).groups
    return next(rule for rule in group.smallest if rule.question == question)


@pytest.mark.parametrize(("episodes", "kinds"), others_slow([(12, 2), (60, 4), (30, 3), (20, 2)], 4))
def test_a_rule_of_the_stated_size_is_found_and_a_much_weaker_one_mostly_not(episodes, kinds):
    draw = np.random.default_rng(episodes)
    share = smallest(planted(draw, episodes, 1.0, kinds=kinds)).least_share
    assert share is not None
    strong = sum(found(planted(draw, episodes, share, kinds=kinds)) for _ in range(SETS)) / SETS
    weak = sum(found(planted(draw, episodes, 0.5 * share, kinds=kinds)) for _ in range(SETS)) / SETS
    assert strong >= POWER - 0.15, "2.4 standard errors of so many sets"
    assert weak < 0.3


def test_a_task_of_few_demonstrations_says_less_than_one_of_many():
    audits = (audit_dataset("planted", facts_of("training", ["fast_food"], demos)) for demos in (8, 120))
    few, many = ({rule.question: rule for rule in audit.groups[0].smallest} for audit in audits)
    for question in ("thing_place", "order", "first_step", "word_place"):
        assert many[question].least_share is not None, question
        least = few[question].least_share
        assert least is None or least >= many[question].least_share, question
        assert few[question].n < many[question].n, question


def test_eight_demonstrations_cannot_show_an_order_and_say_so():
    facts = facts_of("training", ["fast_food"], 8)
    audit = audit_dataset("few", facts)
    rule = next(r for r in audit.groups[0].smallest if r.question == "order")
    assert rule.least_share is None, "2 of 2^8 exchanges are as clear as a rule without an exception, in 4 tests"
    assert (
        rule.sentence
        == "order of two objects: with 8 demonstrations, not even a rule without exceptions would be found"
    )
    assert audit.groups[0].of("order")[0].verdict == "none", "although it is always the same"
    text = "\n".join(audit_lines(audit))
    assert f"| order of two objects | 8 demonstrations | {share_text(None)} |" in text
    form = json.loads(json.dumps(audit.to_json()))
    stored = next(r for r in form["groups"][0]["smallest"] if r["question"] == "order")
    assert (stored["least_share"], stored["n"], form["power"]) == (None, 8, POWER)


def test_only_a_rule_without_an_exception_is_found_in_very_few_and_none_in_fewer():
    draw = np.random.default_rng(0)
    rule = smallest(planted(draw, 9, 1.0))
    assert rule.least_share == 1.0
    assert rule.sentence.endswith("with 9 demonstrations, only a rule without exceptions would be found")
    assert found(planted(draw, 9, 1.0))
    assert smallest(planted(draw, 8, 1.0)).least_share is None
    assert not found(planted(draw, 8, 1.0))


@pytest.mark.parametrize("tests", [1, 3, 20, 499, 500, 501, 10_000])
def test_the_threshold_is_that_of_the_corrected_test(tests):
    most = most_permutations(ALPHA, tests)
    assert most < 0 or round((1 + most) / 10_000 * tests, 6) <= ALPHA
    assert round((2 + most) / 10_000 * tests, 6) > ALPHA


def test_the_command_says_what_it_could_not_have_shown(tmp_path, capsys):
    """On a stranger's set: in the terminal, in shortcuts.md and in the JSON document."""
    path = make(tmp_path / "set", "plain", "clean", count=16)
    assert main(["shortcuts", str(path), "--out", str(tmp_path / "audit")]) == 0
    assert "smallest detectable rule, as a fraction of the demonstrations:" in capsys.readouterr().out
    assert "smallest rule that would be found |" in (tmp_path / "audit" / "shortcuts.md").read_text()
    stored = json.loads((tmp_path / "audit" / "shortcuts.json").read_text())
    assert all(rule["sentence"] and "least_share" in rule for group in stored["groups"] for rule in group["smallest"])


def test_variations_without_risk_are_not_called_safe_by_a_small_set():
    for demos, unsure in ((8, True), (120, False)):
        audit = audit_dataset("few", facts_of("training", ["desk_meeting"], demos))
        said = doubt(audit, predict(audit))
        assert bool(said) is unsure, said
        assert not unsure or "may still be at risk: for 7 of 14 questions" in said


def test_every_size_has_its_words():
    assert said_of(0.85, "20 demonstrations").endswith("a rule would be found if it decides at least 85 % of them")
    assert Counter(map(share_text, (None, 1.0))) == Counter(["none, however strong", "100 %"])
