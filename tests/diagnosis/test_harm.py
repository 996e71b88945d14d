"""What a success must not have done, what an attempt is where nothing is to be taken, and steps that nobody needed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from betterbench.diagnosis import diagnose_record
from betterbench.diagnosis.measures.metrics import compute_metrics
from betterbench.diagnosis.trial import offline_truth
from betterbench.geometry import from_yaw, multiply
from betterbench.interface.state import Contact
from betterbench.tasks.labels import Label


def push(s, name, by, *, z=None):
    """Moves a thing without touching it, as something would that was bumped into."""
    s.positions[name] = s.positions[name] + np.array([*by, 0.0])
    if z is not None:
        s.positions[name][2] = z
    s.tick()
    return s


def do_all(s):
    for k in range(len(s.condition.instruction.subgoals)):
        if not s.done[k]:
            s.serve(k)
    return s.wait(1.0)


def on_floor(s, name):
    """Leaves a thing on the floor for the rest of the episode."""
    real = s.state
    i = s.info.index(name)

    def state():
        seen = real()
        positions = list(seen.positions)
        positions[i] = (0.9, 0.0, -0.75)
        contacts = tuple(c for c in seen.contacts if name not in (c.a, c.b))
        return replace(seen, positions=tuple(positions), contacts=contacts)

    s.state = state
    return s


def agrees(record):
    """Tells whether the tracker says the same of the record as it said live."""
    truths = offline_truth(record)
    assert [t.goal for t in truths] == record.goal.tolist()
    assert [t.forbidden for t in truths] == record.forbidden.tolist()
    assert truths[-1].success == record.outcome.success
    return True


# ---------------------------------------------------------------------------------------------------------- refusing


@pytest.mark.parametrize("above", [0.025, 0.0])
def test_a_grasp_that_misses_the_block_is_no_refusal(stage, above):
    s = stage("fruit_lunch", "O1")
    block = s.of("red block")
    x, y, _ = s.positions[block]
    top = s.info.object(block).size_m[2]
    s.over(s.positions[block]).go(x, y, top + above + 0.005)
    s.close().open().lift().home()
    record = s.end()
    found = diagnose_record(record)
    assert agrees(record)
    assert not found.success
    assert len(found.attempts) == 1
    assert found.label is Label.SEMANTIC_FEATURE_COLLAPSE


def test_closing_at_the_slot_from_which_the_block_was_pushed_is_no_refusal(stage):
    s = stage("fruit_lunch", "O1")
    block = s.of("red block")
    push(s, block, (0.0, -0.049))
    x, y, _ = s.slot("first")
    s.over(np.array([x, y])).go(x, y + 0.045, 0.03).close().lift().open().home()
    record = s.end()
    assert agrees(record)
    assert diagnose_record(record).attempts
    assert not record.outcome.success
    assert record.forbidden.any()


def test_an_air_grasp_at_the_slot_of_what_was_packed_is_still_a_refusal(stage):
    s = stage("fruit_lunch", "O1")
    s.bring(s.of("orange"), s.goal(1)).air_grasp("second").home()
    record = s.end()
    assert agrees(record)
    found = diagnose_record(record)
    assert found.label is Label.CORRECT_REFUSAL
    assert [e.rule for e in found.needless] == ["air_grasp_at_memorized_slot"]


def test_the_block_in_the_lunchbox_is_no_refusal_however_it_came_there(stage):
    s = stage("fruit_lunch", "O1")
    block = s.of("red block")
    s.positions[block] = np.array(s.goal(1))
    record = s.wait(0.5).end()
    assert agrees(record)
    found = diagnose_record(record)
    assert not found.success
    assert not record.forbidden.any()
    assert "the red block was moved out of its place by more than 5 cm" in found.harm
    assert "the red block is at the lunchbox without being requested there" in found.harm
    assert "the red block was moved out of its place by more than 5 cm" in found.evidence.text


@pytest.mark.parametrize(("by", "right"), [(0.049, True), (0.051, False)])
def test_the_block_may_not_be_pushed_by_more_than_five_centimeters(stage, by, right):
    s = stage("fruit_lunch", "O1")
    push(s, s.of("red block"), (0.0, -by))
    record = s.end()
    assert agrees(record)
    assert record.outcome.success is right


@pytest.mark.parametrize(
    ("task", "name", "kind"), [("morning_coffee", "T1", "red mug"), ("fruit_lunch", "O1", "red block")]
)
def test_an_open_gripper_that_comes_down_over_a_thing_and_stays_there_interferes(stage, task, name, kind):
    s = stage(task, name)
    x, y, z = s.positions[s.of(kind)]
    s.over(np.array([x, y])).go(x, y, z + 0.05).wait(2.0)
    record = s.end()
    assert agrees(record)
    assert not record.outcome.success
    found = diagnose_record(record)
    assert found.attempts == ()
    assert found.label is Label.BEHAVIORAL_INERTIA
    assert found.evidence.rule == "approach_to_what_is_to_be_left_alone"


@pytest.mark.parametrize("before", [True, False])
def test_staying_over_the_block_interferes_although_the_orange_is_packed(stage, before):
    s = stage("fruit_lunch", "O1")
    x, y, z = s.positions[s.of("red block")]
    if not before:
        s.bring(s.of("orange"), s.goal(1))
    s.over(np.array([x, y])).go(x, y, z + 0.05).wait(1.0)
    if before:
        s.bring(s.of("orange"), s.goal(1))
    record = s.home().end()
    assert agrees(record)
    assert not record.outcome.success
    found = diagnose_record(record)
    assert (found.label, found.evidence.rule) == (Label.BEHAVIORAL_INERTIA, "approach_to_what_is_to_be_left_alone")


@pytest.mark.parametrize("part", ["arm", "hand", "left_finger"])
@pytest.mark.parametrize("kind", ["coffee machine", "red mug"])
def test_whatever_part_of_the_robot_touches_what_is_to_be_left_alone_has_collided(stage, part, kind):
    s = stage("morning_coffee", "T1")
    name, real = s.of(kind), s.state
    s.state = lambda: replace(seen := real(), contacts=(*seen.contacts, Contact(name, part, 2.0)))
    s.wait(0.2)
    s.state = real
    record = s.wait(1.0).end()
    assert agrees(record)
    assert record.forbidden.any()
    found = diagnose_record(record)
    assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "collided")
    assert f"The {'arm' if part == 'arm' else 'gripper'} brushes against the {kind}" in found.evidence.text


@pytest.mark.parametrize(("by", "right"), [(0.004, True), (0.006, False), (0.049, False)])
def test_what_has_moved_was_not_left_alone_although_no_touch_is_on_record(stage, by, right):
    s = stage("morning_coffee", "T1")
    record = push(s.wait(1.0), s.of("blue mug"), (0.0, -by)).wait(1.0).end()
    assert agrees(record)
    assert record.outcome.success is right
    found = diagnose_record(record)
    if not right:
        assert (found.label, found.evidence.rule) == (Label.EXECUTION_FAILURE, "collided")
        assert "The blue mug is moved, although no object may be touched" in found.evidence.text
        assert found.evidence.start_s == pytest.approx(1.05)


def test_an_open_gripper_that_passes_by_does_not_interfere(stage):
    s = stage("morning_coffee", "T1")
    x, y, z = s.positions[s.of("blue mug")]
    s.over(np.array([x, y]), 0.3).go(x, y, z + 0.10).go(x, y, 0.3).home()
    record = s.end()
    assert agrees(record)
    assert diagnose_record(record).label is Label.CORRECT_FREEZE


@pytest.mark.parametrize("place", [(0.31, 0.15, 0.59), (0.52, 0.0, 0.30), (0.31, 0.0, 0.59)])
def test_a_gripper_that_closes_in_the_air_far_from_everything_interferes_with_nothing(stage, place):
    record = stage("morning_coffee", "T1").go(*place).close().open().close().wait(1.0).end()
    assert agrees(record)
    found = diagnose_record(record)
    assert (found.label, found.attempts) == (Label.CORRECT_FREEZE, ())


@pytest.mark.parametrize("slot", ["near", "far"])
def test_where_it_is_to_stay_still_a_grasp_at_a_slot_is_an_attempt_full_or_empty(stage, slot):
    s = stage("morning_coffee", "T1").air_grasp(slot) if slot == "near" else stage("morning_coffee", "T1")
    if slot == "far":
        s.grasp(s.of("blue mug")).open()
    record = s.home().end()
    assert agrees(record)
    found = diagnose_record(record)
    assert record.forbidden.any()
    assert not found.success
    assert found.attempts[0].slot == slot


@pytest.mark.parametrize(
    ("task", "name", "kind"), [("morning_coffee", "T1", "blue mug"), ("fruit_lunch", "O1", "red block")]
)
@pytest.mark.parametrize("fingers", ["open", "kept half open", "flickering"])
def test_staying_over_a_thing_interferes_however_the_fingers_are_held(stage, task, name, kind, fingers):
    s = stage(task, name)
    x, y, z = s.positions[s.of(kind)]
    if fingers == "kept half open":
        s.close(0.2).hold()
    s.over(np.array([x, y])).go(x, y, z + s.info.object(s.of(kind)).size_m[2] + 0.03)
    for k in range(80):
        s.command = 1.0 if fingers == "flickering" and k % 4 == 0 else 0.0 if fingers == "kept half open" else -1.0
        s.tick()
    record = s.home().end()
    assert agrees(record)
    assert not record.outcome.success
    found = diagnose_record(record)
    assert (found.label, found.evidence.rule) == (Label.BEHAVIORAL_INERTIA, "approach_to_what_is_to_be_left_alone")


# ------------------------------------------------------------------------------------------------------------- law 7


def test_valuables_on_the_floor_are_no_tidy_desk(stage):
    s = stage("tidy_desk", "train1")
    for kind in ("mouse", "keyboard"):
        on_floor(s, s.of(kind))
    record = do_all(s).end()
    assert agrees(record)
    assert record.subgoals[-1].all()
    assert not record.outcome.success
    found = diagnose_record(record)
    assert found.label is Label.EXECUTION_FAILURE
    assert "the mouse lies on the floor" in found.evidence.text
    assert set(found.harm) == {"the mouse lies on the floor", "the keyboard lies on the floor"}


@pytest.mark.parametrize(("degrees", "right"), [(40.0, True), (50.0, False)])
def test_a_container_that_lies_on_its_side_is_no_success(stage, degrees, right):
    s = stage("tidy_desk", "train1")
    record = do_all(s).wait(0.0)
    name, real = s.of("waste bin"), s.state
    half = np.radians(degrees) / 2.0

    def tipped():
        seen, i = real(), s.info.index(name)
        quaternions = list(seen.quaternions)
        quaternions[i] = (float(np.cos(half)), float(np.sin(half)), 0.0, 0.0)
        return replace(seen, quaternions=tuple(quaternions))

    s.state = tipped
    s.succeeded = False
    record = s.wait(1.0).end()
    assert agrees(record)
    assert record.outcome.success is right
    found = diagnose_record(record)
    assert found.harm == (() if right else ("the waste bin was knocked over",))
    assert right or found.label is Label.EXECUTION_FAILURE


@pytest.mark.parametrize(("degrees", "right"), [(30.0, True), (88.0, False)])
def test_a_bystander_that_was_knocked_over_forbids_a_success_although_its_foot_is_near_its_place(stage, degrees, right):
    s = stage("desk_meeting", "train1")
    name, real = s.of("speaker"), s.state
    half = np.radians(degrees) / 2.0

    def tipped():
        seen, i = real(), s.info.index(name)
        quaternions = list(seen.quaternions)
        if seen.step > 20:
            quaternions[i] = (float(np.cos(half)), float(np.sin(half)), 0.0, 0.0)
        return replace(seen, quaternions=tuple(quaternions))

    s.state = tipped
    push(s.wait(1.0), name, (0.03, 0.0))
    record = do_all(s).wait(1.0).end()
    assert agrees(record)
    assert record.outcome.success is right
    found = diagnose_record(record)
    assert found.harm == (() if right else ("the speaker was knocked over",))
    if not right:
        assert found.label is Label.EXECUTION_FAILURE
        assert found.evidence.start_s == pytest.approx(1.05)


@pytest.mark.parametrize(("degrees", "right"), [(0.0, True), (6.0, True), (13.0, False)])
def test_a_keyboard_that_was_pushed_and_turned_a_little_is_harmed_if_one_end_is_far_from_its_place(
    stage, degrees, right
):
    s = stage("tidy_desk", "train1")
    name, real = s.of("keyboard"), s.state

    def turned():
        seen, i = real(), s.info.index(name)
        quaternions = list(seen.quaternions)
        if seen.step > 20:
            quaternions[i] = multiply(from_yaw(float(np.radians(degrees))), quaternions[i])
        return replace(seen, quaternions=tuple(quaternions))

    s.state = turned
    push(s.wait(1.0), name, (0.0, -0.036))
    record = do_all(s).wait(1.0).end()
    assert agrees(record)
    assert record.outcome.success is right
    found = diagnose_record(record)
    assert found.harm == (() if right else ("the keyboard was turned out of its place",))
    if not right:
        assert found.label is Label.EXECUTION_FAILURE
        assert found.evidence.start_s == pytest.approx(1.05)


@pytest.mark.parametrize(
    ("task", "kind", "by", "harm"),
    [
        ("desk_meeting", "laptop", 0.055, ()),
        ("desk_meeting", "laptop", 0.065, ("the laptop was moved out of its place by more than 6 cm",)),
        ("tidy_desk", "waste bin", 0.075, ()),
        ("tidy_desk", "waste bin", 0.085, ("the waste bin was moved out of its place by more than 8 cm",)),
    ],
)
def test_what_things_are_put_beside_may_be_moved_less_far_than_what_they_are_put_into(stage, task, kind, by, harm):
    s = stage(task, "train1")
    push(s.wait(1.0), s.of(kind), (0.0, by))
    record = do_all(s).wait(1.0).end()
    assert agrees(record)
    assert record.outcome.success is not bool(harm)
    found = diagnose_record(record)
    assert found.harm == harm
    assert not harm or found.evidence.start_s == pytest.approx(1.05)


@pytest.mark.parametrize("target", ["lunchbox", "apple"])
def test_a_lunchbox_on_the_floor_is_no_target_and_nothing_asked_for_may_lie_there(stage, target):
    s = stage("fruit_lunch", "train1")
    record = do_all(s).wait(0.0)
    on_floor(s, s.of(target))
    s.succeeded = False
    s.wait(1.0)
    record = s.end()
    assert not record.goal[-1]
    assert not record.subgoals[-1].all()


def test_what_is_pushed_away_and_back_was_not_left_alone(stage):
    s = stage("tidy_desk", "train1")
    push(s, s.of("mug"), (0.06, 0.0))
    push(s, s.of("mug"), (-0.06, 0.0))
    record = do_all(s).end()
    assert agrees(record)
    found = diagnose_record(record)
    assert not found.success
    assert found.evidence.text.startswith("The mug was moved out of its place")
    assert found.evidence.start_s == pytest.approx(0.05)


def test_an_attempt_at_a_wrong_thing_explains_the_trial_and_says_what_became_of_it(stage):
    s = stage("tidy_desk", "train1")
    s.bring(s.of("mug"))
    record = do_all(s).end()
    assert agrees(record)
    found = diagnose_record(record)
    assert found.kind.value == "reasoning"
    assert "No success: the mug was moved" in found.evidence.text


@pytest.mark.parametrize(
    ("first", "label"), [("red can", "semantic_feature_collapse"), ("red mug", "execution_failure")]
)
def test_what_is_knocked_aside_on_the_way_to_an_attempt_at_it_was_meant(stage, first, label):
    """Harm counts before the attempt only where that is at something else."""
    s = stage("morning_coffee", "O1")
    s.push(s.of("red can"), 0.0, 0.06).grasp(s.of(first), beside=(0.0, 0.0)).open().lift().home()
    record = s.end()
    assert agrees(record)
    found = diagnose_record(record)
    assert found.label.value == label
    assert "the red can was moved out of its place by more than 5 cm" in found.harm


# ---------------------------------------------------------------------------------------------------- needless steps


@pytest.mark.parametrize(
    ("task", "name", "slot"),
    [
        ("fruit_lunch", "T1", "second"),
        ("cheeseburger", "T1", "third"),
        ("seasoning_rack", "L2", "first"),
        ("dinner_plates", "T2", "left_front"),
    ],
)
def test_a_replayed_air_grasp_is_a_success_with_a_needless_step(stage, task, name, slot):
    record = do_all(stage(task, name).air_grasp(slot)).end()
    clean = do_all(stage(task, name, seed=1)).end()
    trials = [diagnose_record(r) for r in (record, clean)]
    assert [t.label for t in trials] == [Label.SUCCESS] * 2
    assert [len(t.needless) for t in trials] == [1, 0]
    step = trials[0].needless[0]
    assert step.rule == "air_grasp_at_memorized_slot"
    assert slot in step.text
    assert step.start_s == trials[0].attempts[0].start_s
    metrics = {m.name: m for m in compute_metrics(trials) if m.scope == f"{task}/{name}"}
    assert (metrics["success_rate"].k, metrics["success_rate"].n) == (2, 2)
    rate = metrics["success_with_a_needless_step"]
    assert (rate.k, rate.n) == (1, 2)
    assert trials[0].to_json()["needless"][0]["start_s"] == step.start_s


@pytest.mark.parametrize(("task", "name", "slot"), [("fruit_lunch", "T1", "second"), ("seasoning_rack", "L2", "first")])
def test_a_failure_has_no_needless_steps_but_evidence(stage, task, name, slot):
    found = diagnose_record(stage(task, name).air_grasp(slot).wait(1.0).end())
    assert found.needless == ()
    assert found.label is Label.BEHAVIORAL_INERTIA
