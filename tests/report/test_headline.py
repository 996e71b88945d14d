"""The first sentences of a report: each follows from the counts, and says where and how it fails."""

from __future__ import annotations

import math
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from factory import diagnosis, trial

from betterbench.diagnosis import Label, Metric
from betterbench.diagnosis.modes.policy_error import without_record
from betterbench.report.headline import headline_of, verdict_line

BROKEN = Label.POLICY_ERROR
RULE, LOOK = Label.LEXICAL_KINEMATIC_SHORTCUT, Label.SEMANTIC_FEATURE_COLLAPSE


def trained(seeds, label=Label.SUCCESS, **changes):
    return [trial(variation=None, seed=s, label=label, **changes) for s in seeds]


def varied(seeds, label=Label.SUCCESS, *, rule="", shared=(), **changes):
    made = [trial(seed=s, label=label, **changes) for s in seeds]
    return [replace(t, evidence=replace(t.evidence, rule=rule or t.evidence.rule, shared=shared)) for t in made]


def with_unused_instruction(run):
    """The diagnosis of a run whose first target is the same in 12 of 12 pairs."""
    effect = Metric("instruction_effect", "overall", 0, 12, 0.0, 0.0, 0.24, 0.5**12)
    return replace(run, metrics=(*(m for m in run.metrics if m.name != "instruction_effect"), effect))


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
    where = "It stops before its first grasp where more or fewer steps are needed than in training."
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
    assert headline_of(diagnosis(trials)).conclusion == f"It goes for the correct objects, {how}"
    weak = headline_of(diagnosis([*trials, *trained(range(9), Label.TIMEOUT)])).conclusion
    assert weak.startswith("It fails the training conditions too. It goes for the correct objects, but ")


@pytest.mark.parametrize(
    ("rules", "said"),
    [
        (["collided"] * 10, "it knocks objects over or out of place; 10 of 10"),
        (["harm"] * 6 + ["pushed"] * 4, "it knocks objects over or out of place or pushes objects away; 6 of 10"),
        (["goal_not_held"] * 10, ""),
    ],
)
def test_an_arm_that_knocks_things_over_before_any_attempt_is_not_said_to_go_for_the_right_ones(rules, said):
    """Seen on a policy that sweeps over the table with intention accuracy 33 %: "It goes for the correct objects"."""
    wild = {"intention_correct": False, "attempts": ()}
    trials = [t for s, rule in enumerate(rules) for t in varied([s], Label.EXECUTION_FAILURE, rule=rule, **wild)]
    conclusion = headline_of(diagnosis(trials)).conclusion
    assert "goes for the correct objects" not in conclusion
    assert conclusion.startswith(f"Its manipulation fails: {said}" if said else "Its manipulation fails; 10 of 10")
    assert conclusion.endswith("of these trials do not show its target.")
    aimed = [replace(trial, intention_correct=True) for trial in trials]
    assert "It goes for the correct objects, but " in headline_of(diagnosis(aimed)).conclusion


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


# -- conclusions from too little ------------------------------------------------------------------------------------


def option(command, name):
    words = shlex.split(command)
    return words[words.index(name) + 1]


@pytest.mark.parametrize("n", [1, 3, 5])
def test_a_few_failed_training_trials_are_counted_and_no_more_is_said_of_training(n):
    """0/1 is not "it fails the training conditions too"; the command runs as many as would show it."""
    failed = [*varied(range(8), Label.EXECUTION_FAILURE, rule="dropped"), *trained(range(n), Label.TIMEOUT)]
    headline = headline_of(diagnosis(failed))
    assert headline.conclusion == f"It solved 0/{n} training trials. It goes for the correct objects, but drops them."
    assert "6 in total if the share of solved trials stays the same" in headline.claim.deciding
    assert option(headline.claim.command, "--tasks") == "fast_food"
    assert int(option(headline.claim.command, "--trials")) >= 6
    assert int(option(headline.claim.command, "--seed")) > 7
    enough = headline_of(diagnosis([*failed, *trained(range(n, 6), Label.TIMEOUT)]))
    assert enough.conclusion.startswith("It fails the training conditions too. ")
    assert enough.claim.deciding == ""


