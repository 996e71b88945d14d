"""Templates and objects from a user's sentence, without a model."""

from __future__ import annotations

import pytest
from tests.looping import each

from betterbench.errors import InvalidInputError
from betterbench.generation.choosing import checked_sentence, choose_template, scenarios_about, wanted_in
from betterbench.generation.sense import sense_problems


@each(
    "sentence, template",
    [
        ("Pack an apple, a lemon and a soda can into the lunchbox", "loose_packing"),
        ("Throw the crushed can into the bin.", "loose_packing"),
        ("Put the burger into the takeout box", "loose_packing"),
        ("Throw the napkin and the can in the trash", "loose_packing"),
        ("Set the table for breakfast around the plate", "patterned_arrangement"),
        ("Arrange a mouse, a mug and a speaker around the laptop", "patterned_arrangement"),
        ("Put the fork left of the plate", "patterned_arrangement"),
        ("Put the mug next to the plate", "patterned_arrangement"),
        ("Stack a burger from patty, cheese and lettuce", "logical_assembly"),
        ("Build a tower of blocks", "logical_assembly"),
        ("Stack three blocks on the plate", "logical_assembly"),
        ("Put the red plate on the blue plate", "recursive_stacking"),
        ("Stack the plates", "recursive_stacking"),
        ("Put the stapler and the tape into the drawers", "container_loading"),
        ("Put the salt and the pepper into the rack", "precision_insertion"),
        ("Insert the jars into the holes", "precision_insertion"),
        ("Put the red mug on the ring of the coffee machine", "constrained_positioning"),
        ("Put the mug on the mark under the spout", "constrained_positioning"),
    ],
)
def test_words_choose_the_template(sentence, template):
    assert choose_template(sentence) == template


def test_a_sentence_that_fits_nothing_lists_the_templates():
    with pytest.raises(InvalidInputError, match=r"fits no template.*loose_packing \(Put the named.*recursive_stacking"):
        choose_template("Do my taxes.")
    with pytest.raises(InvalidInputError, match=r"fits several templates.*container_loading.*precision_insertion"):
        choose_template("Use the drawer and the hole.")
    with pytest.raises(InvalidInputError, match=r"fits no template\..*a template: loose_packing \([^()]*\)\.?$"):
        choose_template("Clean up the picnic.")


@pytest.mark.parametrize(
    ("sentence", "names"),
    [
        (
            "Pack the red apple, the lemon and the blue soda can into the green lunchbox",
            "red_apple lemon blue_soda_can",
        ),
        ("Arrange the white mouse, a mug and the speaker around the laptop", "white_computer_mouse mug speaker"),
        ("Put the stapler and the blue tape into the drawers", "stapler blue_tape"),
        ("Put the salt, the pepper and the paprika into the rack", "salt_jar pepper_jar paprika_jar"),
        ("Stack the red plate on the blue plate", "red blue"),
        ("Pack two apples and an orange into the lunchbox", "apple orange"),
    ],
)
def test_the_objects_of_the_sentence_are_in_every_scenario(sentence, names):
    count = 1 if "green lunchbox" in sentence else 4
    chosen = scenarios_about(sentence, count, seed=2)
    assert len(chosen.scenarios) == count
    for scenario in chosen.scenarios:
        there = " ".join(o.instance_name for group in scenario.groups.values() for o in group)
        assert all(name in there for name in names.split()), there
        assert sense_problems(scenario, mixed=True) == ()


def test_a_sentence_is_the_instruction_if_it_states_the_goal_and_otherwise_not():
    goal = scenarios_about("put the fruit into the blue lunchbox", 2)
    assert {s.instruction for s in goal.scenarios} == {"Put the fruit into the blue lunchbox."}
    assert goal.reworded == ""
    listed = scenarios_about("Pack the apple, the lemon and the soda can into the lunchbox", 2)
    assert listed.reworded == "lists all 3 objects of the group 'items'"
    assert all("apple" not in s.instruction for s in listed.scenarios)


def test_the_words_of_a_sentence_choose_the_theme():
    assert {s.name for s in scenarios_about("Pack a picnic into the lunchbox", 5).scenarios} == {"Packing a picnic"}


def test_a_number_asks_for_several():
    (apple, _, orange) = wanted_in("Pack two apples and an orange into the lunchbox.", "loose_packing")[:3]
    assert (apple.noun, orange.noun) == ("apple", "orange")
    (first, second) = wanted_in("Pack two apples into it.", "loose_packing")
    assert first == second


@each(
    "sentence, said",
    [
        ("Put the hammer into the box", "Unknown object 'hammer'"),
        ("Put the screwdriver next to the plate", "Unknown object 'screwdriver'"),
        ("The stapler and a wrench go into the drawer", "Unknown object 'wrench'"),
        ("Stack the three plates, the blue one on top", "'the blue one' without a noun.*'the blue plate'"),
        (
            "Hide the sponge and the two black staplers in the lower drawer",
            "has 3 objects for the group 'items' .sponge, black stapler, black stapler.. Use at most 2",
        ),
        (
            "Throw two red cans into the bin",
            "has the red can twice, but all objects must differ in kind or color. Use it",
        ),
        ("Put two staplers into the upper drawer", "refers to several items, and each target takes one"),
        ("Lege den roten Apfel in die Brotdose", "in English"),
        ("Put banana and apple into the box", "Unknown object 'banana'"),
        ("Put the mug into the lunchbox", "Unknown object 'mug'.*constrained_positioning"),
        ("Put the purple apple into the box", "no purple apple. Choose one of these colors: red, green, yellow"),
        ("Put <b>the apple</b> into the box", "contains '<'"),
        ("Put the apple into the box; rm -r", "contains ';'"),
        ("x" * 201, "has 201 characters"),
        ("  ", "has 0 characters"),
        (
            "Pack the apple, the lemon, the orange, the burger and the fries into the box",
            "has 5 objects for the group 'items'.*at most 4",
        ),
    ],
)
def test_a_sentence_that_cannot_be_used_is_one_clear_error(sentence, said):
    with pytest.raises(InvalidInputError, match=said) as caught:
        scenarios_about(sentence, 1)
    assert "\n" not in str(caught.value)


def test_a_sentence_gets_a_capital_and_a_period():
    assert checked_sentence("  pack   the lunch") == "Pack the lunch."
    assert checked_sentence("Pack the lunch!") == "Pack the lunch."


@pytest.mark.parametrize(
    "sentence",
    [
        "Throw the crumpled napkin, the soda can and the bottle in the trash",
        "Toss the sponge into the garbage",
        "Throw the trash into the bin",
        "Throw the crushed can into the trash can",
    ],
)
def test_the_trash_is_a_waste_bin(sentence):
    (scenario,) = scenarios_about(sentence, 1).scenarios
    assert [o.tags[0] for o in scenario.groups["container"]] == ["waste bin"]
    assert not scenario.instruction.startswith("Pack")
