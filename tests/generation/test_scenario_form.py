"""The JSON form of scenarios: round trip, and one message with the path for each wrong field."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.generation.examples import GOOD, changed, item
from tests.looping import each

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.generation.scenario_form import (
    answer_to_json,
    plain_text,
    scenario_from_answer,
    scenario_from_json,
    scenario_to_json,
)


def read(form):
    return scenario_from_answer(form, "loose_packing", where="answer[0]")


def test_a_scenario_is_the_same_after_writing_and_reading():
    scenario = read(GOOD)
    assert answer_to_json(scenario) == GOOD
    assert scenario_from_json(json.dumps(scenario_to_json(scenario))) == scenario
    assert scenario.groups["items"][1].size_m == (0.06, 0.09)


@each(
    "form, said",
    [
        (changed(["instruction"], ...), "answer[0]: instruction: is missing"),
        (changed(["note"], "x"), "answer[0]: note: is unknown"),
        (changed(["scenario_name"], ""), "answer[0]: scenario_name: "),
        (changed(["scenario_name"], "x" * 61), "answer[0]: scenario_name: "),
        (changed(["scenario_name"], "../../etc"), "scenario_name: contains '/'"),
        (changed(["instruction"], "Put <b>it</b> away."), "instruction: contains '<' (U+003C)"),
        (changed(["instruction"], "Put it away.\x1b[31m"), "instruction: contains '\\x1b'"),
        (changed(["scene_context"], "kitchen\u202e"), "scene_context: contains '\\u202e'"),
        (changed(["scene_context"], "$(rm -r)"), "scene_context: contains '$'"),
        (changed(["scene_context"], "1 2"), "scene_context: has no letter"),
        (changed(["scene_context"], " kitchen"), "scene_context: has spaces at an end"),
        (changed(["instantiation"], []), "instantiation: "),
        (changed(["instantiation"], {}), "instantiation: "),
        (item(0, instance_name="Red Apple"), "instantiation.items[0].instance_name: "),
        (item(0, instance_name="apple\n"), "instantiation.items[0].instance_name: "),
        (item(0, instance_name="a" * 42), "instantiation.items[0].instance_name: "),
        (item(1, estimated_mass=[0.2, 0.1]), "items[1].estimated_mass: [0.2, 0.1] must begin with the smaller number"),
        (item(1, estimated_mass=[0.2]), "items[1].estimated_mass[1]: is missing"),
        (item(1, estimated_mass=[True, 2]), "items[1].estimated_mass[0]: expected a number, got a boolean"),
        (item(1, estimated_mass="200 g"), "items[1].estimated_mass: "),
        (item(1, estimated_size=[0, 0.1]), "items[1].estimated_size[0]: "),
        (item(1, estimated_size=[0.1, 90]), "items[1].estimated_size[1]: "),
        (item(2, tags=["a"] * 9), "items[2].tags: "),
        (item(2, tags=["<script>"]), "items[2].tags[0]: contains '<'"),
        (item(2, description="x" * 121), "items[2].description: "),
    ],
)
def test_a_wrong_field_is_named_with_its_path(form, said):
    with pytest.raises(InvalidInputError) as caught:
        read(form)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("number", ["NaN", "1e999", "-Infinity"])
def test_a_number_that_is_not_finite_is_refused(number):
    with pytest.raises(InvalidInputError, match="estimated_mass"):
        read(json.dumps(GOOD).replace("[0.08, 0.15]", f"[0.08, {number}]"))


@given(st.text(max_size=30))
def test_no_accepted_text_has_a_character_with_a_meaning_in_a_file(text):
    try:
        plain_text(text)
    except ValueError:
        return
    assert not set(text) & set('<>&"`$|;{}[]\\/*?!#~^=\0\n\r\t')


def test_an_unknown_template_is_answered_with_the_closest():
    form = {**scenario_to_json(read(GOOD)), "template": "loose_package"}
    with pytest.raises(UnknownNameError, match="'loose_packing'"):
        scenario_from_json(json.dumps(form))
