"""Broader words: which kinds they include, and where in a description they name the object."""

from __future__ import annotations

import pytest
from tests.looping import each

from betterbench.sim.assets.catalogue.expansion import understood
from betterbench.sim.assets.catalogue.hypernyms import attribute_list, hypernym_list, kind_named, members_named
from betterbench.sim.assets.catalogue.kinds import number_of
from betterbench.sim.assets.catalogue.lists import list_lines
from betterbench.sim.assets.catalogue.terms import terms


@pytest.mark.parametrize(("mark", "least"), [(">", 600), ("~", 150)], ids=["broader words", "attributes"])
def test_each_broader_word_and_attribute_is_listed_once(mark, least):
    lines = [line for line in list_lines("hypernyms.txt") if mark in line]
    phrases = [tuple(terms(one)) for line in lines for one in line.partition(mark)[0].split("=")]
    assert len(phrases) >= least
    assert sorted(phrases) == sorted(set(phrases))
    assert set(phrases) <= set(attribute_list())
    assert mark == ">" or not {("dutch",), ("wooden",)} & set(hypernym_list())


@each(
    "query, member, other",
    [
        ("vegetables", "carrot", "skewer"),
        ("fresh greens for a soup", "lettuce", "soup"),
        ("a set of cutlery", "fork", "plate"),
        ("an article of stationery in black", "stapler", "drawer"),
        ("an alcoholic beverage, red", "wine", "apple"),
        ("tool for eating soup", "spoon", "soup"),
        ("a container for noodles", "takeaway box", "noodle"),
        ("jam pot", "jam jar", "bread"),
        ("canned meat", "potted meat can", "can"),
        ("things that roll", "rolling pin", "plate"),
        ("breakfast crockery", "cereal bowl", "mortar"),
        ("Dutch snack bar food", "sausage", "apple"),
        ("a Mexican dish", "taco", "plate"),
        ("an Asian meal", "dumpling", "chopstick"),
        ("wooden kitchen utensil", "cooking spoon", "whisk"),
        ("hot beverage vessel", "mug", "wine glass"),
        ("a glass or plastic vessel", "pitcher", "basket"),
        ("something wooden", "block", "plate"),
    ],
)
def test_a_broader_word_that_names_the_object_includes_its_members(query, member, other):
    found = members_named(query)
    assert number_of(member) in found
    assert number_of(other) not in found


@each(
    "query",
    [
        "",
        "a vegetable knife",
        "a bowl of fruit",
        "a place to throw garbage",
        "you put fruit in it",
        "mug",
        "a green mug",
        "a wooden spoon",
        "a glass",
        "a table",
    ],
)
def test_other_descriptions_have_no_broader_word(query):
    assert members_named(query) == frozenset()


@each(
    "query, kind",
    [
        ("small plate under a cup", "plate"),
        ("hot dog topped with mustard", "hot dog"),
        ("cheese cut", "cheese"),
        ("tall glossy red cup", "cup"),
        ("plate, white, for a cake", "plate"),
        ("a bowl-shaped vessel", None),
        ("it opens wine", None),
        ("bright orange", None),
    ],
)
def test_the_noun_that_names_the_object_names_its_kind(query, kind):
    assert kind_named(query) == (frozenset() if kind is None else {number_of(kind)})


@pytest.mark.parametrize(
    ("query", "text"),
    [
        ("jar without a label", "jar"),
        ("cup without a handle for tea", "cup for tea"),
        ("no handle", "no handle"),
        ("a mug with a handle", "a mug with a handle"),
    ],
)
def test_what_an_object_does_not_have_is_left_out(query, text):
    assert understood(query).text == text


def test_what_an_object_does_not_have_is_kept_as_its_own_words():
    assert understood("drinking vessel without any handle").lacks == ("handle",)
    assert understood("a mug with a handle").lacks == ()


@pytest.mark.parametrize(
    ("query", "text"),
    [
        ("Can you find me a skillet?", "a skillet?"),
        ("I am looking for a large pot", "a large pot"),
        ("show me the red apple", "the red apple"),
        ("Do you have any mugs", "any mugs"),
        ("I need it", "I need it"),
        ("I eat soup with it", "I eat soup with it"),
    ],
)
def test_the_words_of_a_request_are_left_out(query, text):
    assert understood(query).text == text


@each(
    "query, is_use, role",
    [
        ("thing to eat soup with", True, "tool"),
        ("you cut bread with it", True, "tool"),
        ("something to drink coffee from", True, "vessel"),
        ("knead dough in it", True, "vessel"),
        ("put my slice of cake on this", True, "surface"),
        ("for rolling out dough", True, ""),
        ("next to the bowl", True, ""),
        ("holds a boiled egg", True, ""),
        ("tool for cutting bread", True, "tool"),
        ("a mug with an apple on it", False, ""),
        ("green outside and red inside", False, ""),
        ("a spoon for soup", False, ""),
    ],
)
def test_a_query_may_say_only_what_the_object_is_for(query, is_use, role):
    found = understood(query)
    assert (found.is_use, found.role) == (is_use, role)


@each(
    "query, text",
    [
        ("cutery", "cutlery"),
        ("a red keybord", "a red keyboard"),
        ("spon", "spoon"),
        ("choclate bar", "chocolate bar"),
        ("toasted bread", "toasted bread"),
        ("rubbery mat", "rubbery mat"),
        ("market", "market"),
        ("mug", "mug"),
        ("spn", "spn"),
    ],
)
def test_a_misspelled_name_is_read_as_the_nearest_name(query, text):
    found = understood(query, is_word=lambda word: word in {"market", "mat"})
    assert found.text == text
    assert query in found.readings
    assert understood(query).text == query
    if text != query:
        spelled = {word for concept in found.concepts for phrase, _ in concept.alternatives for word in phrase}
        assert spelled & set(terms(query)) - set(terms(text))  # the catalogue may have a name spelled like this
