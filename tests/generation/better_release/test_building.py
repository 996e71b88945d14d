"""The task in our form: its conditions, operations and axes, and what cannot be represented."""

from __future__ import annotations

import pytest
from tests.generation.better_release.test_audit import ev, new_goal
from tests.generation.better_release.writing import (
    APPLE,
    BLOCK,
    BOX,
    CAN,
    LAYOUT,
    LEMON,
    ORANGE,
    lunch,
    pose,
    thing,
    write_task,
)

from betterbench.errors import UnknownNameError
from betterbench.generation.better_release.building import operations_between
from betterbench.tasks import Axis, task_from_json, task_to_json
from betterbench.tasks.interventions import vary


def test_the_task_has_the_goals_and_the_order_of_the_release(tmp_path, imported):
    found = imported(write_task(tmp_path, lunch()))
    task = found.built.task
    assert task.id == "better_picnic"
    assert task_from_json(task_to_json(task)) == task
    first, second = task.training
    assert [g.name for g in first.instruction.subgoals] == ["inside_apple", "inside_orange"]
    assert [g.name for g in second.instruction.subgoals] == ["inside_apple", "inside_lemon"]
    assert second.instruction.text == "Put the apple and the lemon into the box."
    assert {o.name: o.role for o in first.objects} == {
        BOX: "container",
        APPLE: "item",
        ORANGE: "item",
        LEMON: "item",
        CAN: "distractor",
    }
    where = {name: task.slot(slot) for name, slot in first.layout.items()}
    assert where[APPLE].y < where[BOX].y < where[ORANGE].y
    assert where[APPLE].x < where[LEMON].x
    (variation,) = task.variations
    assert (variation.name, variation.axis, variation.base) == ("L1", Axis.SPATIAL_LAYOUT_SHIFT, "train1")
    assert [o.name for o in variation.interventions] == ["swap"]
    changed, _ = vary(task, variation)
    assert changed.layout[APPLE] == first.layout[ORANGE]


def replaced(files):
    ev(files).update(remove_goal_objects=[APPLE], add_goal_objects=[BLOCK], pose_overrides={BLOCK: LAYOUT[APPLE]})


def added(files):
    ev(files).update(add_fail_objects=[BLOCK], pose_overrides={BLOCK: pose(0.40, 0.02)})


def recomposed(files):
    ev(files).update(add_goal_objects=[LEMON], remove_goal_objects=[APPLE], pose_overrides={})
    ev(files)["instruction"] = "Put the orange and the lemon into the box."


def longer(files):
    ev(files).update(add_goal_objects=[LEMON], remove_fail_objects=[LEMON], pose_overrides={})
    ev(files)["instruction"] = "Put the apple, the orange and the lemon into the box."


def placed_already(files):
    ev(files)["pose_overrides"] = {APPLE: pose(0.55, 0.0)}


def cycled(files):
    places = {APPLE: LAYOUT[ORANGE], ORANGE: LAYOUT[LEMON], LEMON: LAYOUT[APPLE]}
    ev(files)["pose_overrides"] = places


def moved_target(files):
    ev(files)["pose_overrides"] = {BOX: pose(0.50, 0.06)}


# by change of the test variation: axis, training condition and operations
DERIVED = {
    replaced: ("O1", "train1", ["replace", "instruct"]),
    added: ("O1", "train1", ["add"]),
    recomposed: ("R1", "train1", ["instruct"]),
    longer: ("T1", "train1", ["chain"]),
    placed_already: ("T1", "train1", ["preplace"]),
    cycled: ("L1", "train1", ["swap", "swap"]),
    moved_target: ("L1", "train1", ["move"]),
    new_goal: ("O1", "train1", ["replace", "instruct"]),
}


@pytest.mark.parametrize("change", DERIVED, ids=lambda change: change.__name__)
def test_operations_and_axis_follow_from_the_difference(tmp_path, imported, change):
    files = lunch()
    change(files)
    if change in (replaced, new_goal):  # without the fruit that the release would leave in the scene
        files["base_variation.yaml"]["pose_overrides"].pop(APPLE)
        for name in ("TV-01", "TV-02"):
            files[f"variations/{name}.yaml"]["pose_overrides"] = {APPLE: LAYOUT[APPLE]}
    found = imported(write_task(tmp_path, files))
    (variation,) = found.built.task.variations
    assert (variation.name, variation.base, [o.name for o in variation.interventions]) == DERIVED[change]
    assert found.built.variations["EV-01"].name == variation.name


def test_the_nearest_training_condition_is_the_base(tmp_path, imported):
    files = lunch()
    ev(files).update(files["variations/TV-02.yaml"] | {"variation_id": "EV-01"})
    ev(files)["pose_overrides"] = {APPLE: LAYOUT[ORANGE], ORANGE: LAYOUT[APPLE]}
    (variation,) = imported(write_task(tmp_path, files)).built.task.variations
    assert (variation.base, [o.name for o in variation.interventions]) == ("train2", ["swap"])


