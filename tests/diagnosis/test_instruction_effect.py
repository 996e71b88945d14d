"""The instruction effect: pairs of trials that differ in the instruction alone, and policies that do not use it."""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
import pytest

from betterbench.diagnosis import Label, diagnose_records
from betterbench.diagnosis.instruction_effect import (
    SAME_TARGET,
    changes_target,
    instruction_pairs,
    is_unused,
    scene_of,
    tasks_without_effect,
)
from betterbench.diagnosis.verdict import Metric
from betterbench.report.headline import headline_of

MUGS = ("train1", "train2", "train3", "train4", "L1", "L2", "L3", "L4")
CABINETS = ("train1", "train3", "train5", "train7")
DESKS = tuple(f"train{n}" for n in range(1, 10))


@functools.cache
def beginning(stage, task, name, seed):
    """The stage of an episode in which nothing has been done yet, and which stays so."""
    return stage(task, name, seed=seed)


@functools.cache
def brought(stage, task, name, seed, thing):
    """The record of an episode in which one thing is brought where the first step wants it; the policies share them."""
    s = stage(task, name, seed=seed)
    return s.bring(thing, s.goal(0)).home().wait(4).end()


def take(stage, choose, names=MUGS, task="morning_coffee", seeds=range(3)):
    """Records of a policy that takes what ``choose`` names and brings it where the first step wants it."""
    episodes = itertools.product(names, seeds)
    return [brought(stage, task, name, s, choose(beginning(stage, task, name, s))) for name, s in episodes]


def asked(s):
    return s.condition.resolve(s.condition.instruction.subgoals[0].reference)[0]


def red(s):
    return next(n for n in s.movable() if s.info.object(n).color == "red")


def by_start_pose(s):
    """The choice of a policy that follows the arm's start pose, which only the seed decides."""
    return s.at("near" if s.metadata.seed % 2 else "far")


def by_turns(s):
    """The choice of a policy that takes another place with each seed."""
    return sorted(s.movable(), key=lambda n: s.positions[n][1])[s.metadata.seed % 3]


def back(s, seed=0):
    """The back slot of either layout of office_drawer; in the second layout, odd seeds lead to the front slot."""
    if "left_back" in s.condition.layout.values():
        return "left_back"
    return "right_front" if seed % 2 else "right_back"


def nearest(s):
    return min(s.movable(), key=lambda n: math.dist(s.positions[n][:2], s.tool[:2]))


def effect(found):
    metric = found.metric("instruction_effect", "overall")
    return metric.k, metric.n


def test_an_honest_policy_changes_its_target_in_every_pair(stage):
    found = diagnose_records(take(stage, asked))
    assert effect(found) == (12, 12)
    assert not any("use the instruction" in text for text in found.findings)


@pytest.mark.parametrize(
    ("choose", "decides"),
    [
        (red, "the kind of object or the color of the object"),
        (by_start_pose, "another cue that is constant within a seed"),
        (lambda s: s.at("far"), "the place of the object"),
        (nearest, "the smallest distance to the gripper"),
    ],
)
def test_a_policy_that_does_not_use_the_instruction_is_said_not_to(stage, choose, decides):
    found = diagnose_records(take(stage, choose))
    assert effect(found) == (0, 12)
    assert "does not use the instruction" in found.findings[0]
    assert decides in found.findings[0].partition("The deciding cue is ")[2]
    wrong = [t for t in found.trials if not t.success]
    assert len(wrong) >= 6
    assert {t.label for t in wrong} == {Label.VISUAL_LAYOUT_BIAS}
    assert all(t.intention_correct for t in found.trials if t.success)


def test_a_drawer_is_not_the_first_target_of_a_policy_that_does_not_use_the_instruction(stage):
    """It takes the red stapler whatever is asked, and opens the drawer of the stapler first."""
    records = []
    for name, seed in itertools.product(("train1", "train3", "train5", "train7"), range(4)):
        s = stage("office_drawer", name, seed=seed).draw("upper", 0.15)
        records.append(s.bring(red(s), s.place("inside", "upper")).draw("upper", 0.0).home().wait(4).end())
    found = diagnose_records(records)
    assert effect(found) == (0, 8)
    assert {t.label for t in found.trials if not t.success} == {Label.VISUAL_LAYOUT_BIAS}
    assert "kind of object" in found.findings[0]


def test_drawers_alone_form_no_pair(stage):
    records = []
    for name, seed in itertools.product(("train1", "train3"), range(4)):
        records.append(stage("office_drawer", name, seed=seed).draw("upper", 0.15).home().wait(4).end())
    assert instruction_pairs(diagnose_records(records).trials) == []


def test_evidence_counts_the_pairs_and_says_what_decides(stage):
    found = diagnose_records(take(stage, by_start_pose))
    proven = [t for t in found.trials if t.evidence.rule == SAME_TARGET]
    assert proven
    text = proven[0].evidence.text
    assert "In 12 of 12 pairs of trials that differ only in the instruction the first target is the same." in text
    assert "such as the arm's start pose" in text