@pytest.mark.parametrize(
    ("labels", "said"),
    [
        ([RULE] * 9 + [Label.SUCCESS] * 3, "It maps words to motions"),
        ([Label.EXECUTION_FAILURE] * 12, "It has not learned the training conditions (0/12 solved)."),
        ([Label.EARLY_HALT] * 12, "It stops"),
        ([Label.SUCCESS] * 11 + [RULE], "Nothing to conclude yet: 1 of 12 training trials failed"),
        ([Label.SUCCESS] * 12, "No failure found in 12 training trials"),
        ([RULE], "Nothing to conclude yet: 1 of 1 training trial failed"),
    ],
)
def test_what_training_trials_show_is_said_where_no_variation_was_run(labels, said):
    headline = headline_of(diagnosis([t for s, label in enumerate(labels) for t in trained([s], label)]))
    assert said in headline.conclusion
    assert "no variation was run, so nothing is known beyond the training conditions" in headline.conclusion.lower()
    assert "its reasoning is unknown" not in headline.conclusion
    assert headline.claim.deciding.startswith("To diagnose its reasoning, run")
    assert option(headline.claim.command, "--tasks") == "fast_food"
    assert option(headline.claim.command, "--trials") == str(len(labels))
    failed = sum(label is not Label.SUCCESS for label in labels)
    surely = failed > 0 and not said.startswith("Nothing")
    assert headline.claim.supported is (surely or failed == 0)
    assert f"({failed} of {len(labels)} training trials failed)" in headline.conclusion or not surely
    assert headline.family != "system", "the legend calls this color a system failure"


def test_a_run_without_any_trial_knows_nothing():
    assert verdict_line(diagnosis([])).endswith("No variation was run, so its reasoning is unknown.")


@pytest.mark.parametrize(("elsewhere", "said"), [(5, False), (12, False), (40, True)])
def test_where_a_policy_fails_is_said_if_a_test_shows_it(elsewhere, said):
    """Six halts in thirty trials of one axis: none in five of another is no difference."""
    layout = {"variation": "L1", "axis": "spatial_layout_shift"}
    halts = [*varied(range(6), Label.EARLY_HALT, attempts=()), *varied(range(6, 30))]
    text = headline_of(diagnosis([*halts, *varied(range(elsewhere), **layout), *trained(range(40))])).conclusion
    assert text.startswith("It stops before its first grasp")
    assert ("where more or fewer steps are needed than in training" in text) is said


@pytest.mark.parametrize(("halted", "said"), [(0, True), (8, True), (12, False), (20, False)])
def test_an_axis_is_not_named_if_the_policy_fails_in_the_same_way_in_training(halted, said):
    layout = {"variation": "L1", "axis": "spatial_layout_shift"}
    halts = varied(range(10), Label.EARLY_HALT, attempts=())
    training = [*trained(range(halted), Label.EARLY_HALT, attempts=()), *trained(range(halted, 20))]
    found = headline_of(diagnosis([*halts, *varied(range(10), **layout), *training]))
    assert "stops before its first grasp" in found.conclusion
    assert ("where more or fewer steps are needed than in training" in found.conclusion) is said


def test_right_objects_at_wrong_targets_are_not_called_wrong_objects():
    place, other = "place_of_another_instruction", "object_of_another_instruction"
    said = "It brings the correct objects to wrong targets; this run does not show why."
    headline = headline_of(diagnosis(varied(range(10), Label.WRONG_OBJECT, rule=place)))
    assert headline.conclusion == said
    alone = [replace(t, variation=None) for t in varied(range(10), Label.WRONG_OBJECT, rule=place)]
    assert "correct objects to wrong targets" in headline_of(diagnosis(alone)).conclusion
    mixed = [*varied(range(5), Label.WRONG_OBJECT, rule=place), *varied(range(5, 10), Label.WRONG_OBJECT, rule=other)]
    assert headline_of(diagnosis(mixed)).conclusion != said


