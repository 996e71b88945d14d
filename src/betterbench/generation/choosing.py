"""Scenarios for a user's sentence, without a language model.

The words in the sentence determine the template, and its nouns determine the objects.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from betterbench.errors import InvalidInputError, UnknownNameError, one_line
from betterbench.generation.grammar.author import Wanted, grammar_of, theme_words, write_scenarios
from betterbench.generation.grammar.nouns import capitalized, phrase_of
from betterbench.generation.grammar.theme import GRAMMARS, Grammar, Kind
from betterbench.generation.instruction_sense import PLACES, VERBS, instruction_problems
from betterbench.generation.scenario import DescribedObject, Scenario
from betterbench.generation.scenario_form import LONGEST_INSTRUCTION, plain_text
from betterbench.generation.sentence_words import (
    NUMBERS,
    RESULTS,
    STOPS,
    color_before,
    is_plural_form,
    number_before,
    phrase_heads,
    raw_tokens,
    sentence_tokens,
)
from betterbench.generation.stated_goal import READ_WORDS, example_about, goal_problems, stated_goal
from betterbench.generation.stated_goal.direction import ARRANGED, without_direction
from betterbench.generation.vocabulary import COLLECTIVES, LONGEST_PHRASE, known_nouns
from betterbench.sim.assets.catalogue.expansion import COLORS
from betterbench.sim.assets.catalogue.terms import terms
from betterbench.tasks.authoring.templates import TEMPLATES

LEAST_SCORE = 2
"""Minimum sum of word weights that a template needs to be chosen."""


def _weighted(*, decides: str = "", hints: str) -> dict[str, int]:
    return {**dict.fromkeys(hints.split(), 1), **dict.fromkeys(decides.split(), 2)}


WEIGHTS: dict[str, dict[str, int]] = {
    "loose_packing": _weighted(
        decides="lunchbox box bin bag basket trash garbage", hints="pack throw toss into lunch picnic takeout takeaway"
    ),
    "patterned_arrangement": _weighted(
        decides="laptop fork spoon cutlery around beside next left right",
        hints="behind upper arrange lay set table breakfast",
    ),
    "constrained_positioning": _weighted(decides="machine ring spout espresso", hints="coffee mug cup mark under"),
    "container_loading": _weighted(decides="drawer cabinet", hints="store file close into"),
    "logical_assembly": _weighted(
        decides="tower layer patty cheeseburger hamburger block",
        hints="stack build assemble make burger bun cheese lettuce sandwich",
    ),
    "precision_insertion": _weighted(decides="rack hole", hints="insert jar spice salt pepper paprika"),
    "recursive_stacking": _weighted(hints="stack pile plate dish"),
}
"""Words (in the singular) that indicate each template, with weights. Repeated words are counted each time."""

_SYNONYMS: dict[str, str] = {
    "apple": "apple",
    "block": "block, cube, wooden block",
    "bun_bottom": "bottom bun, bun",
    "burger": "hamburger, cheeseburger",
    "can": "can, soda, drink",
    "cheese_slice": "cheese slice, slice of cheese",
    "coffee_machine": "machine, coffee maker, espresso machine",
    "computer_mouse": "mouse",
    "crumpled_napkin": "napkin",
    "crushed_can": "empty can",
    "cup": "tea cup, teacup, coffee cup",
    "dinner_plate": "plate",
    "drawer_cabinet": "drawer cabinet, desk cabinet",
    "drink_cup": "drink, cup, soda",
    "egg_cup": "egg, boiled egg",
    "fries_box": "french fries, box of fries, carton of fries",
    "jam_jar": "jam, jar of jam",
    "lettuce_leaf": "lettuce leaf, leaf of lettuce",
    "lower_drawer": "drawer, bottom drawer",
    "lunchbox": "box, lunch box",
    "mug": "coffee mug",
    "napkin_stack": "napkin, stack of napkins",
    "patty": "burger patty, meat patty",
    "pill_bottle": "bottle, pill, medicine",
    "place_plate": "breakfast plate",
    "plain_paprika_jar": "paprika, spice, jar",
    "plain_pepper_jar": "pepper, spice, jar",
    "plain_salt_jar": "salt, spice, jar",
    "round_block": "block, round wooden block",
    "salt_shaker": "salt, shaker",
    "sauce_cup": "sauce, ketchup",
    "serving_plate": "plate",
    "soap_bar": "soap bar, bar of soap",
    "speaker": "loudspeaker",
    "spice_jar": "spice jar, jar, spice",
    "spice_rack": "spice rack",
    "takeaway_box": "box, takeout box, take away box, food box",
    "tape_roll": "tape roll, roll of tape",
    "tumbler": "tumbler, drinking glass",
    "upper_drawer": "drawer, top drawer",
    "waste_bin": "bin, trash can, trash bin, garbage can, wastebasket, "
    "in the trash, into the trash, in the garbage, into the garbage",
}
"""Additional nouns for each category of the grammar, separated by commas."""

_SAME_FOR_ALL = "put place move set lay position get take grab pick hide need want help please go belong clean tidy"
_SPECIFIC = {
    "loose_packing": "pack load fill throw toss store drop stash stow tuck collect gather clear add insert transfer",
    "patterned_arrangement": "arrange organize prepare",
    "constrained_positioning": "make serve prepare brew center",
    "container_loading": "store file stow stash load pack organize fill stock close shut insert",
    "logical_assembly": "build make assemble stack construct layer compose create form add",
    "precision_insertion": "insert fit slot fill stock store organize slide",
    "recursive_stacking": "stack pile collect gather clear",
}
_VERBS_OF = {name: frozenset(f"{_SAME_FOR_ALL} {verbs}".split()) for name, verbs in _SPECIFIC.items()}
"""Verbs that may occur in a sentence for each template, because they add nothing to the template's goal."""
_PLAIN_WORDS_WORDS = """
i you we he she me us them they it s to and there here now please just so too also then
"""
_PLAIN_WORDS = frozenset(_PLAIN_WORDS_WORDS.split())