def test_an_object_left_behind_is_replaced_in_our_form(tmp_path, imported):
    files = lunch()
    new_goal(files)
    found = imported(write_task(tmp_path, files))
    assert found.built.variations["EV-01"].left_out == {APPLE: f"replaced by {BLOCK}"}
    assert [o.name for o in found.built.task.variations[0].interventions] == ["replace", "instruct"]


def test_goals_without_a_counterpart_are_named(tmp_path, imported):
    files = lunch()
    near = {"subject_id": APPLE, "relation": "near", "target_id": BOX}
    ev(files)["policy_overrides"] = {"success": {"append": [near]}}
    found = imported(write_task(tmp_path, files))
    shown = found.built.variations["EV-01"]
    assert (shown.name, shown.reasons) == (None, (f"near({APPLE}, {BOX}) has no counterpart",))
    assert found.built.task.variations == ()
    assert "not_represented" in {f.code for f in found.audit.of("EV-01")}


def test_a_task_without_any_counterpart_is_audited_all_the_same(tmp_path, imported):
    files = lunch()
    files["base_variation.yaml"]["goal_relation"] = "near"
    found = imported(write_task(tmp_path, files))
    assert found.task_id is None
    assert all(shown.name is None for shown in found.built.variations.values())
    assert {f.code for f in found.audit.of("TV-01")} >= {"not_represented"}


def test_a_variation_without_an_instruction_is_not_represented(tmp_path, imported):
    files = lunch()
    ev(files)["instruction"] = "  "
    found = imported(write_task(tmp_path, files))
    assert found.built.variations["EV-01"].reasons == ("it has no instruction",)
    assert {f.code for f in found.audit.of("EV-01")} == {"undecided", "not_represented"}


def test_objects_go_onto_a_plate_where_the_target_is_one(tmp_path, imported):
    files = lunch()
    files["object_universe.yaml"]["container"] = [thing(BOX, "serving_plate", "serving plate", "A white plate.")]
    files["base_variation.yaml"] |= {"goal_relation": "on", "set_goal_objects": [APPLE], "set_fail_objects": [CAN]}
    files["task.yaml"]["instruction"] = "Put the apple onto the plate."
    files["variations/TV-02.yaml"] = {"variation_id": "TV-02"}
    found = imported(write_task(tmp_path, files))
    task = found.built.task
    assert task.template.name == "recursive_stacking"
    (goal,) = task.training[0].instruction.subgoals
    assert (goal.relation, goal.target) == ("on_plate", BOX)
    assert found.built.variations["TV-02"].name == "train1"  # it does not differ from the first


def test_objects_without_a_similar_asset_need_a_choice(tmp_path, imported):
    files = lunch()
    files["object_universe.yaml"]["goal_objects"][0] = thing(APPLE, "quux", "quux", "A quux.")
    found = imported(write_task(tmp_path, files))
    assert APPLE not in found.matches
    assert f"{APPLE}: no similar asset in our library" in found.built.variations["TV-01"].reasons
    given = imported(tmp_path, **{APPLE: "sponge"})
    match = given.matches[APPLE]
    assert (match.category, match.score, match.how) == ("sponge", 1.0, "given")
    assert given.built.task is not None
    assert [f.objects for f in given.audit.of("") if f.code == "stand_in"] == [(APPLE,)]
    assert not imported(write_task(tmp_path, lunch()), **{APPLE: "apple"}).matches[APPLE].is_stand_in
    with pytest.raises(UnknownNameError, match="Did you mean 'sponge'"):
        imported(tmp_path, **{APPLE: "spongge"})
    with pytest.raises(UnknownNameError, match="object of the task"):
        imported(tmp_path, nothing="sponge")


def test_a_color_that_no_asset_has_is_named(tmp_path, imported):
    files = lunch()
    files["object_universe.yaml"]["goal_objects"][0] = thing(APPLE, "apple", "blue apple", "A blue apple.")
    (finding,) = imported(write_task(tmp_path, files)).audit.of("")
    assert (finding.code, finding.objects, finding.level) == ("other_color", (APPLE,), "remark")


def test_a_stand_in_is_named_with_its_score(tmp_path, imported):
    files = lunch()
    files["object_universe.yaml"]["goal_objects"][0] = thing(APPLE, "banana", "ripe banana", "A yellow banana.")
    found = imported(write_task(tmp_path, files))
    match = found.matches[APPLE]
    assert match.is_stand_in
    assert match.category not in {found.matches[n].category for n in (ORANGE, LEMON)}
    (finding,) = [f for f in found.audit.of("") if f.code == "stand_in"]
    assert finding.numbers["score"] == match.score < 0.5


def test_operations_lead_to_the_wanted_condition_or_to_none(tmp_path, imported):
    task = imported(write_task(tmp_path, lunch())).built.task
    slots = {slot.name: slot for slot in task.slots}
    first, second = task.training
    assert operations_between(first, first, slots) == ()
    (operation,) = operations_between(first, second, slots)
    assert operation.name == "instruct"
    gone = second.with_(objects=second.objects[:1], layout={})  # its goals are not there
    assert operations_between(first, gone, slots) is None
