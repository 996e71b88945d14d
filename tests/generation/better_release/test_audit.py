"""The audit: a task without faults has no finding, and each planted fault is found with its numbers."""

from __future__ import annotations

import math

import pytest
from tests.generation.better_release.writing import (
    APPLE,
    BLOCK,
    BOX,
    CAN,
    LEMON,
    ORANGE,
    clone,
    lunch,
    pose,
    thing,
    write_task,
)

from betterbench.generation.better_release.audit import CODES

TEMPLATE = {
    "template_id": "loose_packing",
    "template_type": "loose_packing",
    "description": "Objects are packed.",
    "allowed_relations": ["in", True],
    "primary_goal_relation": "in",
    "fail_relations": ["in", True],
    "slots": [
        {"slot_name": "container", "group_hint": "container", "min_count": 1, "max_count": 1},
        {"slot_name": "target", "group_hint": "target", "min_count": 3, "max_count": 6},
        {"slot_name": "distractor", "group_hint": "distractor", "min_count": 1, "max_count": 4},
    ],
}


def test_a_clean_task_has_no_finding(tmp_path, imported):
    assert imported(write_task(tmp_path, lunch())).audit.findings == ()


def ev(files):
    return files["variations/EV-01.yaml"]


def moved(files):
    ev(files)["pose_overrides"] = {APPLE: pose(0.48, 0.24)}


def turned(files):
    files["object_universe.yaml"]["goal_objects"][0] = thing(APPLE, "stapler", "stapler")
    for name in ("TV-01", "TV-02", "EV-01"):
        said = files[f"variations/{name}.yaml"]
        text = said.get("instruction", files["task.yaml"]["instruction"])
        said["instruction"] = text.replace("apple", "stapler")
    ev(files)["pose_overrides"] = {APPLE: pose(0.40, -0.24, (0.5**0.5, 0.5**0.5))}


def far_target(files):
    ev(files)["pose_overrides"] = {BOX: pose(0.50, 0.06)}


def new_goal(files):
    block = pose(0.40, -0.225)
    ev(files).update(add_goal_objects=[BLOCK], remove_goal_objects=[APPLE], pose_overrides={BLOCK: block})
    ev(files)["instruction"] = "Put the block and the orange into the box."


def left(files):
    ev(files).update(remove_goal_objects=[APPLE], add_fail_objects=[BLOCK], pose_overrides={BLOCK: pose(0.41, -0.23)})
    ev(files)["instruction"] = "Put the orange into the box."


def other_words(files):
    ev(files)["instruction"] = "Put the lemon and the orange into the box."


def class_words(files):
    ev(files)["instruction"] = "Pack the fruits into the box."


def absent_words(files):
    ev(files)["instruction"] = "Put the apple, the orange and the banana into the box."


def other_box(files):
    ev(files)["instruction"] = "Put the apple and the orange into the can."


def negation(files):
    ev(files)["instruction"] = "Put all fruits except the lemon into the box."


def no_fails(files):
    ev(files)["policy_overrides"] = {
        "fail": {
            "remove": [{"subject_id": n, "relation": r, "target_id": BOX} for n in (CAN, LEMON) for r in ("in", "on")]
        }
    }


def one_fail_removed(files):
    ev(files)["policy_overrides"] = {"fail": {"remove": [{"subject_id": CAN, "relation": "in", "target_id": BOX}]}}


def useless(files):
    ev(files)["policy_overrides"] = {"fail": {"remove": [{"subject_id": BLOCK, "relation": "in", "target_id": BOX}]}}


def useless_member(files):
    ev(files)["remove_fail_objects"] = [BLOCK]


def unknown_member(files):
    ev(files)["add_goal_objects"] = ["pear_9"]


def no_pose(files):
    ev(files)["add_fail_objects"] = [BLOCK]


def no_candidate(files):
    del files["asset_bindings.yaml"]["bindings"][CAN]


def other_asset(files):
    ev(files)["pose_overrides"][APPLE] = pose(0.40, 0.24, selected_asset_id="stolen")


def two_groups(files):
    ev(files)["add_fail_objects"] = [APPLE]


def no_goal(files):
    ev(files)["set_goal_objects"] = []


def packed(files):
    ev(files)["pose_overrides"] = {APPLE: pose(0.55, 0.0)}


def packed_fail(files):
    ev(files)["pose_overrides"] = {CAN: pose(0.55, 0.01)}


def together(files):
    ev(files)["pose_overrides"] = {LEMON: pose(0.42, -0.24)}


def outside(files):
    ev(files)["pose_overrides"] = {CAN: pose(0.66, 0.40)}


def grouped_by_nobody(files):
    ev(files)["remove_fail_objects"] = [CAN]


def unchanged(files):
    del ev(files)["pose_overrides"]


def same_input(files):
    files["variations/TV-02.yaml"].pop("instruction")


def disabled(files):
    ev(files)["enabled"] = False


def odd_relation(files):
    ev(files)["policy_overrides"] = {
        "fail": {"append": [{"subject_id": CAN, "relation": "touching", "target_id": LEMON}]},
    }


