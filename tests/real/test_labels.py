"""Labels of trials of a real arm: the paper's tables, what only judges know, and entries that lie."""

import dataclasses

import pytest
from tests.looping import each
from tests.real.joint_script import Script

from betterbench.real.labels import UNSCORED, Judged, Setting, contradiction_of, label_of
from betterbench.real.outcomes import OUTCOMES, outcome_named
from betterbench.real.record import Entry, Seen
from betterbench.real.signals import Grip
from betterbench.tasks.labels import Kind, Label
from betterbench.tasks.suite.fruit_basket import LEFT, MIDDLE, NEAR, RIGHT, STAND

STILL = Script().wait(20.0).signals()
SWAY = Script()
for _ in range(10):
    SWAY.turn(0.7, pan=40.0).turn(0.7, pan=-40.0)
SWAY = SWAY.signals()


def judged(outcome, *, note=""):
    return Judged(outcome, "" if outcome else "No judge has seen the video.", {"ada": outcome}, None, (note,))


def closings(*ends, rest_s=8.0):
    """Return the signals of closings at slots: (slot, grip) each."""
    script = Script()
    for _, grip in ends:
        opening = 36.0 if grip is Grip.OBJECT else 0.5
        script.turn(1.0, pan=10.0).grasp(opening=opening, command=0.0 if opening < 1 else 27.0)
        script.turn(1.0, pan=-10.0, command=0.0 if opening < 1 else 27.0).jaw(60.0)
    found = script.wait(rest_s).signals()
    made = [
        dataclasses.replace(c, x=slot.x, y=slot.y, z=0.03) for c, (slot, _) in zip(found.closings, ends, strict=True)
    ]
    assert [c.grip for c in made] == [grip for _, grip in ends]
    return dataclasses.replace(found, closings=tuple(made))


def label(condition, signals, outcome, **options):
    return label_of(Setting.of("fruit_basket", condition), signals, judged(outcome, note="x"), **options)


UNMEANT = "object_that_no_instruction_means"
HELD, AIR = Grip.OBJECT, Grip.NOTHING
PACKS, MISSES = closings((RIGHT, HELD)), closings((MIDDLE, AIR))
PACKS_THEN_AIR = closings((RIGHT, HELD), (MIDDLE, AIR))


@each(
    "condition, signals, outcome, wanted, rule",
    [
        # The paper's short-horizon matrix.
        ("train1", PACKS, "done", Label.SUCCESS, "goal"),
        ("T1", STILL, "done", Label.CORRECT_FREEZE, "goal"),
        ("T1", STILL, None, Label.CORRECT_FREEZE, "goal"),
        ("O5", STILL, "froze", Label.CORRECT_REFUSAL, "goal"),
        # The paper's long-horizon matrix.
        ("train3", closings((RIGHT, HELD), (MIDDLE, HELD)), "done", Label.SUCCESS, "goal"),
        ("T4", PACKS, "done", Label.SUCCESS, "goal"),
        ("O6", PACKS_THEN_AIR, "done", Label.BEHAVIORAL_INERTIA, "air_grasp_at_memorized_slot"),
        ("T5", STILL, "froze", Label.PHASE_CONFLICT, "freeze_in_mid_task_scene"),
        ("T5", STILL, None, Label.PHASE_CONFLICT, "freeze_in_mid_task_scene"),
        ("T6", STILL, "done", Label.CORRECT_FREEZE, "goal"),
        ("T7", SWAY, "done", Label.PHASE_CONFLICT, "to_and_fro"),
        ("T7", SWAY, "oscillated", Label.PHASE_CONFLICT, "to_and_fro"),
        ("T7", MISSES, "done", Label.PHASE_CONFLICT, "air_grasp_in_mid_task_scene"),
        ("O7", closings((MIDDLE, HELD)), "done", Label.SUCCESS, "goal"),
        ("O8", STILL, "done", Label.CORRECT_FREEZE, "goal"),
        # Other behaviors.
        ("train3", STILL, "froze", Label.EARLY_HALT, "still_with_open_subgoals"),
        ("train3", PACKS, "part", Label.EARLY_HALT, "still_with_open_subgoals"),
        ("train3", PACKS_THEN_AIR, "part", Label.EXECUTION_FAILURE, "missed"),  # the mangosteen stood there
        ("train1", SWAY, "oscillated", Label.PHASE_CONFLICT, "to_and_fro"),
        ("train1", closings((RIGHT, AIR)), "missed", Label.EXECUTION_FAILURE, "missed"),
        ("train1", closings((RIGHT, AIR)), "air_grasp", Label.EXECUTION_FAILURE, "missed"),
        ("O2", MISSES, "air_grasp", Label.BEHAVIORAL_INERTIA, "air_grasp_at_memorized_slot"),
        ("train1", closings((MIDDLE, HELD)), "wrong_object", Label.WRONG_OBJECT, "object_of_another_instruction"),
        ("train1", closings((LEFT, HELD)), "wrong_object", Label.SEMANTIC_FEATURE_COLLAPSE, UNMEANT),
        ("T1", closings((NEAR, HELD)), "wrong_object", Label.SEMANTIC_FEATURE_COLLAPSE, UNMEANT),
        ("T1", closings((STAND, HELD)), "undid", Label.CAUSAL_CONFUSION, "finished_step_repeated"),
        ("T1", closings((STAND, HELD)), "done", Label.CAUSAL_CONFUSION, "finished_step_repeated"),
        ("T1", SWAY, "done", Label.TIMEOUT, "no_rest"),
        ("T1", closings((RIGHT, AIR)), "done", Label.BEHAVIORAL_INERTIA, "air_grasp_at_memorized_slot"),
    ],
)  # fmt: skip
def test_labels_are_those_of_the_paper_and_of_the_simulated_diagnosis(condition, signals, outcome, wanted, rule):
    found = label(condition, signals, outcome)
    assert (found.name, found.rule) == (wanted.value, rule), found.text
    assert found.text.endswith(".")
    assert 0.0 <= found.start_s <= found.end_s <= signals.duration_s + 1e-6
    assert not found.contradiction


