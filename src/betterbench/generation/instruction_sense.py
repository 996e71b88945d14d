"""Checks of a scenario's instruction.

An instruction must be a single imperative sentence. It may name only objects of the scenario, and must not list the
steps.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from betterbench.generation.scenario import DescribedObject, Scenario
from betterbench.generation.sentence_words import RESULTS, color_before, phrase_heads, sentence_tokens, words_of_object
from betterbench.generation.stated_goal import goal_problems, stated_goal
from betterbench.generation.stated_goal.direction import read_text
from betterbench.generation.vocabulary import collective, head_nouns, known_nouns
from betterbench.sim.assets.catalogue.expansion import COLORS
from betterbench.sim.assets.catalogue.terms import terms
from betterbench.tasks.authoring.template import Template

MOST_WORDS = 25
"""Maximum number of words in an instruction."""
FEWEST_WORDS = 3
"""Minimum number of words in an instruction: a verb, an article and a noun."""

_VERBS_WORDS = """
add align arrange assemble bring build center clean clear collect complete compose construct create deliver drop
feed file fill fit form gather get give help insert insert keep lay layer leave load lower make move organize pack
park place plug pop position prepare push put return rinse serve set slide slot sort stack stash stock store stow
tidy throw toss transfer tuck unload unpack use
"""
VERBS = frozenset(_VERBS_WORDS.split())
"""Verbs that may begin an instruction."""

_CHAINS_WORDS = """
then afterward afterwards after before finally followed firstly secondly lastly once until
"""
_CHAINS = frozenset(_CHAINS_WORDS.split())
"""Words that express an order of steps."""
_STEPS = re.compile(r"\b(?:first|next|last|second|third)\s*,|\band (?:first|next|last|finally)\b", re.IGNORECASE)

_PLACES_WORDS = """
table desk counter kitchen side left right middle center top bottom front back corner ring mark hole drawer spot
place position area slot row column set stack pile order lunch breakfast dinner supper brunch meal snack picnic
party cookout item object supply content guest person meeting work day morning trip school setting arrangement room
home family child kid customer condiment bottle worker one rest workspace trash garbage litter leftover gear kit
shelf coffee tea clutter workstation service seasoning spout tray
"""
PLACES = frozenset(_PLACES_WORDS.split())
"""Head nouns that name a place, an occasion or objects in general."""

Found = tuple[str, str, str]


def instruction_problems(scenario: Scenario, template: Template) -> Iterator[Found]:
    """Yield the problems of an instruction, with the path of the field and a remedy for each problem.

    The rules for nouns are conservative. A known noun, and the last word of a phrase with an article, must occur in the
    description, query, name or tags of an object. The instruction may also name places ("the desk"), occasions ("the
    picnic") and general nouns ("the supplies"). Words of the context and of the scenario's name are allowed too, and so
    is the result of an assembly ("a sandwich"). If a known noun follows a color, there must be an object with this noun
    and this color. Collective nouns such as "fruit" and "toys" require at least one object of that kind.
    """
    for problem, cure in (
        *_sentence_problems(scenario.instruction, read_text(scenario)),
        *_chain_problems(scenario, template),
        *goal_problems(scenario, template),
        *noun_problems(scenario, template),
    ):
        yield "instruction", problem, cure


def _sentence_problems(text: str, read: str) -> Iterator[tuple[str, str]]:
    """Yield the problems with the form of an instruction, each with a remedy.

    ``read`` is the sentence without the clauses about the direction of cutlery, because these clauses do not count
    toward the length of the sentence.
    """
    words = re.findall(r"[\w'-]+", read)
    if not text.endswith(".") or text.count(".") > 1:
        yield f"{text!r} is not one sentence that ends with a period", "Write one sentence with one period at its end"
    if not FEWEST_WORDS <= len(words) <= MOST_WORDS:
        yield f"has {len(words)} words", f"Write {FEWEST_WORDS} to {MOST_WORDS} words"
    if words and words[0].lower() not in VERBS:
        cure = "Begin with a verb in the imperative, such as Put, Pack, Set, Stack or Make"
        yield f"begins with {words[0]!r}, which is not a known verb in the imperative", cure
    elif not text[:1].isupper():
        yield f"{text!r} begins with a small letter", "Begin with a capital letter"
    wrong = re.search(r"\b(?:[Aa] (?=[aeio])(?!one\b|once\b|eu)|[Aa]n (?=[^aeiouh\W]))(\w+)", text)
    if wrong:
        yield f"has the wrong article in {wrong[0]!r}", "Write a before a consonant and an before a vowel"


def _chain_problems(scenario: Scenario, template: Template) -> Iterator[tuple[str, str]]:
    text = scenario.instruction
    cure = "State the goal and not the steps, as in 'Make a ham sandwich on the plate.'"
    chained = _CHAINS & set(re.findall(r"[a-z]+", text.lower()))
    if chained or _STEPS.search(text):
        word = min(chained) if chained else "first or next"
        yield f"chains steps with {word!r}", cure
    # A list of items with their places is allowed, because it states a goal and not steps.
    placed = stated_goal(scenario).placed
    for group in template.groups:
        objects = scenario.groups.get(group.group_id, ())
        if all(o.instance_name in placed for o in objects):
            continue
        if group.role == "item" and len(objects) > 2 and _lists_all(text, objects):
            yield f"lists all {len(objects)} objects of the group {group.group_id!r}", cure


def _lists_all(text: str, objects: tuple[DescribedObject, ...]) -> bool:
    """Return whether an instruction names each of the objects.

    An object is named by a word that fits no other object, or by its noun together with its color.
    """
    words = set(terms(text))
    heads = [_head(o) for o in objects]
    shared = {word for head in heads for word in head if sum(word in other for other in heads) > 1}

    def named(o: DescribedObject, head: frozenset[str]) -> bool:
        by_color = COLORS & words & set(terms(f"{o.asset_query} {o.description}"))
        return bool(words & (head - shared)) or bool(words & head and by_color)

    return all(named(o, head) for o, head in zip(objects, heads, strict=True))


def _head(described: DescribedObject) -> frozenset[str]:
    nouns = head_nouns(described.asset_query) or head_nouns(described.description)
    return frozenset(nouns[-1]) if nouns else frozenset(terms(described.asset_query)[-1:])


def noun_problems(scenario: Scenario, template: Template) -> Iterator[tuple[str, str]]:
    """Yield a problem and a remedy for each noun that names no object of the scenario."""
    objects = [words_of_object(o) for group in scenario.groups.values() for o in group]
    there = frozenset().union(*objects)
    free = PLACES | (RESULTS if template.relation == "layer" else frozenset())
    free |= frozenset(terms(scenario.context))
    tokens = sentence_tokens(read_text(scenario))
    cure = "Name only objects of the scenario"
    said: set[str] = set()
    for at, noun in known_nouns(tokens):
        name, last = " ".join(noun), noun[-1]
        color = color_before(tokens, at)
        if at == 0 or last in free:  # "File the papers." begins with a verb
            continue
        if last not in there and not (collective(last) and _has_member(scenario, last)):
            said.add(last)
            yield f"names a {name}, which is not among the objects", cure
        elif color and not any(last in words and color in words for words in objects):
            yield f"names a {color} {name}, which is not among the objects", cure
    allowed = free | there | said | frozenset(terms(scenario.name)) | COLORS
    for head in phrase_heads(tokens):
        if collective(head):
            if head not in there and not _has_member(scenario, head):
                yield f"names {head}, but no object is one", cure
        elif head not in allowed:
            yield f"names a {head}, which is not among the objects", cure


def _has_member(scenario: Scenario, noun: str) -> bool:
    members = collective(noun)
    objects = [o for group in scenario.groups.values() for o in group]
    texts = [text for o in objects for text in (o.asset_query, o.description)]
    return any(head in members for text in texts for head in head_nouns(text))
