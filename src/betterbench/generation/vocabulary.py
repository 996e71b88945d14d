"""Vocabulary of tabletop objects by type, and detection of nouns in phrases.

The vocabulary is used to check scenarios written by a model: whether each object belongs to its group, and whether the
instruction names a missing object. The vocabulary is deliberately small. An object with an unknown noun is accepted in
a group if one of its tags names an allowed type.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable

from betterbench.sim.assets.catalogue.terms import terms

_FRUIT = """
apple, orange, lemon, lime, banana, pear, peach, plum, cherry, grape, strawberry, kiwi, mango, avocado,
tangerine
"""
_MEAL = """
burger, hamburger, cheeseburger, sandwich, hot dog, fries, french fries, fries box, sausage, egg, boiled egg,
bagel, croissant, donut, cupcake, muffin, cookie, cake, pie, chocolate bar, candy bar, granola bar, yogurt,
cereal, rice, soup, steak, chicken, nut, pizza, taco, sushi, cracker, snack, tomato, carrot, cucumber, pepper,
onion, potato, corn, mushroom, celery
"""
_CONDIMENT = """
jam, honey, sauce, ketchup, mustard, syrup, butter, salt, paprika, spice, sugar, salt shaker, pepper shaker
"""
_DRINK = """
can, soda, soda can, drink, juice, juice box, milk carton, water bottle, soft drink, paper cup, drink cup
"""
_LAYER = """
patty, burger patty, cheese, cheese slice, lettuce, lettuce leaf, bun, top bun, bottom bun, burger bun, bread,
bread slice, toast, tomato, tomato slice, onion ring, pickle, bacon, ham, egg, pancake, waffle, tortilla,
turkey slice
"""
_TOY = """
block, toy block, round block, wooden block, stapler block, cube, cylinder, brick, ball, dice, toy, toy car,
domino
"""
_OFFICE = """
stapler, tape, tape roll, roll of tape, marker, pen, pencil, eraser, scissors, glue stick, sticky note,
paper clip, ruler, notepad, notebook, calculator, computer mouse, mouse, hole punch, usb stick, battery, key,
charger
"""
_WASH = """
sponge, soap, soap bar, bar of soap, brush, toothbrush, toothpaste, detergent, cloth, towel
"""
_WASTE = """
crushed can, crumpled napkin, paper ball, napkin, wrapper, tissue, bottle cap, peel, waste paper
"""
_CUP = """
cup, tea cup, teacup, mug, coffee mug, tumbler, glass, drinking glass, paper cup, drink cup, beaker,
espresso cup
"""
_CUTLERY = "fork, spoon, knife, teaspoon, soup spoon, butter knife, chopstick, spork"
_PLATE = """
plate, dinner plate, serving plate, place plate, breakfast plate, dish, saucer, platter
"""
_BOWL = "bowl, soup bowl, cereal bowl, shallow bowl, salad bowl, mixing bowl"
_JAR = """
jar, spice jar, salt jar, pepper jar, paprika jar, plain salt jar, plain pepper jar, plain paprika jar,
jam jar, salt shaker, pepper shaker, shaker
"""
_BOTTLE = """
bottle, pill bottle, medicine bottle, water bottle, sauce bottle, vial, flask, test tube
"""
_TABLEWARE = f"{_PLATE}, {_BOWL}, {_CUP}, {_CUTLERY}, salt shaker, pepper shaker, napkin stack, jam jar, egg cup, jar"
_OTHER = "pill bottle, egg cup, sauce cup, napkin stack, phone, watch, candle"
_SMALL = f"{_TOY}, {_OFFICE}, {_WASH}, {_WASTE}, {_CUP}, {_CUTLERY}, {_DRINK}, {_JAR}, {_OTHER}"

_TYPES: dict[str, str] = {
    "food": f"{_FRUIT}, {_MEAL}, {_CONDIMENT}, {_DRINK}, {_LAYER}, jam jar, egg cup, sauce cup",
    "small object": _SMALL,
    "desk object": f"{_OFFICE}, {_CUP}, {_DRINK}, speaker, loudspeaker, phone, lamp, headphone, keyboard, pen holder",
    "office supply": _OFFICE,
    "cutlery": _CUTLERY,
    "cup": _CUP,
    "mug": "mug, coffee mug",
    "bowl": _BOWL,
    "plate": _PLATE,
    "tray": "tray",
    "placemat": "placemat",
    "tableware": _TABLEWARE,
    "kitchenware": f"{_TABLEWARE}, {_DRINK}, pot, pan, spatula, sponge, kettle, ladle, whisk",
    "laptop": "laptop, laptop computer, notebook computer",
    "bag": "bag, paper bag, tote bag",
    "box": "box, lunchbox, lunch box, bento box, takeaway box, takeout box, carton, crate, food container, container",
    "basket": "basket, bread basket, picnic basket",
    "bin": "bin, waste bin, trash can, trash bin, wastebasket, bucket",
    "coffee machine": "coffee machine, espresso machine, coffee maker",
    "scale": "scale, kitchen scale",
    "charger": "charger, charging station, charging dock",
    "cabinet": "cabinet, drawer cabinet, desk cabinet, desk organizer, chest of drawers, dresser",
    "drawer": "drawer, upper drawer, lower drawer, top drawer, bottom drawer, desk drawer",
    "bun": "bun, bottom bun, burger bun, bread roll, bread, bread slice",
    "food layer": _LAYER,
    "block": "block, toy block, round block, wooden block, cube, brick, building block",
    "rack": "rack, spice rack, jar holder, jar rack, test tube rack, holder",
    "stand": "stand, jar stand",
    "jar": _JAR,
    "bottle": _BOTTLE,
    "plug": "plug, power plug, usb plug",
}

COLLECTIVES: dict[str, str] = {
    "fruit": _FRUIT,
    "cutlery": _CUTLERY,
    "silverware": _CUTLERY,
    "spice": f"{_JAR}, salt, pepper, paprika",
    "toy": _TOY,
    "drink": f"{_DRINK}, {_CUP}",
    "condiment": f"{_CONDIMENT}, {_JAR}, sauce cup, jam jar",
    "dish": f"{_PLATE}, {_BOWL}, {_CUP}",
    "tableware": _TABLEWARE,
    "trash": f"{_WASTE}, {_DRINK}, fries",
    "vegetable": "tomato, carrot, cucumber, pepper, onion, potato, corn, mushroom, celery, lettuce",
}
"""Collective nouns, each with the kinds of objects it includes."""

_DOMAINS = {"food": f"{_FRUIT}, {_MEAL}, {_LAYER}", "office supply": _OFFICE, "cleaning supply": _WASH}
"""Domains of items. Items of different domains do not belong together in a scenario, except as trash."""

_MEASURES_WORDS = """
bar bowl box bottle can carton cup glass half jar leaf pack piece roll slice stack
"""
MEASURES = frozenset(_MEASURES_WORDS.split())
"""Measure nouns, such as "slice" in "a slice of cheese"."""

LONGEST_PHRASE = 4


def _phrases(text: str) -> frozenset[tuple[str, ...]]:
    return frozenset(tuple(terms(phrase)) for phrase in text.split(",") if phrase.strip())


@functools.cache
def nouns_of(allowed: str) -> frozenset[tuple[str, ...]]:
    """Return the nouns that can refer to a type, as tuples of words.

    The nouns include the name of the type. For an unknown type, only this name is returned.
    """
    return _phrases(_TYPES.get(allowed, "")) | {tuple(terms(allowed))}


@functools.cache
def all_nouns() -> frozenset[tuple[str, ...]]:
    """Return all known nouns of objects."""
    return frozenset().union(*(_phrases(text) for text in _TYPES.values()))


@functools.cache
def collective(noun: str) -> frozenset[tuple[str, ...]]:
    """Return the nouns that a collective noun includes, such as "apple" for "fruit". Empty for any other noun."""
    return _phrases(COLLECTIVES.get(noun, ""))


def known_nouns(words: list[str]) -> list[tuple[int, tuple[str, ...]]]:
    """Return the known nouns in a list of words, with the index of the first word of each noun.

    Where nouns overlap, the longer noun is returned.
    """
    found: list[tuple[int, tuple[str, ...]]] = []
    at = 0
    while at < len(words):
        for length in range(min(LONGEST_PHRASE, len(words) - at), 0, -1):
            phrase = tuple(words[at : at + length])
            if phrase in all_nouns():
                found.append((at, phrase))
                at += length - 1
                break
        at += 1
    return found


def head_nouns(text: str) -> tuple[tuple[str, ...], ...]:
    """Return the known nouns that name a described object.

    The object is named by the last noun before "with", "in", "of" and similar words, such as "mug" in "a red mug with
    an apple on it". After a measure noun, the measured noun is included, such as "cheese" in "a slice of cheese".
    """
    words = terms(text)
    ends = next((i for i, word in enumerate(words) if word in _ENDS_THE_HEAD), len(words))
    heads = [noun for _, noun in known_nouns(words[:ends])][-1:]
    if ends < len(words) and words[ends] == "of" and words[ends - 1 : ends] and words[ends - 1] in MEASURES:
        rest = words[ends + 1 :]
        stop = next((i for i, word in enumerate(rest) if word in _ENDS_THE_HEAD), len(rest))
        heads += [noun for _, noun in known_nouns(rest[:stop])][-1:]
    return tuple(heads)


_ENDS_THE_HEAD_WORDS = """
of with for in on without that to from which made holding containing and
"""
_ENDS_THE_HEAD = frozenset(_ENDS_THE_HEAD_WORDS.split())


def belongs(text: str, tags: Iterable[str], allowed: Iterable[str]) -> bool:
    """Return whether a described object belongs to one of the allowed types.

    The type is determined by a known noun in the description. If there is none, a tag of the object must name an
    allowed type.
    """
    types = tuple(allowed)
    nouns = frozenset().union(*(nouns_of(name) for name in types))
    heads = head_nouns(text)
    if heads:
        return any(head in nouns for head in heads)
    return bool({tuple(terms(tag)) for tag in tags} & {tuple(terms(name)) for name in types})


def domain_of(text: str) -> str:
    """Return the domain of an item ("food"), or an empty string if the item fits every domain."""
    for head in head_nouns(text):
        for domain, nouns in _DOMAINS.items():
            if head in _phrases(nouns):
                return domain
    return ""