# by planted fault: the code, the variation, the objects, and numbers with their values
PLANTED = {
    moved: ("pick_outside_support", "EV-01", {APPLE}, {"nearest_any_cm": 8.0, "nearest_own_cm": math.hypot(8, 48)}),
    turned: ("pick_outside_support", "EV-01", {APPLE}, {"turned_deg": 90.0}),
    far_target: ("place_outside_support", "EV-01", {BOX}, {"nearest_cm": math.hypot(5, 6)}),
    new_goal: ("pick_not_trained", "EV-01", {BLOCK}, {"training_picks": 0}),
    left: ("replaced_but_left", "EV-01", {APPLE, BLOCK}, {"apart_cm": math.hypot(1, 1)}),
    other_words: ("names_no_goal", "EV-01", {LEMON}, {"goals": 2}),
    class_words: ("names_more", "EV-01", {LEMON}, {"covered": 3, "goals": 2}),
    absent_words: ("names_absent", "EV-01", set(), {"objects": 0}),
    other_box: ("other_target", "EV-01", {BOX}, {}),
    negation: ("undecided", "EV-01", set(), {}),
    no_fails: ("no_fail_predicate", "EV-01", {CAN, LEMON}, {"fail_predicates": 0, "objects_without_rule": 2}),
    one_fail_removed: ("fail_predicates_removed", "EV-01", set(), {"fail_predicates": 3, "derived": 4}),
    useless: ("no_effect", "EV-01", {BLOCK}, {}),
    useless_member: ("no_effect", "EV-01", {BLOCK}, {}),
    unknown_member: ("absent_id", "EV-01", {"pear_9"}, {}),
    no_pose: ("no_pose", "EV-01", {BLOCK}, {}),
    no_candidate: ("no_candidate", "TV-01", {CAN}, {"candidates": 0}),
    other_asset: ("other_asset", "EV-01", {APPLE}, {"candidates": 1}),
    two_groups: ("two_groups", "EV-01", {APPLE}, {}),
    no_goal: ("no_goal", "EV-01", set(), {"success_predicates": 0}),
    packed: ("met_at_start", "EV-01", {APPLE, BOX}, {"apart_cm": 0.0}),
    packed_fail: ("fails_at_start", "EV-01", {CAN, BOX}, {"apart_cm": 1.0}),
    together: ("overlap", "EV-01", {APPLE, LEMON}, {"apart_cm": 2.0}),
    outside: ("outside_our_table", "EV-01", {CAN}, {}),
    grouped_by_nobody: ("in_no_group", "EV-01", {CAN}, {}),
    unchanged: ("no_change", "EV-01", set(), {"largest_shift_cm": 0.0}),
    same_input: ("same_input_other_goals", "TV-02", {ORANGE, LEMON}, {"largest_shift_cm": 0.0}),
    disabled: ("disabled", "EV-01", set(), {}),
    odd_relation: ("no_counterpart", "EV-01", {CAN, LEMON}, {}),
}


@pytest.mark.parametrize("plant", PLANTED, ids=lambda plant: plant.__name__)
def test_a_planted_fault_is_found(tmp_path, imported, plant):
    files = lunch()
    plant(files)
    code, variation, objects, numbers = PLANTED[plant]
    findings = imported(write_task(tmp_path, files)).audit.of(variation)
    found = [f for f in findings if f.code == code]
    assert found, findings
    if objects:
        assert objects in [set(f.objects) for f in found]
    for name, value in numbers.items():
        assert any(f.numbers.get(name) == pytest.approx(value, abs=0.01) for f in found), found
    for finding in findings:
        assert finding.text.endswith(".")
        assert finding.code in CODES


def test_an_instruction_that_contradicts_its_goals_is_found_from_both_sides(tmp_path, imported):
    files = lunch()
    other_words(files)
    codes = {f.code for f in imported(write_task(tmp_path, files)).audit.of("EV-01")}
    assert {"names_no_goal", "goal_not_named"} <= codes


def test_an_undecided_instruction_is_not_called_a_fault(tmp_path, imported):
    files = lunch()
    negation(files)
    findings = imported(write_task(tmp_path, files)).audit.of("EV-01")
    assert [(f.code, f.level) for f in findings] == [("undecided", "remark")]


def test_the_template_is_compared(tmp_path, imported):
    audit = imported(clone(tmp_path, lunch(), TEMPLATE)).audit
    assert [(f.code, f.numbers["booleans"]) for f in audit.of("")] == [("template_boolean", 2)]
    sizes = [f.numbers for f in audit.of("EV-01") if f.code == "group_size"]
    assert sizes == [{"objects": 2, "least": 3, "most": 6}]


def test_a_goal_that_the_sentence_leaves_open_is_undecided(tmp_path, imported):
    files = lunch()
    ev(files)["instruction"] = "Pack the tools into the box."
    findings = {f.code for f in imported(write_task(tmp_path, files)).audit.of("EV-01")}
    assert "undecided" in findings
    assert "goal_not_named" not in findings
