"""Faulty policies and a second target: slots of the layout that a scene resembles, and a step without its object."""

from __future__ import annotations

import pytest
from tests.looping import each

from betterbench.interface.actions import JOINT_POSITION, action_space
from betterbench.policies.decisions import Bring, Freeze, GraspAt, Rest, Situation, Wander
from betterbench.policies.faulty.halt import Phase
from betterbench.policies.faulty.inertia import Inertia
from betterbench.policies.faulty.lexical import Lexical
from betterbench.policies.faulty.rules import BrokenRule
from betterbench.sim.scenes import Scene, quality_preset
from betterbench.tasks import get_task, suite_tasks, training_distribution_of
from betterbench.tasks.interventions import resolve_condition

SUITE = [
    (name, c.name) for name in suite_tasks("better60") for c in (*get_task(name).training, *get_task(name).variations)
]


def situation(task: str, condition: str, seed: int = 0) -> Situation:
    found = resolve_condition(task, condition)
    return Situation(found.task, found.condition, seed)


def start(task: str, condition: str):
    """Returns the trial as a rule knows it, and its initial state."""
    found, robot = resolve_condition(task, condition), get_task(task).robot
    space = JOINT_POSITION if robot == "panda" else action_space("so101_degrees")
    scene = Scene(
        found.task, found.condition, seed=0, action_space=space, quality=quality_preset("fast"), robot_name=robot
    )
    return situation(task, condition), scene.reset(check_premise=False)


@each("task, condition", SUITE)
def test_the_ten_tasks_recall_the_slots_that_they_always_recalled(task, condition):
    rule, trained = BrokenRule(situation(task, condition)), training_distribution_of(get_task(task))
    for word, slots in trained.word_slots.items():
        assert rule.slots_of_word(word) == slots
    if trained.habit is not None:
        assert rule.slots_of_kind(trained.habit) == trained.kind_slots[trained.habit]


def test_no_condition_of_the_ten_tasks_lacks_the_object_of_a_later_step_of_its_own_instruction():
    for task, name in SUITE:
        condition = resolve_condition(task, name).condition
        here = {o.kind for o in condition.objects}
        for known in get_task(task).training:
            if known.instruction.text == condition.instruction.text:
                for goal in known.instruction.subgoals[1:]:
                    assert {known.object(n).kind for n in known.resolve(goal.reference)} & here, (task, name)


@pytest.mark.parametrize(
    ("condition", "lemon", "fruits"),
    [
        ("train1", ("right",), ("right", "middle")),
        ("train2", ("left",), ("left", "near")),
        ("train4", ("left",), ("left", "near")),
        ("O6", ("right",), ("right", "middle")),
        ("L2", ("right",), ("right", "middle")),
    ],
)
def test_a_scene_recalls_the_layout_that_it_resembles(condition, lemon, fruits):
    rule = BrokenRule(situation("fruit_basket", condition))
    assert rule.slots_of_word("lemon") == lemon
    assert rule.slots_of_word("fruits") == fruits
    assert rule.slots_of_word("pear") == ()
    assert rule.slots_of_kind("lemon") == lemon
    assert rule.slots_of_kind("pear") == ()


@pytest.mark.physics
@pytest.mark.parametrize(
    ("condition", "slot"),
    [
        ("T7", "middle"),
        ("O9", "right"),
        ("O7", "right"),
        ("O5", "right"),
        *((name, None) for name in ("T5", "T6", "O6", "O8", "T3", "T4", "train3")),
    ],
)
def test_a_step_is_absent_if_it_follows_the_last_finished_one_and_its_object_is_nowhere(condition, slot):
    trial, state = start("fruit_basket", condition)
    assert BrokenRule(trial).absent_step(state) == slot


@pytest.mark.physics
@each(
    "rule, condition, decision",
    [
        (Phase, "T7", Wander()),
        (Phase, "T6", Freeze(None)),
        (Phase, "T1", Freeze(None)),
        (Lexical, "T7", GraspAt("right")),
        (Lexical, "T3", GraspAt("right")),
        (Phase, "T4", Bring("lemon", "basket", "inside", "")),
        (Inertia, "train1", Bring("lemon", "basket", "inside", "")),
        (Inertia, "T4", Bring("lemon", "basket", "inside", "")),
        (Inertia, "T5", Bring("mangosteen", "basket", "inside", "")),
        (Inertia, "O7", Bring("mangosteen", "basket", "inside", "")),
        (Inertia, "T7", GraspAt("middle")),
        (Inertia, "O9", GraspAt("right")),
        (Inertia, "T6", Rest()),
        (Inertia, "O8", Rest()),
        (Inertia, "T1", Rest()),
    ],
)
def test_first_decisions_of_the_faulty_policies(rule, condition, decision):
    trial, state = start("fruit_basket", condition)
    assert rule(trial).decide(state, ()) == decision


@pytest.mark.physics
def test_inertia_executes_an_absent_step_once_and_then_rests():
    trial, state = start("fruit_basket", "T7")
    rule, first = Inertia(trial), GraspAt("middle")
    assert rule.decide(state, ()) == first
    assert rule.decide(state, (first,)) == Rest()


@each("task", [*suite_tasks("better60"), "cheeseburger_so101", "fruit_basket"])
def test_demonstrations_of_the_fruit_basket_alone_are_one_fixed_sequence(task):
    """The other tasks compose their steps in several ways, so that the first step of inertia is blind there."""
    fixed = ("lemon", "mangosteen") if task == "fruit_basket" else None
    assert training_distribution_of(get_task(task)).fixed_sequence == fixed
