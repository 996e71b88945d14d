"""Noun phrases for the categories of the library, and descriptions that include the size and mass of an object."""

from __future__ import annotations

import functools
import importlib.resources
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from betterbench.errors import UnknownNameError
from betterbench.generation.scenario import DescribedObject
from betterbench.sim.assets import build_unpainted, colors, looks
from betterbench.tasks.words import with_article


@dataclass(frozen=True, slots=True)
class Phrase:
    """Words for the objects of a category.

    Attributes:
        short: Noun for use in an instruction, without a color ("mug").
        long: Description without an article. ``{color}`` stands for the color ("{color} coffee mug").
        query: Search query for the catalogue.
    """

    short: str
    long: str
    query: str

    @property
    def shows_color(self) -> bool:
        """Whether the description names the color."""
        return "{color}" in self.long


PHRASES: dict[str, Phrase] = {
    "apple": Phrase("apple", "{color} apple", "{color} apple"),
    "block": Phrase("block", "{color} wooden toy block", "{color} toy block"),
    "bun_bottom": Phrase("bottom bun", "bottom half of a burger bun", "bottom bun"),
    "bun_top": Phrase("top bun", "top half of a burger bun with sesame seeds", "top bun"),
    "burger": Phrase("burger", "burger in a golden brown bun", "burger"),
    "can": Phrase("soda can", "{color} soda can", "{color} soda can"),
    "cheese_slice": Phrase("cheese", "thick slice of yellow cheese", "cheese slice"),
    "coffee_machine": Phrase(
        "coffee machine", "{color} coffee machine with a ring on its tray", "{color} coffee machine"
    ),
    "computer_mouse": Phrase("computer mouse", "{color} computer mouse", "{color} computer mouse"),
    "crumpled_napkin": Phrase("crumpled napkin", "crumpled {color} paper napkin", "crumpled {color} napkin"),
    "crushed_can": Phrase("crushed can", "crushed {color} soda can", "crushed {color} can"),
    "cup": Phrase("cup", "{color} cup with a handle", "{color} tea cup"),
    "dinner_plate": Phrase("dinner plate", "{color} dinner plate", "{color} dinner plate"),
    "drawer_cabinet": Phrase("cabinet", "small {color} desk cabinet for two drawers", "{color} drawer cabinet"),
    "drink_cup": Phrase("paper cup", "{color} paper cup with a lid and a straw", "{color} drink cup"),
    "egg_cup": Phrase("egg cup", "boiled egg in a {color} egg cup", "{color} egg cup"),
    "fork": Phrase("fork", "{color} fork", "{color} fork"),
    "fries_box": Phrase("fries", "{color} carton of fries", "{color} fries box"),
    "jam_jar": Phrase("jam jar", "glass jar of {color} jam", "{color} jam jar"),
    "laptop": Phrase("laptop", "open {color} laptop", "{color} laptop"),
    "lemon": Phrase("lemon", "yellow lemon", "lemon"),
    "lettuce_leaf": Phrase("lettuce", "leaf of green lettuce", "lettuce leaf"),
    "lower_drawer": Phrase("lower drawer", "lower drawer of the {color} cabinet", "{color} lower drawer"),
    "lunchbox": Phrase("lunchbox", "open {color} plastic lunchbox", "{color} lunchbox"),
    "mug": Phrase("mug", "{color} coffee mug", "{color} mug"),
    "napkin_stack": Phrase("napkins", "stack of {color} paper napkins", "{color} napkin stack"),
    "orange": Phrase("orange", "fresh orange", "orange"),
    "patty": Phrase("patty", "grilled burger patty", "burger patty"),
    "pill_bottle": Phrase("pill bottle", "white pill bottle", "pill bottle"),
    "place_plate": Phrase("plate", "{color} breakfast plate with a decorated rim", "{color} breakfast plate"),
    "plain_paprika_jar": Phrase("paprika jar", "plain steel jar of paprika", "plain paprika jar"),
    "plain_pepper_jar": Phrase("pepper jar", "plain steel jar of pepper", "plain pepper jar"),
    "plain_salt_jar": Phrase("salt jar", "plain steel jar of salt", "plain salt jar"),
    "round_block": Phrase("round block", "{color} round wooden block", "{color} round block"),
    "salt_shaker": Phrase("salt shaker", "{color} salt shaker", "{color} salt shaker"),
    "sauce_cup": Phrase("sauce cup", "small paper cup of {color} sauce", "{color} sauce cup"),
    "serving_plate": Phrase("serving plate", "large {color} serving plate", "{color} serving plate"),
    "soap_bar": Phrase("soap", "{color} bar of soap", "{color} soap bar"),
    "speaker": Phrase("speaker", "small {color} desktop speaker", "{color} speaker"),
    "spice_rack": Phrase("rack", "{color} wooden spice rack with three holes", "{color} spice rack"),
    "sponge": Phrase("sponge", "yellow kitchen sponge", "kitchen sponge"),
    "spoon": Phrase("spoon", "{color} spoon", "{color} spoon"),
    "stapler": Phrase("stapler", "{color} desk stapler", "{color} stapler"),
    "takeaway_box": Phrase("takeaway box", "open {color} takeaway box", "{color} takeaway box"),
    "tape_roll": Phrase("tape", "roll of {color} tape", "{color} tape roll"),
    "tumbler": Phrase("glass", "tall {color} drinking glass", "{color} tumbler"),
    "upper_drawer": Phrase("upper drawer", "upper drawer of the {color} cabinet", "{color} upper drawer"),
    "waste_bin": Phrase("waste bin", "open {color} waste bin", "{color} waste bin"),
}
"""Noun phrases by category."""