@dataclass(frozen=True, slots=True)
class Chosen:
    """Scenarios for a user's sentence.

    Attributes:
        template: Name of the template.
        scenarios: Scenarios that contain the named objects.
        reworded: Reason why the sentence is replaced by a generated instruction. Empty if the sentence itself is the
            instruction.
    """

    template: str
    scenarios: tuple[Scenario, ...]
    reworded: str


def scenarios_about(sentence: str, count: int, *, seed: int = 0) -> Chosen:
    """Return scenarios for a sentence. Each contains the objects that the sentence names.

    Raises:
        InvalidInputError: If no template fits, an object is not in the library, or fewer than ``count`` scenarios
            contain the objects.
    """
    text = checked_sentence(sentence)
    template = choose_template(text)
    wanted = wanted_in(text, template)
    found = [_in_order_of(s, wanted) for s in write_scenarios(template, count, seed=seed, wanted=wanted, about=text)]
    worded = tuple(replace(scenario, instruction=text) for scenario in found)
    for scenario in worded:
        for problem, cure in goal_problems(scenario, TEMPLATES[template]):
            raise InvalidInputError("sentence", problem, cure)
    reworded = next((p for s in worded for _, p, _ in instruction_problems(s, TEMPLATES[template])), "")
    if reworded and any(stated_goal(scenario).is_specific for scenario in worded):
        cure = f"Write a sentence such as {example_about(found[0])!r}"
        raise InvalidInputError("sentence", f"{reworded}, but another wording would omit the stated places", cure)
    return Chosen(template, tuple(found) if reworded else worded, reworded)


def _in_order_of(scenario: Scenario, wanted: Sequence[Wanted]) -> Scenario:
    """Reorder the groups of a scenario, so that they begin with the objects of a sentence in the order of the sentence.

    The first training condition then uses the objects that are named first. A top bun is not moved forward, because it
    must stay the last layer.
    """
    groups = dict(scenario.groups)
    moved = [group.group_id for group in TEMPLATES[scenario.template].groups if group.role == "item"]
    for group_id, objects in ((g, groups[g]) for g in moved if g in groups):
        left, first = list(objects), []
        for want in (w for w in wanted if w.group_id == group_id):
            known = (o for o in left if _kind(o) in want.kinds and _kind(o)[0] != "bun_top")
            named = next(known, None)
            if named is not None:
                first.append(named)
                left.remove(named)
        groups[group_id] = (*first, *left)
    return replace(scenario, groups=groups)


def _kind(described: DescribedObject) -> Kind:
    """Return the category and color of an object described by the grammar."""
    category, color = described.tags
    return category.replace(" ", "_"), color


def checked_sentence(sentence: str) -> str:
    """Normalize a sentence to single spaces, a capital letter at the beginning, and a period at the end.

    An exclamation mark becomes a period, and a "please" at the beginning is removed.

    Raises:
        InvalidInputError: If the sentence is empty or too long, or contains other characters than letters and plain
            punctuation.
    """
    text = re.sub(r"^please,? ", "", " ".join(sentence.split()).rstrip("! "), flags=re.IGNORECASE)
    if not text or len(text) > LONGEST_INSTRUCTION:
        cure = f"Write one sentence of up to {LONGEST_INSTRUCTION} characters"
        raise InvalidInputError("sentence", f"has {len(text)} characters", cure)
    try:
        plain_text(text)
    except ValueError as error:
        raise InvalidInputError(
            "sentence", str(error).partition("; write")[0], "Use only letters and plain punctuation"
        ) from error
    return capitalized(text if text.endswith(".") else f"{text}.")


