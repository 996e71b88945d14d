"""The first sentences of a report: each follows from the counts, and says where and how it fails."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from factory import diagnosis, trial

from betterbench.diagnosis import Label
from betterbench.diagnosis.modes.policy_error import without_record
from betterbench.report.headline import headline_of, verdict_line

RULE, LOOK = Label.LEXICAL_KINEMATIC_SHORTCUT, Label.SEMANTIC_FEATURE_COLLAPSE


def trained(seeds, label=Label.SUCCESS, **changes):
    return [trial(variation=None, seed=s, label=label, **changes) for s in seeds]


def varied(seeds, label=Label.SUCCESS, *, rule="", shared=(), **changes):
    made = [trial(seed=s, label=label, **changes) for s in seeds]
    return [replace(t, evidence=replace(t.evidence, rule=rule or t.evidence.rule, shared=shared)) for t in made]


def said(trials):
    return " ".join(headline_of(diagnosis(trials)).sentences)


def test_all_failures_are_not_called_most_of_them():
    headline = headline_of(diagnosis(varied(range(5), Label.EARLY_HALT)))
    assert headline.failure is not None
    assert (headline.failure.lead, headline.failure.share) == ("All failures", "5/5 variation trials")
    assert "5 failures in 5 variation trials, all of reasoning: early halt, in fast_food/T1." in headline.sentences
    lonely = headline_of(diagnosis([*varied(range(1), Label.TIMEOUT), *varied(range(1, 3))]))
    assert lonely.failure is not None
    assert lonely.failure.lead == "The only failure"
    assert "1 failure in 3 variation trials, of execution: timeout, in fast_food/T1." in lonely.sentences


def test_times_are_counted_in_words():
    trials = [*varied(range(2), Label.EARLY_HALT), *varied([2], Label.WRONG_OBJECT)]
    assert "3 failures in 3 variation trials, all of reasoning; most often: early halt (twice, in" in said(trials)


def test_the_gap_stands_beside_the_numbers_it_comes_from():
    """A training of 50 % and variations of 50 % with a gap of 50 points: the twins are not all of training."""
    trials = [*trained(range(4)), *trained(range(4), Label.TIMEOUT, condition="train2")]
    trials += [*varied(range(2)), *varied(range(2, 4), Label.TIMEOUT)]
    text = said(trials).replace("\N{NARROW NO-BREAK SPACE}", " ")
    assert "In 4 pairs it solves 100 % of the twins and 50 % of the variations: an illusion gap of 50 points" in text
    same = [t for t in trials if t.condition != "train2" or t.variation]
    assert "In 4 pairs" not in said(same)


def test_a_habit_in_one_task_is_named_although_failures_are_rare():
    repeats = Label.CAUSAL_CONFUSION
    trials = [*varied(range(40), variation="T2"), *varied([0], repeats, rule="finished_step_repeated", variation="L1")]
    trials += [*trained(range(4), repeats), *trained(range(5), condition="train2")]
    headline = headline_of(diagnosis(trials))
    assert headline.conclusion.startswith("In fast_food it ")
    assert headline.conclusion.endswith("(5/5 trials of L1 and train1).")
    assert headline.family == "reasoning"
    assert verdict_line(diagnosis(trials)).endswith("(5/5 trials of L1 and train1; training 5/9, variations 40/41).")


@pytest.mark.parametrize(
    "scattered",
    [
        [*varied([0], Label.WRONG_OBJECT, variation="L1"), *trained(range(1), Label.WRONG_OBJECT)],
        [
            *varied([0], Label.WRONG_OBJECT, variation="L1"),
            *trained([0, 1], Label.WRONG_OBJECT),
            *(t for k in "abc" for t in trained([0, 1], Label.WRONG_OBJECT, task=k)),
        ],
        [*varied([0], Label.WRONG_OBJECT), *trained([0, 1], Label.WRONG_OBJECT)],
    ],
    ids=["two trials", "over several tasks", "with exceptions in the same variation"],
)
def test_a_few_scattered_failures_are_no_habit(scattered):
    trials = [*varied(range(1, 41)), *trained(range(100, 140), condition="train2"), *scattered]
    assert headline_of(diagnosis(trials)).conclusion.startswith("No systematic failure found")


def test_a_halt_says_on_which_axis_it_shows():
    layout = {"variation": "L1", "axis": "spatial_layout_shift"}
    halts = varied(range(5), Label.EARLY_HALT, attempts=())
    where = "It stops before its first grasp where there is more or less to do than in training."
    assert headline_of(diagnosis([*halts, *varied(range(5), **layout)])).conclusion == where
    plain = "It stops before its first grasp."
    assert headline_of(diagnosis(halts)).conclusion == plain, "nothing else was run"
    both = [*halts, *varied(range(5), Label.EARLY_HALT, attempts=(), **layout)]
    assert headline_of(diagnosis(both)).conclusion == plain


@pytest.mark.parametrize(
    ("rules", "how"),
    [
        (["dropped"] * 10, "but drops them."),
        (["missed_by_pose"] * 6 + ["dropped"] * 4, "but closes beside them or drops them."),
        (["missed_by_pose"] * 4 + ["dropped"] * 3 + ["slipped"] * 3, "but its manipulation fails."),
        (["goal_not_held"] * 10, "but its manipulation fails."),
    ],
)
def test_a_clumsy_hand_is_told_how(rules, how):
    trials = [t for s, rule in enumerate(rules) for t in varied([s], Label.EXECUTION_FAILURE, rule=rule)]
    assert headline_of(diagnosis(trials)).conclusion == f"It goes for the right things, {how}"
    weak = headline_of(diagnosis([*trials, *trained(range(9), Label.TIMEOUT)])).conclusion
    assert weak.startswith("It fails the training conditions too. It goes for the right things, but ")


def test_a_memorized_order_is_said():
    trials = varied(range(5), Label.ORDER_VIOLATION, rule="memorized_order")
    assert "the step that came next in training" in headline_of(diagnosis(trials)).conclusion


@pytest.mark.parametrize(
    ("shared", "right", "named"),
    [(("shape",), 6, LOOK), (("shape",), 1, RULE), ((), 6, RULE)],
    ids=["only look-alikes, and right elsewhere", "hardly ever right elsewhere", "also what does not look alike"],
)
def test_a_word_rule_that_holds_for_look_alikes_alone_is_one_of_looks(shared, right, named):
    """Shape alone, as the film showed: where the word led to something of another shape, it went for the right one."""
    layout = {"variation": "L1", "axis": "spatial_layout_shift"}
    trials = varied(range(10), LOOK, shared=("shape", "slot"), variation="O1")
    trials += [*varied(range(8), RULE, shared=shared, **layout), *varied(range(8, 8 + right), **layout)]
    failure = headline_of(diagnosis(trials)).failure
    assert failure is not None
    assert failure.label is named


def test_an_unfinished_run_is_no_breakdown_of_the_policy():
    """Half of the trials were never run: nothing shows that the policy failed to run."""
    missing = varied(range(5), Label.POLICY_ERROR)
    none = [replace(t, evidence=without_record(None), attempts=()) for t in missing]
    assert headline_of(diagnosis(none)).conclusion.startswith("The run is not finished")
    broken = [replace(t, evidence=without_record("the server went away"), attempts=()) for t in missing]
    assert headline_of(diagnosis(broken)).conclusion.startswith("The policy itself failed to run")
