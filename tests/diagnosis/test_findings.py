"""Findings: their counts, and what these show."""

import pytest
from tests.report.factory import trial

from betterbench.diagnosis import Label
from betterbench.diagnosis.findings import find_findings
from betterbench.diagnosis.second_pass import PolicyRule, TaskRules


@pytest.mark.parametrize(("elsewhere", "shown"), [((3, 3), False), ((0, 1), False), ((0, 12), True), ((12, 12), False)])
def test_a_finding_says_whether_its_counts_show_the_rule(elsewhere, shown):
    rule = PolicyRule("word", 1.0, 1.0, 3, 3, *elsewhere)
    rules = TaskRules((rule,), 2.0, ("word",), {}, 0)
    trials = [trial("morning_coffee", "L3", seed=s, label=Label.LEXICAL_KINEMATIC_SHORTCUT) for s in range(3)]
    (text,) = find_findings(trials, {"morning_coffee": rules})
    assert f"followed in 3/3 trials in which the rule is wrong, against {elsewhere[0]}/{elsewhere[1]} errors" in text
    assert ("do not show that it follows this rule" in text) is not shown