def test_targets_of_which_training_explains_half_are_no_habit():
    """The stapler goes to the upper drawer as in training, and so does the tape, which never did."""
    habit = varied(range(4), Label.BEHAVIORAL_INERTIA, rule="memorized_place")
    other = varied(range(4, 8), Label.WRONG_OBJECT, rule="place_of_another_instruction")
    said = "It brings the correct objects to wrong targets; this run does not show why."
    assert headline_of(diagnosis([*trained(range(8)), *habit, *other])).conclusion == said
    habit = varied(range(8), Label.BEHAVIORAL_INERTIA, rule="memorized_place")
    assert "where training brought them" in headline_of(diagnosis([*trained(range(8)), *habit])).conclusion


def mugs(names, taken, labels=(Label.WRONG_OBJECT,)):
    """Trials of morning_coffee: the mug that ``taken`` returns for the instructed one, three seeds each."""
    made = []
    for number, (name, asked) in enumerate(names.items()):
        for seed in range(3):
            at = taken(name, asked, seed)
            variation, condition = (None, name) if name.startswith("train") else (name, "train1")
            made.append(
                trial(
                    "morning_coffee", variation, condition, seed,
                    label=Label.SUCCESS if at == asked else labels[(number + seed) % len(labels)],
                    first_attempt=at, first_attempt_kind=at.replace("_", " "), intended=asked,
                    intended_kind=asked.replace("_", " "), intended_any=(asked,), intention_correct=at == asked,
                )
            )  # fmt: skip
    return made


RED, BLUE = "red_mug", "blue_mug"
OTHER = {RED: BLUE, BLUE: RED}
BY_PLACE = {"train1": RED, "train2": BLUE, "L1": BLUE, "L2": RED}
BY_COLOR = {"train1": RED, "train2": BLUE, "L3": RED, "L4": BLUE}


def test_words_that_are_taken_for_one_another_are_named():
    trials = mugs(BY_PLACE, lambda name, asked, _: asked if name.startswith("train") else OTHER[asked])
    said = "It confuses words: 'bottom' for 'top' and 'top' for 'bottom' (6 of 6 trials with these words)."
    assert headline_of(diagnosis(trials)).conclusion == said


def test_confused_words_are_named_although_single_trials_fit_several_rules():
    labels = (Label.WRONG_OBJECT, Label.BEHAVIORAL_INERTIA, RULE, Label.VISUAL_LAYOUT_BIAS)
    trials = mugs(BY_COLOR, lambda *a: OTHER[a[1]], labels)
    assert "It confuses words: 'blue' for 'red' and 'red' for 'blue'" in headline_of(diagnosis(trials)).conclusion


@pytest.mark.parametrize(
    "taken",
    [
        lambda name, asked, seed: OTHER[asked] if seed and not name.startswith("train") else asked,
        lambda name, asked, seed: RED,  # noqa: ARG005 - a favorite object
    ],
)
def test_words_that_are_understood_in_some_trials_are_not_confused(taken):
    assert "for one another" not in headline_of(diagnosis(mugs(BY_PLACE, taken))).conclusion


def test_one_of_many_forms_of_failure_is_said_to_be_one():
    labels = [RULE] * 4 + [Label.BEHAVIORAL_INERTIA] * 3 + [Label.EARLY_HALT] * 3 + [Label.CAUSAL_CONFUSION] * 2
    trials = [t for s, label in enumerate(labels) for t in varied([s], label)]
    text = headline_of(diagnosis([*trials, *trained(range(12))])).conclusion
    assert text.startswith(
        "Its failures of reasoning have several forms, none of which is a majority; the most frequent one (4 of 12)"
    )
    assert "it maps words to motions" in text
    most = [t for s, label in enumerate(labels[:7]) for t in varied([s], label)]
    assert headline_of(diagnosis([*most, *trained(range(12))])).conclusion.startswith("It maps words to motions")