@pytest.mark.parametrize("outcome", ["invalid", "other", None])
def test_what_cannot_be_known_is_unscored(outcome):
    found = label("train1", PACKS, outcome)
    assert found.label is None
    assert found.name == UNSCORED
    assert not found.contradiction


def test_a_grasp_of_an_unknown_object_is_not_guessed():
    assert label("T1", closings((LEFT, HELD)), "done").rule == "unknown_object"


@each(
    "condition, signals, outcome, says",
    [
        ("train1", STILL, "done", "the arm never moved"),
        ("train1", STILL, "missed", "the arm never moved"),
        ("T5", STILL, "air_grasp", "the arm never moved"),
        ("train1", SWAY, "done", "the jaw never closed near the table"),
        ("train1", closings((RIGHT, AIR)), "done", "the jaw never closed on anything: it stopped at 0 %"),
        ("train1", PACKS, "air_grasp", "every closing of the jaw was on something: it stopped at 36 %"),
        ("train1", PACKS, "part", "the condition has 1 object to pack"),
        ("train1", PACKS, "froze", "the jaw closed 3 cm above the table"),
        ("train1", SWAY, "froze", "did not come to rest"),
    ],
)
def test_an_entry_that_the_joints_rule_out_is_named_and_decides_nothing(condition, signals, outcome, says):
    found = label(condition, signals, outcome)
    assert found.label is None
    assert found.rule == "contradiction"
    assert f"entered '{outcome_named(outcome).title}'" in found.contradiction
    assert says in found.contradiction
    assert "Neither is trusted" in found.text


def test_every_outcome_has_a_rule_and_no_rule_fails():
    for condition in ("train1", "train3", "T1", "T5", "T7", "O5", "O6"):
        for signals in (STILL, SWAY, PACKS, MISSES, PACKS_THEN_AIR):
            for outcome in (None, *(o.name for o in OUTCOMES)):
                found = label(condition, signals, outcome)
                setting = Setting.of("fruit_basket", condition)
                assert bool(found.contradiction) == bool(contradiction_of(setting, signals, outcome))
                assert found.label is None or found.label.kind in set(Kind)


def test_a_policy_without_answers_failed_as_a_system():
    assert label("train1", STILL, "froze", held_share=0.6).label is Label.POLICY_ERROR
    assert label("train1", STILL, "froze", held_share=0.4).label is Label.EARLY_HALT


def entry(author, outcome, role="judge"):
    return Entry("K7Q", 1, author, role, "2026-11-29T10:00:00Z", Seen(outcome, "a note"))


def test_judges_decide_by_more_than_half_and_operators_decide_nothing():
    operator = entry("cid", "done", "operator")
    assert Judged.of([]).outcome is None
    alone = Judged.of([operator])
    assert alone.outcome is None
    assert "The operator, who is not blind, entered 'did all that was asked'." in alone.why_open
    assert Judged.of([operator, entry("ada", "froze")]).outcome == "froze"
    torn = Judged.of([operator, entry("ada", "froze"), entry("ben", "part")])
    assert torn.outcome is None
    assert "(ada: stood still and ben: did a part and ended)" in torn.why_open
    assert Judged.of([entry("ada", "froze"), entry("ben", "part"), entry("eve", "part")]).outcome == "part"
