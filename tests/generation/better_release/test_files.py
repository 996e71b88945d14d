"""The reader of a release: what it reads, and every way in which a file can be wrong."""

from __future__ import annotations

import os

import pytest
from tests.generation.better_release.writing import APPLE, BOX, LAYOUT, LEMON, ORANGE, clone, lunch, thing, write_task

from betterbench.errors import InvalidInputError
from betterbench.generation.better_release import find_tasks, resolve


def test_a_task_is_found_in_a_clone_and_in_its_own_folder(tmp_path, reading):
    root = clone(tmp_path / "clone", lunch())
    folder = root / "assets" / "tasks" / "loose_packing" / "Picnic"
    assert find_tasks(root) == find_tasks(folder) == (folder,)
    assert reading(root).task.task_id == "Picnic"
    with pytest.raises(InvalidInputError, match=r"neither a task\.yaml nor"):
        find_tasks(tmp_path)
    with pytest.raises(InvalidInputError, match="is not a folder"):
        find_tasks(tmp_path / "absent")


def test_variations_inherit_from_the_base(tmp_path, reading):
    files = lunch()
    files["base_variation.yaml"]["policy_overrides"] = {"fail": {"append": [_predicate(ORANGE, "near", APPLE)]}}
    files["variations/TV-02.yaml"]["policy_overrides"] = {
        "success": {"append": [_predicate(APPLE, "near", LEMON)]},
        "fail": {"remove": [_predicate(ORANGE, "on", BOX)]},
    }
    first, second, test = resolve(reading(write_task(tmp_path, files))).values()
    assert [str(p) for p in first.success] == [f"in({APPLE}, {BOX})", f"in({ORANGE}, {BOX})"]
    assert [str(p) for p in first.fail] == [f"{r}({n}, {BOX})" for n in ("can_1", LEMON) for r in ("in", "on")]
    assert second.groups == {"goal": (APPLE, LEMON), "fail": ("can_1", ORANGE), "decor": ()}
    assert f"near({APPLE}, {LEMON})" in map(str, second.success)
    # the overrides of the base are not inherited; the variation removes one predicate that follows from its group
    assert {str(p) for p in second.fail} == {f"in(can_1, {BOX})", f"on(can_1, {BOX})", f"in({ORANGE}, {BOX})"}
    assert (first.training, second.training, test.training) == (True, True, False)
    assert test.xy(APPLE) == (LAYOUT[ORANGE]["position"][0], LAYOUT[ORANGE]["position"][1])
    assert test.instruction == files["task.yaml"]["instruction"]


def test_a_replaced_list_takes_the_place_of_the_derived_one(tmp_path, reading):
    files = lunch()
    wanted = [_predicate(LEMON, "in", BOX)]
    files["variations/EV-01.yaml"]["policy_overrides"] = {"success": {"replace": wanted}, "fail": {"replace": []}}
    test = resolve(reading(write_task(tmp_path, files)))["EV-01"]
    assert (tuple(map(str, test.success)), test.fail) == ((f"in({LEMON}, {BOX})",), ())


def _predicate(subject, relation, target):
    return {"subject_id": subject, "relation": relation, "target_id": target}


BOMB = "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\n"

