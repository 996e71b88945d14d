"""Templates: every condition follows its pattern; the JSON form says all there is and refuses what it does not know."""

from __future__ import annotations

import copy
import dataclasses
import json
import re

import pytest
from tests.looping import each

from betterbench.errors import InvalidInputError
from betterbench.tasks import TEMPLATES, THRESHOLDS, Expected, ObjectSpec, all_tasks, get_task
from betterbench.tasks.authoring import registry
from betterbench.tasks.authoring.template_form import template_from_json, template_to_json
from betterbench.tasks.interventions import vary
from betterbench.tasks.relations import RELATIONS

CHEESEBURGER = get_task("cheeseburger")
CONDITIONS = [c for t in all_tasks() for c in (*t.training, *(vary(t, v)[0] for v in t.variations))]


def test_there_are_seven_and_each_is_used():
    assert len(TEMPLATES) == 7
    used = {t.template.name: t.template for t in all_tasks()}
    assert all(used[name] is template for name, template in TEMPLATES.items())


@each("condition", CONDITIONS, lambda c: c.id)
def test_every_condition_follows_its_pattern(condition):
    assert get_task(condition.task).template.problems(condition) == ()


def test_what_does_not_follow_the_pattern_is_named():
    task = get_task("cheeseburger")
    condition = task.training[0]
    two = condition.with_(objects=(*condition.objects, ObjectSpec("tray", "tray", "place_plate", role="container")))
    assert "group 'base' (role 'container') has 2 objects, not 1" in " ".join(task.template.problems(two))
    drawer = condition.with_(objects=(*condition.objects, ObjectSpec("d", "d", "upper_drawer", role="drawer")))
    assert "role 'drawer'" in " ".join(task.template.problems(drawer))
    food = get_task("fast_food").training[0]
    assert "uses 'inside'" in " ".join(task.template.problems(condition.with_(instruction=food.instruction)))


def test_a_task_whose_training_does_not_follow_its_pattern_is_refused_when_it_is_made(monkeypatch):
    monkeypatch.setattr(registry, "_BUILDERS", {})
    first, *others = CHEESEBURGER.training
    two = first.with_(objects=(*first.objects, ObjectSpec("tray", "tray", "place_plate", role="container")))

    @registry.task
    def two_bases():
        return dataclasses.replace(CHEESEBURGER, training=(two, *others))

    with pytest.raises(InvalidInputError) as caught:
        two_bases()
    where, line = re.escape(__file__), r"line \d+"
    said = r"task two_bases: training\[0\]: group 'base' \(role 'container'\) has 2 objects, not 1"
    cure = r"Follow the template logical_assembly, or give the task a template whose `groups` allow this"
    assert re.fullmatch(f"{where}, {line}, {said}\\. {cure}\\.?", str(caught.value)), str(caught.value)


@each("template", TEMPLATES.values(), lambda t: t.name)
def test_json_round_trip(template):
    form = json.loads(json.dumps(template_to_json(template)))
    assert template_from_json(form) == template
    assert {"meta", "object_groups"} <= set(form)
    for group in form["object_groups"]:
        assert {"group_id", "description", "allowed_types", "count_range"} <= set(group)
    assert all(form["tolerances"][name] == THRESHOLDS.to_json()[name] for name in template.tolerances)
    assert set(form["relations"]) <= set(RELATIONS)


BAD = {
    "template.meta.title": lambda f: f["meta"].update(title=""),
    "template.meta.color": lambda f: f["meta"].update(color="red"),
    "template.object_groups": lambda f: f.update(object_groups=[]),
    "template.object_groups[0].count_range": lambda f: f["object_groups"][0].update(count_range=[3, 1]),
    "template.object_groups[1].allowed_types[0]": lambda f: f["object_groups"][1].update(allowed_types=[7]),
    "template.object_groups[0].role": lambda f: f["object_groups"][0].update(role="hero"),
    "template.object_groups[1].description": lambda f: f["object_groups"][1].pop("description"),
    "template.relations[0]": lambda f: f.update(relations=["insidee"]),
    "template.relations": lambda f: f.update(relations=[]),
    "template.order": lambda f: f.update(order="random"),
    "template.exclusive": lambda f: f.update(exclusive="yes"),
    "template.tolerances": lambda f: f.update(tolerances={"inside_margin": 9.0}),
    "template.regions": lambda f: f.update(regions=["ring" * 9000]),
    "template.protocol.dwell_s": lambda f: f["protocol"].update(dwell_s=-1.0),
    "template.schema_version": lambda f: f.update(schema_version=99),
    "template.protocol": lambda f: f.update(protocol=None),
}


@each("path", BAD)
def test_bad_json_is_refused_with_the_path_of_the_field(path):
    form = copy.deepcopy(template_to_json(TEMPLATES["loose_packing"]))
    BAD[path](form)
    with pytest.raises(InvalidInputError) as caught:
        template_from_json(form)
    assert str(caught.value).startswith((path.replace("template.", "template: ", 1) + ":", f"{path}:"))
    assert len(str(caught.value)) < 1500


def test_the_step_limit_grows_with_what_is_asked():
    task = get_task("fast_food")
    short = task.training[0]
    limit = task.template.step_limit(short)
    goals = short.instruction.subgoals
    assert limit == task.template.base_steps + len(goals) * task.template.steps_per_subgoal
    assert task.template.step_limit(short.with_(expected=Expected.STAY_STILL)) == task.template.still_steps
