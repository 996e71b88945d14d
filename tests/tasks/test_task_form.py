"""The JSON form of tasks: it gives back the same task, is loaded like a task file, and names every wrong field."""

from __future__ import annotations

import copy
import json
import os

import pytest
from tests.looping import each
from tests.tasks.forgetting import forgotten_tasks

from betterbench.errors import InvalidInputError
from betterbench.tasks import Operation, all_tasks, get_task, task_from_json, task_to_json
from betterbench.tasks.authoring.operations import operation
from betterbench.tasks.authoring.registry import notes_of
from betterbench.tasks.authoring.task_form import task_forms
from betterbench.tasks.interventions import vary
from betterbench.tasks.user_files import VARIABLE, code_of, options_for


@each("task", all_tasks(), lambda t: t.id)
def test_a_task_is_read_back_from_its_form(task):
    form = json.loads(json.dumps(task_to_json(task)))
    again = task_from_json(form)
    assert again == task
    assert task_from_json(json.dumps(form)) == task
    assert task_to_json(again) == form
    for variation in task.variations:
        assert vary(again, again.variation(variation.name)) == vary(task, variation)


def test_a_template_of_ones_own_is_written_whole():
    task = get_task("fruit_lunch")
    form = task_to_json(task)
    assert form["template"] == "loose_packing"
    slower = json.loads(json.dumps(form))
    from betterbench.tasks import template_to_json

    slower["template"] = template_to_json(task.template)
    slower["template"]["protocol"]["base_steps"] = 99
    read = task_from_json(slower)
    assert read.template.base_steps == 99
    assert task_to_json(read)["template"]["protocol"]["base_steps"] == 99


def spoiled(change):
    form = json.loads(json.dumps(task_to_json(get_task("office_drawer"))))
    change(form)
    return form


def _first_do(form):
    return next(v for v in form["variations"] if v["do"])["do"][0]


BAD = {
    "task: schema_version": lambda f: f.update(schema_version=True),
    "task: id": lambda f: f.update(id="../x"),
    "task: version": lambda f: f.update(version=0),
    "task: color: is unknown": lambda f: f.update(color="red"),
    "task: template: Unknown template 'container_loadin'. Did you mean 'container_loading'": lambda f: f.update(
        template="container_loadin"
    ),
    "task: template: meta: is missing. Compare it with the output of template_to_json": lambda f: f.update(
        template={"schema_version": 1}
    ),
    "task: slots: ": lambda f: f["slots"].append(f["slots"][0]),
    "task: slots[0].x": lambda f: f["slots"][0].update(x=3.0),
    "task: slots[1].y": lambda f: f["slots"][1].update(y="0.1"),
    "task: objects: ": lambda f: f["objects"].append(f["objects"][0]),
    "task: objects[0].role": lambda f: f["objects"][0].update(role="hero"),
    "task: training[0].objects[0]: Unknown object": lambda f: f["training"][0]["objects"].insert(0, "unicorn"),
    "task: training[1].layout: Unknown object of this condition": lambda f: f["training"][1]["layout"].update(u="a"),
    "task: training[0]: 'cabinet' starts in 0 places": lambda f: f["training"][0]["layout"].pop("cabinet"),
    "task: training[0].instruction.subgoals": lambda f: f["training"][0]["instruction"].update(subgoals=[]),
    "task: training[0].instruction.subgoals[0].relation: Unknown relation 'insid'. Did you mean 'inside'": lambda f: f[
        "training"
    ][0]["instruction"]["subgoals"][0].update(relation="insid"),
    "reference: must contain either a kind or a slot": lambda f: f["training"][0]["instruction"]["subgoals"][0][
        "reference"
    ].update(slot="x"),
    "task: variations[0].name": lambda f: f["variations"][0].update(name="X1"),
    "task: variations[0].base: Unknown training condition": lambda f: f["variations"][0].update(base="train99"),
    "task: variations: 'L1' is given twice": lambda f: f["variations"].append(f["variations"][0]),
    "do[0].operation: Unknown operation 'swop'. Did you mean 'swap'": lambda f: _first_do(f).update(operation="swop"),
    "do[0].speed: Unknown argument": lambda f: _first_do(f).update(speed=3),
    "do[0].a": lambda f: f["variations"][0].update(do=[{"operation": "swap", "a": 3, "b": "stapler"}]),
    "do[0].b: is missing": lambda f: f["variations"][0].update(do=[{"operation": "swap", "a": "stapler"}]),
    "task: variations[0].do[0]": lambda f: f["variations"][0].update(
        do=[{"operation": "draw_out", "drawer": "stapler", "distance_m": 0.1}]
    ),
    "distance_m": lambda f: f["variations"][0].update(
        do=[{"operation": "draw_out", "drawer": "lower", "distance_m": float("inf")}]
    ),
}


@each("field", BAD, str)
def test_a_wrong_field_is_named(field):
    with pytest.raises(InvalidInputError) as caught:
        task_from_json(spoiled(BAD[field]))
    assert field in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_condition_that_leaves_its_template_is_refused():
    form = spoiled(
        lambda f: f["objects"].append({"name": "tray", "kind": "tray", "category": "cup", "role": "fixture"})
    )
    form["training"][0]["objects"] += ["tray"]
    form["slots"].append({"name": "free", "x": 0.5, "y": 0.3})
    form["training"][0]["layout"]["tray"] = "free"
    with pytest.raises(InvalidInputError, match=r"training\[0\].*group"):
        task_from_json(form)


def test_names_that_the_form_cannot_distinguish_are_refused():
    from dataclasses import replace

    task = get_task("fruit_lunch")
    other = replace(task.training[0].objects[0], kind="pear")
    training = (*task.training, task.training[0].with_(objects=(other, *task.training[0].objects[1:])))
    with pytest.raises(InvalidInputError, match="two different objects or slots are named"):
        task_to_json(replace(task, training=training))


def test_an_argument_without_a_json_form_is_refused():
    @operation
    def shuffle(condition, order: tuple):
        return condition, None

    from betterbench.tasks.authoring import operations

    try:
        form = spoiled(lambda f: f["variations"][0].update(do=[{"operation": "shuffle", "order": [1]}]))
        with pytest.raises(InvalidInputError, match="has no JSON form"):
            task_from_json(form)
        assert isinstance(shuffle((1,)), Operation)
    finally:
        del operations._CONSTRUCTORS["shuffle"]


def test_a_json_file_is_loaded_like_a_task_file(tmp_path):
    form = copy.deepcopy(task_forms(["fruit_lunch"])["fruit_lunch"])
    form["id"] = "json_lunch"
    path = tmp_path / "lunch.json"
    path.write_text(json.dumps(form))
    with forgotten_tasks():
        os.environ[VARIABLE] = str(path)
        assert get_task("json_lunch").training[0].id == "json_lunch/train1"
        assert "Randomizations" in notes_of("json_lunch")
        assert code_of("task", "json_lunch").startswith("sha256 ")
        assert str(path) in options_for(["json_lunch"])


def test_a_damaged_json_file_is_named(tmp_path):
    from betterbench.tasks.user_files import load_task_files

    for number, text in enumerate(("{", "[]", '{"schema_version": 1, "schema_version": 1}', "{}")):
        path = tmp_path / f"bad_{number}.json"
        path.write_text(text)
        with pytest.raises(InvalidInputError, match=f"bad_{number}.json"):
            load_task_files([path])