# by name: the file, its content or a change of it, and words of the message
WRONG = {
    "bomb": ("task.yaml", BOMB, "task.yaml: the file uses a YAML alias"),
    "large": ("task.yaml", "task_id: Picnic\n# " + "x" * 10_000_000, "is larger than"),
    "python": ("task.yaml", "task_id: !!python/object/apply:os.system ['true']\n", "task.yaml: the file is not YAML"),
    "deep": ("task.yaml", "a: " + "[" * 2000 + "]" * 2000, "nested too deep"),
    "empty": ("task.yaml", "", "contains no fields"),
    "a list": ("variations/EV-01.yaml", "- 1\n", "contains no fields"),
    "twice": ("task.yaml", "task_id: A\ntask_id: B\n", "task_id is given twice"),
    "not YAML": ("asset_bindings.yaml", "a: [", "asset_bindings.yaml: the file is not YAML"),
    "a date": ("task.yaml", "task_id: 2026-01-01\n", "task.yaml: is not JSON"),
    "key": ("task.yaml", lambda f: f.update(tusk_id=1), "task.yaml: tusk_id: is unknown"),
    "missing key": ("task.yaml", lambda f: f.pop("instruction"), "task.yaml: instruction: is missing"),
    "boolean": (
        "task.yaml",
        lambda f: f["defaults"]["fail_policy"].update(fail_on_relations=["in", True]),
        "fail_on_relations[1]: Input should be a valid string, not True. Quote the words on,",
    ),
    "number": ("variations/EV-01.yaml", lambda f: f["pose_overrides"][APPLE].update(position=[0.1, 0.2]), "position"),
    "text": (
        "base_variation.yaml",
        lambda f: f["pose_overrides"][BOX].update(position=[0.1, "far", 0.2]),
        "base_variation.yaml: pose_overrides.box_1.position[1]",
    ),
    "infinite": (
        "base_variation.yaml",
        lambda f: f["pose_overrides"][BOX].update(position=[0.1, float("nan"), 0]),
        "finite",
    ),
    "far away": ("base_variation.yaml", lambda f: f["pose_overrides"][BOX].update(position=[1e6, 0, 0]), "less than"),
    "rotation": (
        "base_variation.yaml",
        lambda f: f["pose_overrides"][BOX].update(rotation=[0.0, 0.0, 0.0, 0.0]),
        "pose_overrides.box_1.rotation: is not a rotation",
    ),
    "escape": ("task.yaml", lambda f: f.update(instruction="Pack \x1b[31m it."), "unprintable"),
    "bidirectional": ("task.yaml", lambda f: f.update(instruction="Pack \u202e it."), "unprintable"),
    "id": (
        "object_universe.yaml",
        lambda f: f["goal_objects"][0].update(instance_id="../../etc"),
        "goal_objects[0].inst",
    ),
    "same id": (
        "object_universe.yaml",
        lambda f: f["goal_objects"][1].update(instance_id=APPLE),
        "goal_objects[1].instance_id: 'apple_1' occurs twice",
    ),
    "many objects": (
        "object_universe.yaml",
        lambda f: f["goal_objects"].extend(thing(f"apple_{i}", "apple", "apple") for i in range(2, 200)),
        "lists 204 objects. Use at most 100 objects",
    ),
    "no container": ("object_universe.yaml", lambda f: f.update(container=[]), "container: is empty"),
    "path": (
        "asset_bindings.yaml",
        lambda f: f["bindings"][BOX]["candidates"][0].update(registry_usd="../../../secret.usd"),
        "registry_usd: is a path outside the release folder",
    ),
    "registry path": (
        "task.yaml",
        lambda f: f["variation_registry"].update(eval=["../EV-01"]),
        "variation_registry.eval",
    ),
    "no training": (
        "task.yaml",
        lambda f: f["variation_registry"].update(train=[]),
        "variation_registry.train: is empty",
    ),
    "listed twice": ("task.yaml", lambda f: f["variation_registry"].update(eval=["TV-01"]), "'TV-01' is listed twice"),
    "no file": (
        "task.yaml",
        lambda f: f["variation_registry"].update(eval=["EV-01", "EV-02"]),
        "Unknown file of variations 'EV-02'. Did you mean",
    ),
    "not listed": ("task.yaml", lambda f: f["variation_registry"].update(eval=[]), "does not list 'EV-01'"),
    "cycle": (
        "variations/EV-01.yaml",
        lambda f: f.update(extends="EV-01"),
        "extends: 'EV-01' is not the base variation",
    ),
    "two levels": ("variations/EV-01.yaml", lambda f: f.update(extends="TV-01"), "one level of inheritance"),
    "base extends": ("base_variation.yaml", lambda f: f.update(extends="EV-01"), "the base variation extends another"),
    "other name": ("variations/EV-01.yaml", lambda f: f.update(variation_id="EV-02"), "is not the name of the file"),
    "predicate": (
        "variations/EV-01.yaml",
        lambda f: f.update(policy_overrides={"fail": {"remove": [{"subject_id": APPLE, "relation": "in"}]}}),
        "policy_overrides.fail.remove[0].target_id: is missing",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, reading, case):
    name, change, said = WRONG[case]
    files = lunch()
    if isinstance(change, str):
        files[name] = change
    else:
        change(files[name])
    with pytest.raises(InvalidInputError) as caught:
        reading(write_task(tmp_path, files))
    text = str(caught.value)
    assert said in text, text
    assert str(tmp_path) in text
    assert len(text) < 1200
    assert "\n" not in text


@pytest.mark.parametrize("name", ["task.yaml", "object_universe.yaml", "base_variation.yaml"])
def test_a_missing_file_is_named(tmp_path, reading, name):
    files = lunch()
    folder = write_task(tmp_path / "Picnic", files)
    (folder / name).unlink()
    with pytest.raises(InvalidInputError, match=name):
        reading(folder)


def test_a_link_out_of_the_folder_is_refused(tmp_path, reading):
    folder = write_task(tmp_path / "Picnic", lunch())
    other = tmp_path / "other.yaml"
    other.write_text("variation_id: EV-01\n")
    (folder / "variations" / "EV-01.yaml").unlink()
    (folder / "variations" / "EV-01.yaml").symlink_to(other)
    with pytest.raises(InvalidInputError, match="leads out of"):
        reading(folder)


def test_a_pipe_is_not_waited_for(tmp_path, reading):
    folder = write_task(tmp_path / "Picnic", lunch())
    (folder / "base_variation.yaml").unlink()
    os.mkfifo(folder / "base_variation.yaml")
    with pytest.raises(InvalidInputError, match="not a regular file"):
        reading(folder)