@pytest.mark.parametrize(("drops", "more"), [(5, ""), (6, " 6 of 12 failures are of another kind: execution.")])
def test_failures_of_another_kind_are_counted_if_they_are_as_frequent(drops, more):
    trials = [*varied(range(6), Label.EARLY_HALT), *varied(range(6, 6 + drops), Label.EXECUTION_FAILURE)]
    assert (
        headline_of(diagnosis([*trained(range(12)), *trials])).conclusion == f"It stops after part of the task.{more}"
    )


def test_who_has_not_come_to_a_first_grasp_is_not_said_to_do_the_right_things():
    trials = varied(range(8), Label.TIMEOUT, attempts=())
    assert headline_of(diagnosis(trials)).conclusion == "It runs out of time before its first grasp."
    assert headline_of(diagnosis(varied(range(8), Label.TIMEOUT))).conclusion.startswith("It makes no mistake")


def test_two_failures_are_no_habit():
    """Two of two are more than 20 % by the exact test, and still too few to say what a policy does."""
    two, three = (
        [trial("morning_coffee", "L3", seed=k, label=Label.LEXICAL_KINEMATIC_SHORTCUT) for k in range(n)]
        for n in (2, 3)
    )
    assert headline_of(diagnosis(two)).conclusion.startswith("Nothing to conclude yet")
    assert headline_of(diagnosis(three)).conclusion.startswith("It maps words to motions")
    alone = [trial("morning_coffee", None, seed=k, label=Label.WRONG_OBJECT) for k in range(2)]
    assert headline_of(diagnosis(alone)).conclusion.startswith("Nothing to conclude yet")


def test_who_solves_the_variations_and_fails_in_training_is_not_without_failure():
    solved = [trial("morning_coffee", "L3", seed=k) for k in range(6)]
    trained = [
        trial("morning_coffee", None, seed=k, label=Label.VISUAL_LAYOUT_BIAS if k < 3 else Label.SUCCESS)
        for k in range(6)
    ]
    conclusion = headline_of(diagnosis(solved + trained)).conclusion
    assert "No failure" not in conclusion
    assert "fails 3 of 6 training trials" in conclusion
    few = headline_of(diagnosis(solved + trained[2:4])).conclusion
    assert "fails 1 of 2 training trials" in few
    assert "In training" not in few
    assert headline_of(diagnosis(solved + trained[3:])).conclusion.startswith("No failure found")


@pytest.mark.parametrize("n", [1, 3, 5])
def test_a_handful_of_solved_trials_is_no_proof_that_nothing_fails(n):
    headline = headline_of(diagnosis(varied(range(n), Label.SUCCESS)))
    assert headline.conclusion.startswith(f"Nothing to conclude yet: {n} of {n} variation trial")
    assert not headline.claim.supported
    assert headline.claim.deciding.startswith("More trials of the variations on new seeds would decide it")
    assert option(headline.claim.command, "--seed") == str(n)
    enough = headline_of(diagnosis(varied(range(6), Label.SUCCESS)))
    assert enough.conclusion == "No failure found: it solves every variation that was run."
    assert enough.claim.supported


@pytest.mark.parametrize("trials", [[*trained([0], BROKEN), *varied([0], BROKEN)], trained([0], BROKEN)])
def test_a_run_that_ended_with_errors_of_the_policy_asks_for_no_more_trials(trials):
    headline = headline_of(diagnosis(trials))
    ended = "2 of 2 trials" if len(trials) > 1 else "1 of 1 trial"
    assert headline.conclusion == f"Nothing was measured: the policy failed with an error in {ended}."
    assert headline.claim.deciding.startswith("Correct the error of the policy")
    assert not headline.claim.command
    assert not headline.claim.supported


def test_errors_of_the_policy_in_a_part_of_a_small_run_leave_the_verdict_open():
    trials = [*trained([0]), *varied([0], BROKEN)]
    assert headline_of(diagnosis(trials)).conclusion.startswith("Nothing to conclude yet")


