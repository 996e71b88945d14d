"""Broader words: which kinds they include, and where in a description they name the object."""

from __future__ import annotations

import pytest

from betterbench.sim.assets.catalogue.expansion import understood
from betterbench.sim.assets.catalogue.hypernyms import hypernym_list, members_named
from betterbench.sim.assets.catalogue.kinds import number_of
from betterbench.sim.assets.catalogue.lists import list_lines
from betterbench.sim.assets.catalogue.terms import terms


def test_each_broader_word_is_listed_once():
    phrases = [tuple(terms(one)) for line in list_lines("hypernyms.txt") for one in line.partition(">")[0].split("=")]
    assert len(hypernym_list()) >= 600
    assert sorted(phrases) == sorted(set(phrases))


@pytest.mark.parametrize(
    ("query", "member", "other"),
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
    ],
)
def test_a_broader_word_that_names_the_object_includes_its_members(query, member, other):
    found = members_named(query)
    assert number_of(member) in found
    assert number_of(other) not in found


@pytest.mark.parametrize(
    "query",
    [
        "",
        "a vegetable knife",
        "a bowl of fruit",
        "a place to throw garbage",
        "you put fruit in it",
        "mug",
        "a green mug",
    ],
)
def test_other_descriptions_have_no_broader_word(query):
    assert members_named(query) == frozenset()


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