def test_a_favorite_place_of_one_task_is_not_the_rule_of_all(stage):
    """What decides is said once, and the conclusion agrees with it."""
    desks = take(stage, by_turns, DESKS, "desk_meeting")
    alone = headline_of(diagnose_records(take(stage, lambda s: s.at("far"))))
    assert alone.conclusion == "It goes to the same place regardless of the instruction."
    found = diagnose_records([*take(stage, lambda s: s.at("far")), *desks])
    assert "The deciding cue is not a slot" in found.findings[0]
    wrong = [t for t in found.trials if t.label is Label.VISUAL_LAYOUT_BIAS]
    assert {t.task for t in wrong} == {"morning_coffee", "desk_meeting"}
    assert {t.evidence.rule for t in wrong} == {SAME_TARGET}
    assert "does not use the instruction" in headline_of(found).conclusion


def test_a_favorite_place_may_differ_between_layouts_without_a_common_slot(stage):
    """No slot of office_drawer is occupied in both positions of the cabinet, so no single slot can be the favorite."""
    backs = take(stage, lambda s: s.at(back(s)), CABINETS, "office_drawer")
    found = diagnose_records([*take(stage, lambda s: s.at("near")), *backs])
    assert found.findings[0].partition("The deciding cue is ")[2] == "the place of the object."
    backs = take(stage, lambda s: s.at(back(s, s.metadata.seed)), CABINETS, "office_drawer", seeds=range(4))
    found = diagnose_records([*take(stage, lambda s: s.at("near")), *backs])
    assert "not a slot" in found.findings[0], "in the second layout the seed decides"


def test_a_missed_grasp_and_a_grasp_of_the_same_object_are_the_same_target(stage):
    """It always goes for the red mug, and closes beside it if the red mug is requested."""
    records = []
    for name, seed in itertools.product(MUGS, range(3)):
        s = stage("morning_coffee", name, seed=seed)
        if asked(s) == red(s):
            s.grasp(red(s), beside=(0.0, 0.055)).lift().home().wait(4)
        else:
            s.bring(red(s), s.goal(0)).home().wait(4)
        records.append(s.end())
    found = diagnose_records(records)
    assert {t.first_attempt is None for t in found.trials} == {True, False}
    assert effect(found) == (0, 12)
    assert "does not use the instruction" in found.findings[0]
    assert "the color of the object" in found.findings[0]


def test_few_pairs_accuse_nobody(stage):
    found = diagnose_records(take(stage, red, seeds=range(2)))
    assert effect(found) == (0, 8)
    assert not any("use the instruction" in text for text in found.findings)


@pytest.mark.parametrize("seed", range(5))
def test_a_policy_that_picks_at_random_is_not_accused(stage, seed):
    rng = np.random.default_rng(seed)
    found = diagnose_records(take(stage, lambda s: rng.choice(s.movable()), seeds=range(2)))
    metric = found.metric("instruction_effect", "overall")
    assert not is_unused(metric)


def test_a_word_that_leads_somewhere_is_a_use_of_the_instruction(policies):
    records = [policies["lexical"]("morning_coffee", name, seed) for name in MUGS for seed in range(3)]
    found = diagnose_records(records)
    assert found.metric("instruction_effect", "overall").value >= 0.5
    assert {t.label for t in found.trials} == {Label.SUCCESS, Label.LEXICAL_KINEMATIC_SHORTCUT}


def test_pairs_are_of_one_scene_ask_for_different_things_and_hold_no_trial_twice(stage):
    trials = diagnose_records(take(stage, asked)).trials
    pairs = instruction_pairs(trials)
    keys = [t.key for pair in pairs for t in pair]
    assert len(keys) == len(set(keys)) == 24
    for a, b in pairs:
        assert (a.seed, a.scene) == (b.seed, b.scene)
        assert a.instruction != b.instruction
        assert not set(a.intended_any) & set(b.intended_any)
        assert changes_target((a, b))
    assert all(b.key == a.twin_key for a, b in pairs if a.condition in ("train1", "train2", "train3", "train4"))


def test_another_layout_another_seed_and_another_thing_are_other_scenes(stage):
    scenes = {
        (n, s): scene_of(stage("fast_food", n, seed=s).end()) for n in ("train1", "R1", "L1", "O1") for s in (0, 1)
    }
    assert scenes["train1", 0] == scenes["R1", 0]
    assert len({scenes["train1", 0], scenes["train1", 1], scenes["L1", 0], scenes["O1", 0]}) == 4


def test_without_attempts_there_is_no_pair(stage):
    records = [stage("morning_coffee", name, seed=0).home().wait(4).end() for name in MUGS]
    assert diagnose_records(records).metric("instruction_effect", "overall") is None


def test_what_one_task_proves_is_said_of_that_task_alone(stage):
    def mixed(s):
        return red(s) if s.metadata.task == "morning_coffee" else asked(s)

    records = take(stage, mixed, seeds=range(6))
    records += take(stage, asked, ("train1", "R1", "R2"), "fast_food", range(12))
    unused = tasks_without_effect(diagnose_records(records).trials)
    assert list(unused) == ["morning_coffee"]


def test_an_effect_needs_pairs_and_a_proof():
    def metric(k, n, p):
        return Metric("instruction_effect", "overall", k, n, k / n, 0.0, 0.5, p)

    assert is_unused(metric(0, 10, 0.001))
    assert not is_unused(metric(0, 9, 0.002))
    assert not is_unused(metric(3, 10, 0.17))
    assert not is_unused(metric(1, 10, 0.011), tests=5)
    assert not is_unused(None)