@pytest.mark.parametrize(("changed", "proven"), [(0, True), (2, False)])
def test_an_instruction_that_is_not_used_is_a_conclusion_although_few_trials_fail(changed, proven):
    """Whoever takes the same object whatever is asked is right in half of the trials, which may look like chance."""
    trials = [*trained(range(9)), *varied(range(5)), *varied(range(5, 9), Label.WRONG_OBJECT)]
    run = diagnosis(trials)
    assert headline_of(run).conclusion.startswith("Nothing to conclude yet")
    p = sum(math.comb(12, k) for k in range(changed + 1)) / 2**12
    effect = Metric("instruction_effect", "overall", changed, 12, changed / 12, 0.0, 0.4, 1.0 if changed else p)
    others = tuple(m for m in run.metrics if m.name != "instruction_effect")
    headline = headline_of(replace(run, metrics=(*others, effect)))
    if proven:
        said = "the first target is the same in 12 of 12 pairs of trials that differ only in the instruction."
        assert headline.conclusion == f"It does not use the instruction: {said}"
        assert (headline.family, headline.claim.supported) == ("reasoning", True)
    else:
        assert headline.conclusion.startswith("Nothing to conclude yet")


@pytest.mark.parametrize(
    ("label", "said"),
    [
        (Label.BEHAVIORAL_INERTIA, "It does not use the instruction: the first target is the same in 12 of 12 pairs"),
        (Label.EXECUTION_FAILURE, "It does not use the instruction: the first target is the same in 12 of 12 pairs"),
        (Label.VISUAL_LAYOUT_BIAS, "It goes to the same place regardless of the instruction."),
    ],
)
@pytest.mark.parametrize("failed", [3, 20])
def test_an_instruction_that_is_not_used_comes_before_the_failures_of_one_variation(label, said, failed):
    """A blind choice may coincide with a habit where the variations are; the wrong trials of training rule it out."""
    blind = trained(range(20, 24), Label.VISUAL_LAYOUT_BIAS)
    run = diagnosis([*trained(range(20)), *blind, *varied(range(failed), label), *varied(range(failed, 21))])
    assert not headline_of(run).conclusion.startswith("It does not use the instruction")
    headline = headline_of(with_unused_instruction(run))
    if failed == 20:
        assert headline.conclusion.startswith(said)
    assert (headline.family, headline.claim.supported) == ("reasoning", True)


def test_a_habit_that_explains_every_wrong_attempt_is_the_conclusion_although_the_instruction_is_not_used():
    run = diagnosis([*trained(range(14)), *varied(range(10), Label.BEHAVIORAL_INERTIA), *varied(range(10, 14))])
    assert headline_of(with_unused_instruction(run)).conclusion == headline_of(run).conclusion
    assert not headline_of(run).conclusion.startswith("It does not use the instruction")


def test_an_instruction_that_is_not_used_comes_before_several_forms_of_failure():
    """Its wrong attempts fit a habit, a skipped step or no rule, depending on the scene."""
    labels = [Label.VISUAL_LAYOUT_BIAS] * 4 + [Label.BEHAVIORAL_INERTIA] * 3 + [Label.CAUSAL_CONFUSION] * 2
    run = diagnosis([*trained(range(9)), *(t for s, label in enumerate(labels) for t in varied([s], label))])
    assert headline_of(run).conclusion.startswith("Its failures of reasoning have several forms")
    said = headline_of(with_unused_instruction(run)).conclusion
    assert said.startswith("It does not use the instruction: the first target is the same in 12 of 12 pairs")


def test_objects_left_where_the_target_stood_in_training_are_said_to_be():
    spots = varied(range(6), Label.BEHAVIORAL_INERTIA, rule="memorized_spot")
    said = headline_of(diagnosis([*trained(range(6)), *spots])).conclusion
    assert said == "It puts objects where their target stood in training, although the target is elsewhere."


def test_an_instruction_that_is_not_used_is_said_although_the_variations_are_solved():
    run = diagnosis([*trained(range(12)), *trained(range(12, 24), Label.VISUAL_LAYOUT_BIAS), *varied(range(9))])
    said = headline_of(with_unused_instruction(run)).conclusion
    assert said.startswith("It does not use the instruction: the first target is the same in 12 of 12 pairs")