def choose_template(sentence: str) -> str:
    """Return the name of the template that best matches the words of a sentence.

    Raises:
        InvalidInputError: If no template or several templates fit. The message names the closest templates.
    """
    words = terms(sentence)
    scores = {name: sum(weights.get(word, 0) for word in words) for name, weights in WEIGHTS.items()}
    ranked = sorted(scores, key=lambda name: -scores[name])
    best, next_best = ranked[:2]
    if scores[best] >= LEAST_SCORE and scores[best] > scores[next_best]:
        return best
    close = [name for name in ranked if scores[name] and scores[name] == scores[best]] or ranked
    shown = "; ".join(f"{name} ({TEMPLATES[name].description.rstrip('.')})" for name in close)
    fits = "several templates" if 1 < len(close) < len(ranked) else "no template"
    problem = f"{one_line(sentence, most=80)!r} fits {fits}"
    raise InvalidInputError(
        "sentence", problem, f"State the objects and the container in English, or choose a template: {shown}"
    )


def wanted_in(sentence: str, template: str) -> tuple[Wanted, ...]:
    """Return the objects named in a sentence, with the kinds of library objects that each noun can refer to.

    Raises:
        InvalidInputError: If the library has no such object for the template, or has it only in other colors.
    """
    grammar = grammar_of(template)
    sentence = without_direction(sentence) if template == ARRANGED else sentence
    tokens, raw = sentence_tokens(sentence), raw_tokens(sentence)
    _require_nouns(tokens)
    nouns, found, used = _nouns(template), list[Wanted](), set[int]()
    at = 0
    while at < len(tokens):
        length = next((n for n in range(LONGEST_PHRASE, 0, -1) if tuple(tokens[at : at + n]) in nouns), 0)
        if length and not (at == 0 and tokens[0] in VERBS):
            used |= set(range(at, at + length))
            meant = nouns[tuple(tokens[at : at + length])]
            named = _named(tokens, at, length, meant, is_plural_form(raw[at + length - 1]))
            again = "the" in tokens[max(0, at - 2) : at] and any(w.noun == named[0].noun for w in found)
            if template == "recursive_stacking" and {"on", "onto"} & set(tokens):
                named = [_narrower(want, tokens, at) for want in named]
            found += [] if again else named
        at += max(1, length)
    _require_known(tokens, used, grammar)
    _require_read(sentence, tokens, used, grammar)
    on_a_bun = template == "logical_assembly" and (RESULTS - {"tower"}) & set(tokens) and not found
    return (Wanted("base", tuple(nouns["bun",]), "bun"),) if on_a_bun else tuple(found)


def _narrower(want: Wanted, tokens: list[str], at: int) -> Wanted:
    """If a sentence puts a plate on another plate, exclude the widest kinds of plate for the upper one.

    In "the red plate on the blue plate", these kinds are excluded for the red plate but not for the blue one.
    """
    kinds = tuple(kind for kind in want.kinds if kind[0] != "serving_plate")
    stays = {"on", "onto", "of"} & set(tokens[max(0, at - 3) : at])
    return want if stays or not kinds else replace(want, kinds=kinds)


def _require_read(sentence: str, tokens: list[str], used: set[int], grammar: Grammar) -> None:
    """Raise InvalidInputError for an unknown word, because it may state a requirement that the task does not meet."""
    template = grammar.template.name
    free = STOPS | READ_WORDS | PLACES | COLLECTIVES.keys() | _VERBS_OF[template] | _PLAIN_WORDS
    free |= RESULTS if template == "logical_assembly" else frozenset()
    free |= frozenset().union(*(theme_words(theme) | frozenset(terms(theme.context)) for theme in grammar.themes))
    raw = raw_tokens(sentence)
    for at, word in enumerate(tokens):
        color = word in COLORS and any(at < i <= at + 3 for i in used)
        if at not in used and word not in free and not color:
            said = f"{raw[at]!r}"
            if word in COLORS:
                raise InvalidInputError("sentence", f"has no noun after {said}", f"Write 'the {word} ...' with a noun")
            example = _EXAMPLES[template]
            problem = f"has {said}, which is not supported in {template}, so the task might differ from the sentence"
            raise InvalidInputError(
                "sentence", problem, f"Leave out these words, or write a sentence such as {example!r}"
            )


