"""Checks of sense: each problem is one sentence with the path of the field."""

from __future__ import annotations

import pytest
from tests.generation.examples import GOOD, changed, described, item
from tests.looping import each

from betterbench.generation.scenario_form import scenario_from_answer
from betterbench.generation.sense import gripper_opening_m, sense_problems
from betterbench.generation.vocabulary import belongs, head_nouns


def problems(form, template="loose_packing", **options):
    found = sense_problems(scenario_from_answer(form, template), where="answer[0]", **options)
    return [str(problem) for problem in found]


def test_a_good_scenario_has_no_problem():
    assert problems(GOOD) == []


SEVEN = [described(f"apple_{i}", "red apple", [0.1, 0.2], [0.06, 0.07], "food") for i in range(7)]
SPONGE = described("sponge", "yellow sponge", [0.02, 0.03], [0.06, 0.07])
GADGET = described("gadget", "gizmo", [0.02, 0.03], [0.06, 0.07])


@each(
    "form, said",
    [
        (changed(["instantiation", "item"], []), "instantiation: Unknown group 'item'. Did you mean 'items'"),
        (
            changed(["instantiation", "container"], ...),
            "instantiation.container: has 0 objects. Give 1, the count_range",
        ),
        (changed(["instantiation", "items"], SEVEN), "instantiation.items: has 7 objects. Give 1 to 6"),
        (item(1, instance_name="apple"), "items[1].instance_name: 'apple' is also the name of instantiation.items[0]"),
        (
            item(1, asset_query="red fire truck", description="A truck", tags=[]),
            "items[1].asset_query: 'red fire truck' is not of an allowed type",
        ),
        (item(1, asset_query="laptop", tags=["food"]), "items[1].asset_query: 'laptop' is not of an allowed type"),
        (changed(["instantiation", "items", 1], SPONGE), "'yellow sponge' (cleaning supply) does not belong with"),
        (
            item(0, estimated_size=[0.1, 0.12]),
            "items[0].estimated_size: [0.1, 0.12] m does not fit between the fingers",
        ),
        (item(1, estimated_size=[0.3, 0.6]), "items[1].estimated_size: [0.3, 0.6] m is too large"),
        (item(1, estimated_size=[0.001, 0.002]), "items[1].estimated_size: [0.001, 0.002] m is too small"),
        (item(2, estimated_size=[0.012, 0.02]), "items[2].estimated_size: [0.012, 0.02] m is not a usual size"),
        (item(2, estimated_mass=[2.0, 5.0]), "items[2].estimated_mass: [2, 5] kg is too heavy. Give at most 2.27 kg"),
        (item(1, estimated_mass=[2.0, 2.1], estimated_size=[0.03, 0.05]), "heavier than solid brass"),
        (
            changed(["instantiation", "container", 0, "estimated_size"], [0.08, 0.1]),
            "container[0].estimated_size: [0.08, 0.1] m is not larger than 'soda', which goes into it",
        ),
    ],
)
def test_what_makes_no_sense_is_named_with_its_path(form, said):
    found = problems(form)
    assert any(said in problem for problem in found), found
    assert all(problem.startswith("answer[0]: ") and "\n" not in problem for problem in found)


def test_a_user_may_mix_what_a_model_may_not():
    form = changed(["instantiation", "items", 1], SPONGE)
    assert problems(form, mixed=True) == []


def test_an_unknown_noun_needs_a_tag_of_an_allowed_type():
    assert any("is not of an allowed type" in p for p in problems(changed(["instantiation", "items", 1], GADGET)))
    tagged = {**GADGET, "tags": ["small object"]}
    assert problems(changed(["instantiation", "items", 1], tagged)) == []


def test_the_gripper_is_the_robot_of_the_suite():
    assert gripper_opening_m() == 0.08


def instructed(text):
    return problems(changed(["instruction"], text))


@pytest.mark.parametrize(
    "text",
    [
        "Pack the hiking lunch into the blue lunchbox.",
        "Put the fruit into the lunchbox.",
        "Put the apple and the lemon into the lunchbox.",
        "Put the red apple into the blue lunchbox on the table.",
        "Pack everything into the box.",
        "Fill the lunchbox for the hike.",
        "Put the drinks into the lunchbox.",
    ],
)
def test_natural_instructions_about_what_is_there_are_accepted(text):
    form = changed(["scene_context"], "kitchen before a hike")
    form["instruction"] = text
    assert problems(form) == []


@each(
    "text, said",
    [
        ("Pack the hiking lunch", "is not one sentence that ends with a period"),
        ("Pack the lunch. Close the lunchbox.", "is not one sentence that ends with a period"),
        ("Pack lunch.", "has 2 words. Write 3 to 25 words"),
        (f"Pack {'the lunch and ' * 9}the lunch into the lunchbox.", "words. Write 3 to 25 words"),
        ("The robot packs the lunch.", "begins with 'The', which is not a known verb"),
        ("Please pack the lunch.", "begins with 'Please', which is not a known verb"),
        ("pack the lunch into the lunchbox.", "begins with a small letter"),
        ("Put the apple into the lunchbox, then the lemon.", "chains steps with 'then'"),
        ("Put the apple into the lunchbox after the lemon.", "chains steps with 'after'"),
        ("Put the apple, the lemon and the soda into the lunchbox.", "lists all 3 objects of the group 'items'"),
        ("Put the banana into the lunchbox.", "names a banana, which is not among the objects"),
        ("Put the green apple into the lunchbox.", "names a green apple, which is not among the objects"),
        ("Put the gizmo into the lunchbox.", "names a gizmo, which is not among the objects"),
        ("Put the apple into the basket.", "names a basket, which is not among the objects"),
        ("Put the toys into the lunchbox.", "names toy, but no object is one"),
        ("Put a apple into the lunchbox.", "has the wrong article in 'a apple'"),
        ("Put an lemon into the lunchbox.", "has the wrong article in 'an lemon'"),
    ],
)
def test_an_instruction_that_does_not_fit_is_refused(text, said):
    found = instructed(text)
    assert any(said in problem and "instruction: " in problem for problem in found), found


def test_a_sandwich_is_what_its_layers_make():
    layers = [described(n, n, [0.02, 0.06], [0.06, 0.09], "food layer") for n in ("ham", "cheese slice", "bread slice")]
    for number, layer in enumerate(layers):
        layer["instance_name"] = f"layer_{number}"
    form = {
        "scenario_name": "Making a ham sandwich",
        "instruction": "Make a ham sandwich on the plate.",
        "scene_context": "kitchen",
        "instantiation": {
            "base": [described("plate", "white plate", [0.2, 0.5], [0.15, 0.2])],
            "layers": layers,
        },
    }
    assert problems(form, "logical_assembly") == []


@pytest.mark.parametrize(
    ("text", "heads"),
    [
        ("A red mug with an apple on it", (("mug",),)),
        ("a slice of cheese", (("cheese",),)),
        ("a roll of blue tape", (("tape",),)),
        ("a jar of red jam", (("jar",), ("jam",))),
        ("white pill bottle", (("pill", "bottle"),)),
        ("a purple gizmo", ()),
    ],
)
def test_the_head_says_what_an_object_is(text, heads):
    assert head_nouns(text) == heads


def test_a_known_noun_decides_against_a_tag():
    assert belongs("red mug", (), ("cup",))
    assert not belongs("red mug", ("food",), ("food",))