_SPICES = {"white": "salt", "black": "pepper", "red": "paprika"}


def phrase_of(category: str, color: str) -> Phrase:
    """Return the phrase for a category. For a spice jar, the color determines the spice.

    Raises:
        UnknownNameError: If the grammar has no phrase for the category.
    """
    if category == "spice_jar":
        spice = _SPICES[color]
        return Phrase(f"{spice} jar", f"small glass jar of {spice}", f"{spice} spice jar")
    if category not in PHRASES:
        raise UnknownNameError("category of the grammar", category, PHRASES)
    return PHRASES[category]


def short_name(category: str, color: str, *, colored: bool = True) -> str:
    """Return the noun that instructions use for an object ("blue lunchbox").

    The noun includes the color if the category has several colors.
    """
    phrase = phrase_of(category, color)
    return f"{color} {phrase.short}" if colored and phrase.shows_color and len(colors(category)) > 1 else phrase.short


def described(category: str, color: str) -> DescribedObject:
    """Return the description of an object. It includes the ranges of mass and size for the object's category.

    The tags of the description are the category and the color.
    """
    phrase = phrase_of(category, color)
    mass_kg, size_m = measured(category)
    long, query = phrase.long.format(color=color), phrase.query.format(color=color)
    name = re.sub(r"[^a-z0-9]+", "_", short_name(category, color).lower())
    article = "" if category in ("bun_bottom", "bun_top", "upper_drawer", "lower_drawer") else with_article(long)
    tags = (category.replace("_", " "), color)
    return DescribedObject(capitalized(article or f"the {long}"), query, name, mass_kg, size_m, tags)


def capitalized(text: str) -> str:
    """Return a string with its first letter capitalized."""
    return text[:1].upper() + text[1:]


def measured(category: str) -> Measures:
    """Return the ranges of mass and size for a category.

    The ranges are read from ``measures.json``. Categories added by a user are not in this file, so they are measured.
    """
    return _stored().get(category) or measure(category)


Measures = tuple[tuple[float, float], tuple[float, float]]
"""Range of the mass [kg], and range of the largest dimension [m], of all variants of a category."""


@functools.cache
def measure(category: str) -> Measures:
    """Measure the mass and the largest dimension of all variants of a category, and return the ranges.

    The ranges are rounded outward to 1 g and 1 mm. Measuring all categories takes a minute, so
    ``tools/grammar_measures.py`` stores the ranges.
    """
    assets = [build_unpainted(category, look=look) for look in looks(category)]
    return _range([a.mass_kg for a in assets]), _range([max(a.size_m) for a in assets])


def _range(values: list[float]) -> tuple[float, float]:
    return math.floor(1000.0 * min(values)) / 1000.0, math.ceil(1000.0 * max(values)) / 1000.0


@functools.cache
def _stored() -> Mapping[str, Measures]:
    text = importlib.resources.files(__package__).joinpath("data/measures.json").read_text(encoding="utf-8")
    return {name: ((m["kg"][0], m["kg"][1]), (m["m"][0], m["m"][1])) for name, m in json.loads(text).items()}


def measured_categories() -> tuple[str, ...]:
    """Return the sorted categories of the grammar."""
    return tuple(sorted((*PHRASES, "spice_jar")))