_EXAMPLES = {
    "loose_packing": "Put the apple into the lunchbox.",
    "patterned_arrangement": "Put the computer mouse to the right of the laptop.",
    "constrained_positioning": "Put the red mug on the ring of the coffee machine.",
    "container_loading": "Put the stapler into the upper drawer.",
    "logical_assembly": "Build a cheeseburger on the bottom bun.",
    "precision_insertion": "Put the salt jar into the left hole of the rack.",
    "recursive_stacking": "Put the red plate on the white plate.",
}


def _require_nouns(tokens: list[str]) -> None:
    """Raise InvalidInputError for a phrase such as "the red one", because "one" can stand for any noun."""
    color = next((color for color, one in itertools.pairwise(tokens) if color in COLORS and one == "one"), "")
    if color:
        cure = f"Write the noun after the color, as in 'the {color} plate'"
        raise InvalidInputError("sentence", f"contains 'the {color} one' without a noun", cure)


def _named(tokens: list[str], at: int, length: int, meant: Mapping[Kind, str], plural: bool) -> list[Wanted]:
    """Return the objects that a noun in a sentence asks for.

    A number word before the noun states the number of objects. Without a number word, a plural noun means two objects,
    and a singular noun means one.
    """
    noun, color = " ".join(tokens[at : at + length]), color_before(tokens, at)
    kinds = tuple(kind for kind in meant if not color or kind[1] == color)
    if not kinds:
        known = ", ".join(dict.fromkeys(color for _, color in meant))
        raise InvalidInputError(
            "sentence", f"the library has no {color} {noun}", f"Choose one of these colors: {known}"
        )
    groups = {meant[kind] for kind in kinds}
    group = min(groups, key=lambda g: (g != "items", g))
    said = number_before(tokens, at)
    number = NUMBERS[said] if said else plural + 1
    shown = f"{color} {noun}".strip()
    return [Wanted(group, tuple(k for k in kinds if meant[k] == group), shown)] * number


@functools.cache
def _nouns(template: str) -> dict[tuple[str, ...], dict[Kind, str]]:
    """Return the kinds of objects that each noun may refer to, with the group of each kind.

    If a noun is the usual noun of one category and a secondary noun of another category, only the first is meant.
    """
    exact: dict[tuple[str, ...], dict[Kind, str]] = {}
    other: dict[tuple[str, ...], dict[Kind, str]] = {}
    grammar = grammar_of(template)
    for group_id in grammar.themes[0].groups:
        pools = (pool for theme in grammar.themes for pool in theme.groups[group_id].pools)
        for category, color in (kind for pool in pools for c in pool.categories for kind in pool.kinds(c)):
            short = phrase_of(category, color).short
            exact.setdefault(tuple(terms(short)), {})[category, color] = group_id
            # the color of a spice jar indicates the spice
            spice = short.removesuffix(" jar") if category == "spice_jar" else ""
            texts = (category.replace("_", " "), spice, *_SYNONYMS.get(category, "").split(","))
            for text in filter(str.strip, texts):
                other.setdefault(tuple(terms(text)), {})[category, color] = group_id
    return {**other, **exact}


def _usual_nouns(template: str) -> set[str]:
    """Return the usual nouns of all objects in a template's grammar, without colors."""
    return {phrase_of(*kind).short for meant in _nouns(template).values() for kind in meant}


def _require_known(tokens: list[str], used: set[int], grammar: Grammar) -> None:
    """Raise InvalidInputError if a noun names an object that is not in the grammar."""
    free = (
        PLACES
        | RESULTS
        | COLLECTIVES.keys()
        | COLORS
        | VERBS
        | READ_WORDS
        | frozenset().union(*map(theme_words, grammar.themes))
    )
    covered = {tokens[i] for i in used}
    heads = [head for head in phrase_heads(tokens) if head not in covered]
    bare = [" ".join(noun) for at, noun in known_nouns(tokens) if at not in used and noun[-1] not in covered]
    for noun in (*heads, *bare):
        if noun not in free and noun.split()[-1] not in free:
            message = str(UnknownNameError("object", noun, _usual_nouns(grammar.template.name))).rstrip(".")
            elsewhere = [name for name in GRAMMARS if tuple(terms(noun)) in _nouns(name)]
            hint = f"; {', '.join(elsewhere)} has it" if elsewhere else ""
            raise InvalidInputError(
                "sentence", f"{message} for {grammar.template.name}{hint}", "Use objects from the library"
            )
