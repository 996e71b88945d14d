"""Rules of two words, of whole instructions and of orders are found, and what words mean is no shortcut."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from tests.daily import others_slow, part_of_today
from tests.demonstrations.shortcuts.strangers import TOGETHER, make
from tests.demonstrations.shortcuts.test_audit import facts_of
from tests.looping import each

from betterbench.cli.main import main
from betterbench.demonstrations.shortcuts.examine import audit_dataset
from betterbench.demonstrations.shortcuts.facts import EpisodeFacts, ShownStep
from betterbench.demonstrations.shortcuts.instructions import share_told, whole_test
from betterbench.demonstrations.shortcuts.lerobot import read_lerobot
from betterbench.demonstrations.shortcuts.page import audit_lines
from betterbench.demonstrations.shortcuts.pairs import telling_pairs
from betterbench.demonstrations.shortcuts.words import names_a_place, places_named

CLEAN_SEEDS = range(10)


def audited(path):
    (group,) = audit_dataset("set", read_lerobot(path).facts).groups
    return group


SEEDS = range(3)
SEVERAL_WORDS = [
    (p, n, noise) for n, noise in ((60, 0.0), (90, 0.1), (120, 0.2)) for p in TOGETHER if (p, n) != ("three", 60)
]


@pytest.mark.usefixtures("only_findings")
@each("planted, count, noise", part_of_today(SEVERAL_WORDS, 2))
def test_rules_of_several_words_are_found_in_strangers_sets(tmp_path_factory, planted, count, noise):
    """Where chance decides a share of the episodes, half of these still go by the rule; another seed each day."""
    find_rules(tmp_path_factory, planted, count, noise, part_of_today(SEEDS, 3))


@pytest.mark.usefixtures("only_findings")
@pytest.mark.slow
@each("planted, count, noise", SEVERAL_WORDS)
def test_rules_of_several_words_are_found_with_every_seed(tmp_path_factory, planted, count, noise):
    find_rules(tmp_path_factory, planted, count, noise, SEEDS)


def find_rules(tmp_path_factory, planted, count, noise, seeds):
    for seed in seeds:
        path = make(tmp_path_factory.mktemp("set") / "set", "plain", planted, seed=seed, count=count, noise=noise)
        asked = {finding.question for finding in audited(path).shortcuts}
        assert {name for name in asked if name.startswith("words_first_place")}, (seed, asked)
        assert planted != "order" or {name for name in asked if name.startswith("words_order")}, (seed, asked)
        assert not {name for name in asked if not name.startswith(("words_first_place", "words_order"))}, (seed, asked)


@pytest.mark.usefixtures("only_findings")
@pytest.mark.parametrize(
    "seeds", [part_of_today(CLEAN_SEEDS, 5), pytest.param(CLEAN_SEEDS, marks=pytest.mark.slow)], ids=len
)
def test_clean_sets_are_clean(tmp_path, seeds):
    """At a level of 5 % over all questions one of 20 sets is expected to have a finding; each day a fifth has none."""
    accused = [
        (planted, count, seed)
        for planted, count in (("clean", 60), ("clean order", 120))
        for seed in seeds
        if audited(make(tmp_path / f"{planted} {seed}" / "set", "plain", planted, seed=seed, count=count)).shortcuts
    ]
    assert len(accused) <= len(seeds) // 10, accused


def placed(instruction, side, number, *, group="own set", steps=None):
    """A demonstration of our own: named objects, of which one is taken from a side."""
    taken = steps or (ShownStep("cup", "cup", side, "tray"),)
    return EpisodeFacts(str(number), group, instruction, taken, (("cup", side),))


def about_words(group):
    """The shortcuts of words; made-up facts always have one object on the table, which is another finding."""
    return [f for f in group.shortcuts if f.question != "count"]


def sayings(draw, count, said=("red", "blue"), where=("new", "old")):
    for number in range(count):
        yield number, int(draw.integers(2)), int(draw.integers(2)), said, where


@pytest.mark.usefixtures("only_findings")
@pytest.mark.parametrize(("rule", "count"), others_slow([("xor", 60), ("and", 60), ("and", 120), ("xor", 120)], 2))
def test_rules_of_two_words_are_found_in_our_own_sets(rule, count):
    for seed in range(5):
        draw, facts = np.random.default_rng(seed), []
        for number, a, b, said, where in sayings(draw, count):
            side = a ^ b if rule == "xor" else a & b
            side = side if draw.random() >= 0.1 else int(draw.integers(2))
            facts.append(placed(f"put the {said[a]} {where[b]} cup away", ("left", "right")[side], number))
        (group,) = audit_dataset("own", facts).groups
        assert {f.question for f in group.shortcuts} & {"words_first_place_together", "words_first_place_whole"}, seed


def orders(draw, count, rule):
    """Demonstrations that take an apple and a lemon, in an order that two words of the instruction decide."""
    for number, a, b, _, _ in sayings(draw, count):
        first = rule(a, b, draw) if draw.random() >= 0.1 else int(draw.integers(2))
        kinds = ("apple", "lemon") if first else ("lemon", "apple")
        slots = ("left", "right") if draw.integers(2) else ("right", "left")
        steps = tuple(ShownStep(kind, kind, slot, "box") for kind, slot in zip(kinds, slots, strict=True))
        text = f"{('please', 'now')[a]} pack the apple and the lemon {('fast', 'gently')[b]}"
        yield placed(text, slots[0], number, steps=steps)


@pytest.mark.usefixtures("only_findings")
@pytest.mark.parametrize("seeds", [part_of_today(range(5), 3), pytest.param(range(5), marks=pytest.mark.slow)], ids=len)
def test_orders_that_two_words_decide_are_found_in_our_own_sets_and_clean_ones_are_clean(seeds):
    for seed in seeds[:3]:
        draw = np.random.default_rng(seed)
        (group,) = audit_dataset("own", list(orders(draw, 80, lambda a, b, _: a ^ b))).groups
        asked = {f.question for f in group.shortcuts}
        assert {name for name in asked if name.startswith(("words_order", "words_first_object"))}, asked
        assert not {name for name in asked if "place" in name or "target" in name}
    clean = [audit_dataset("own", list(orders(np.random.default_rng(s), 80, chance))).groups[0] for s in seeds]
    assert not any(map(about_words, clean))


def chance(a, b, draw):
    del a, b
    return int(draw.integers(2))


@pytest.mark.usefixtures("only_findings")
def test_an_order_that_the_instruction_names_is_what_it_means():
    draw, facts = np.random.default_rng(0), []
    for number in range(80):
        kinds = list(draw.permutation(["apple", "lemon", "orange"])[:2])
        slots = draw.permutation(["left", "middle", "right"]).tolist()
        steps = tuple(ShownStep(str(k), str(k), s, "box") for k, s in zip(kinds, slots[:2], strict=True))
        facts.append(placed(f"pack the {kinds[0]}, then the {kinds[1]}", slots[0], number, steps=steps))
    (group,) = audit_dataset("own", facts).groups
    assert about_words(group) == []


@each("words", [("left", "right"), ("左边", "右边"), ("links", "rechts")], str)
def test_a_word_for_a_place_means_the_place_and_its_rule_is_no_shortcut(words):
    draw, facts = np.random.default_rng(1), []
    for number in range(80):
        side, color = int(draw.integers(2)), ("red", "blue")[int(draw.integers(2))]
        step = ShownStep("", "", f"place {side}", str(draw.choice(["here", "there"])))
        facts.append(EpisodeFacts(str(number), "stranger", f"take the {color} cup, {words[side]}", (step,)))
    (group,) = audit_dataset("set", facts).groups
    assert group.shortcuts == ()
    assert {f.meaning for f in group.of("words_first_place") if f.verdict == "regularity"} == {
        "words for places mean places"
    }
    assert "words for places mean places" in "\n".join(audit_lines(audit_dataset("set", facts)))


@pytest.mark.usefixtures("only_findings")
def test_a_color_that_decides_only_together_with_a_word_for_a_place_is_a_shortcut():
    for rule, (seed, count) in itertools.product(("xor", "and"), ((0, 60), (1, 90), (2, 120))):
        draw, facts = np.random.default_rng(seed), []
        for number in range(count):
            red, left = int(draw.integers(2)), int(draw.integers(2))
            side = red ^ left if rule == "xor" else red & left
            side = side if draw.random() >= 0.1 else int(draw.integers(2))
            text = f"take the {('blue', 'red')[red]} cup on the {('right', 'left')[left]}"
            step = ShownStep("", "", f"place {side}", str(draw.choice(["here", "there"])))
            facts.append(EpisodeFacts(str(number), "stranger", text, (step,)))
        (group,) = audit_dataset("set", facts).groups
        assert {f.question for f in group.shortcuts} & {"words_first_place_together", "words_first_place_whole"}, rule


@pytest.mark.usefixtures("only_findings")
def test_an_instruction_that_fixes_the_layout_of_a_task_is_a_shortcut_that_variations_break():
    """Each instruction of the balanced conditions in one layout alone; other orders have the same words."""
    kept = {}
    for facts in facts_of("balanced", ["fruit_lunch"], 144):
        kept.setdefault(facts.instruction, {}).setdefault(facts.steps[0].origin, []).append(facts)
    demonstrations = []
    for number, (text, by_place) in enumerate(sorted(kept.items())):
        origins = sorted(by_place)
        demonstrations += by_place[origins[number % len(origins)]]
        assert len(origins) == 3, text
    (group,) = audit_dataset("own", demonstrations).groups
    found = group.of("words_first_place_whole")
    told = {f.question for f in group.shortcuts}
    assert told, [(f.question, f.verdict, f.p_adjusted, f.strength) for f in found]


def test_it_is_said_what_was_tested_and_what_was_not(tmp_path, capsys):
    path = make(tmp_path / "set", "plain", "pair", count=160)
    assert main(["shortcuts", str(path), "--out", str(tmp_path / "audit")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    page = (tmp_path / "audit" / "shortcuts.md").read_text().replace("\\", "")
    for text in (printed, page):
        assert "whole instruction and first place (16 instructions)" in text
        assert "two words and first place (24 pairs of words)" in text
        assert "(objects have no names)" in text
        assert "words and order (no demonstration takes two or more)" in text
    form = json.loads((tmp_path / "audit" / "shortcuts.json").read_text())
    (group,) = form["groups"]
    asked = {question["question"]: question for question in group["asked"]}
    assert asked["words_first_place_whole"]["untested"] == ""
    assert asked["words_first_object"]["untested"] == "objects have no names"
    assert {rule["question"] for rule in group["smallest"]} == {
        name for name, question in asked.items() if not question["untested"]
    }


def test_instructions_that_are_given_once_are_not_compared_and_that_is_said():
    facts = [
        EpisodeFacts(str(i), "stranger", f"move item {i}", (ShownStep("", "", "ab"[i % 2], "there"),))
        for i in range(20)
    ]
    (group,) = audit_dataset("set", facts).groups
    reasons = {q.question: q.untested for q in group.asked}
    assert reasons["words_first_place_whole"] == "every instruction occurs once"
    assert group.of("words_first_place_whole") == ()


def test_what_single_words_tell_is_not_told_again_by_the_instruction():
    draw = np.random.default_rng(0)
    colors, verbs = draw.integers(2, size=100), draw.integers(2, size=100)
    texts = [f"{('put', 'move')[v]} {('red', 'blue')[c]}" for c, v in zip(colors, verbs, strict=True)]
    outcomes = [("left", "right")[c] for c in colors]
    known = [str(c) for c in colors]
    found = whole_test(texts, outcomes, known, draw)
    assert found is not None
    assert found.test.found.p_value < 0.001
    assert found.beyond.p_value > 0.9
    assert found.share_told <= 0.0


def test_the_share_that_an_instruction_tells_leaves_each_demonstration_out():
    assert share_told(np.array([[10, 0], [0, 10]])) == pytest.approx(1.0)
    assert share_told(np.array([[1, 0], [0, 1]])) < 0.0
    assert share_told(np.array([[5, 5], [5, 5]])) < 0.0
    assert share_told(np.array([[9, 1], [1, 9]])) == pytest.approx(0.8)


def test_pairs_are_corrected_by_holm():
    draw = np.random.default_rng(3)
    presence = draw.random((80, 4)) < 0.5
    outcome = (presence[:, 0] & presence[:, 1]).astype(np.int64)
    found = telling_pairs(presence, outcome, fewest=8)
    assert (found[0].first, found[0].second) == (0, 1)
    assert found[0].gain == pytest.approx(1.0)
    assert all(a.p_value <= b.p_value for a, b in itertools.pairwise(found))
    assert len(found) == 6


def test_words_for_places():
    assert names_a_place(("left",))
    assert names_a_place(("left", "side"))
    assert names_a_place(("左", "左边", "左边的"))
    assert not names_a_place(("left", "red"))
    assert not names_a_place(("red",))
    assert not names_a_place(("side",))
    assert places_named("First the right cube, then the LEFT one") == "right left"
