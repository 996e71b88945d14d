"""The numbers of docs/second-pass.md are those that the code finds."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from betterbench.diagnosis.ruling import Ruling
from betterbench.diagnosis.second_pass import judge_policy, pooled_prior_costs, rule_of_all_tasks
from betterbench.diagnosis.task_rules import judge_rules
from betterbench.diagnosis.trial import Choice

PAGE = (Path(__file__).parents[2] / "docs" / "second-pass.md").read_text()
EXAMPLE = " ".join(PAGE.partition("## Example")[2].partition("## Assumptions")[0].split())
MUGS = {"A": {"near": "red mug", "far": "blue mug"}, "B": {"near": "blue mug", "far": "red mug"}}
NOTHING: frozenset[str] = frozenset()


def rows(table_of: str) -> list[list[str]]:
    """Return the cells of the table of the page whose header begins with a word."""
    table = PAGE.partition(f"| {table_of} |")[2].partition("\n\n")[0].splitlines()[2:]
    return [[cell.strip(" *`") for cell in line.strip("|").split("|")] for line in table]


def coffee() -> dict[str, Choice]:
    """Makes the trials of the first table."""
    choices = {}
    for n, mugs, asked, went, right, word, _ in rows("trials"):
        things = MUGS[mugs]
        wanted = frozenset(slot for slot, kind in things.items() if kind.startswith(asked))
        assert (right == "yes") == (went in wanted)
        for _ in range(int(n)):
            choices[f"coffee/{len(choices)}"] = Choice(
                frozenset(things.items()), wanted, went, went in wanted, frozenset((word,)), NOTHING, NOTHING, 2,
                thing=things[went],
            )  # fmt: skip
    return choices


def lunch() -> dict[str, Choice]:
    """Makes the second task of the example."""
    first, second = frozenset(("first",)), frozenset(("second",))
    trained, swapped = (("first", "apple"), ("second", "orange")), (("first", "orange"), ("second", "apple"))
    right = Choice(frozenset(trained), first, "first", True, first, NOTHING, NOTHING, 2, thing="apple")
    wrong = Choice(frozenset(swapped), second, "first", False, first, NOTHING, NOTHING, 2, thing="orange")
    return {"lunch/L1": wrong, **{f"lunch/train1/{n}": right for n in range(3)}}


def test_the_table_of_hypotheses_is_what_the_code_finds():
    found = judge_rules(coffee())
    rules = {rule.name: rule for rule in found.rules}
    errors = sum(not c.correct for c in coffee().values())
    table = {row[0]: row[1:] for row in rows("hypothesis")}
    assert table.keys() == {*rules, "confusion"}
    assert float(table["confusion"][1]) == float(table["confusion"][3]) == pytest.approx(found.confusion, abs=0.005)
    for name, rule in rules.items():
        strength, misfit, price, cost, explains = table[name]
        assert float(strength) == pytest.approx(rule.strength)
        assert float(cost) == pytest.approx(rule.cost, abs=0.005)
        assert float(misfit) + float(price) == pytest.approx(rule.cost, abs=0.01)
        assert explains == f"{rule.explained} of {errors} errors"
    assert found.upheld == ("place:far",)
    place = rules["place:far"]
    assert f"{place.explained}/{place.opportunities} trials in which the rule is wrong" in EXAMPLE
    assert f"{place.errors_elsewhere}/{place.elsewhere} errors in trials in which it is right" in EXAMPLE


def test_other_tasks_decide_the_second_task_as_the_page_says():
    tasks = {"coffee": coffee(), "tea": coffee(), "lunch": lunch()}
    alone = {task: judge_rules(choices) for task, choices in tasks.items()}
    word, place = alone["lunch"].rules
    assert f"`word` costs {word.cost:.2f} and `place` {place.cost:.2f}" in EXAMPLE
    assert alone["lunch"].rulings["lunch/L1"] == Ruling("upheld")
    prior = pooled_prior_costs(list(alone.values()))
    numbers = "{place:.0f} for `place`, {word:.2f} for `word`, {confusion:.2f} for confusion and {habit:.2f}"
    assert numbers.format(**prior) in EXAMPLE
    assert prior["habit"] == prior["later"]
    assert rule_of_all_tasks(tasks, alone) == "place"
    place_in_all = sum(min(r.cost for r in found.rules if r.family == "place") for found in alone.values())
    confusion = sum(found.confusion for found in alone.values())
    assert re.search(rf"costs {place_in_all:.2f} nats, and the next best kind, confusion, {confusion:.2f}", EXAMPLE)
    found = judge_policy(tasks)["lunch"]
    assert found.rulings["lunch/L1"] == Ruling("rejected", place="upheld")
    (dearer,) = (rule.cost for rule in found.rules if rule.name == "word")
    assert f"`word` then costs 3 nats more ({dearer:.2f} in total)" in EXAMPLE


def test_ten_tasks_are_worth_about_one_attempt():
    alone = [judge_rules(coffee())] * 9 + [judge_rules(lunch())]
    assert max(pooled_prior_costs(alone).values()) == pytest.approx(3.0, abs=0.05)
