"""Conservative detection of the objects named in an instruction. Unclear nouns are reported as undecided.

Known nouns are the names of the task's objects, the categories of our library, and the words in the catalogue's word
list. That list also contains classes such as "fruit".
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable
from dataclasses import dataclass

from betterbench.generation.better_release.files import ReleaseInstance, ReleaseTask
from betterbench.sim.assets import categories
from betterbench.sim.assets.catalogue.expansion import COLORS, understood, word_list
from betterbench.sim.assets.catalogue.terms import terms

Noun = tuple[str, ...]
"""Noun as a tuple of catalogue terms, in lower case and singular ("juice", "box")."""

_PREPOSITIONS = """
in into inside on onto upon at to near beside behind under over with from of next
"""
_BEFORE_TARGETS = frozenset(_PREPOSITIONS.split())
_EVERY = frozenset(("all", "both", "each", "every"))
_SOME = frozenset(("a", "an", "one", "two", "three", "some", "any", "several", "few"))
_BEGINS_CLAUSE = frozenset(("and", "then", "next", "first", "finally", "also"))
_KNOWN_VERBS = """
pack put place move pick take bring set stack insert drop store arrange load get hand lay sort collect gather fill push
pull transfer deposit slide lift grab tidy clear throw toss
"""
_VERBS = frozenset(_KNOWN_VERBS.split())
_NAMES_NOTHING = """
the this that these those it them its their up down away out back together carefully please item object thing remaining
other rest left right front top bottom center middle inside there here order table
"""
_PLAIN_WORDS = frozenset(_NAMES_NOTHING.split())
_KNOWN_ADJECTIVES = """
big small large little tall short round long ripe fresh shiny open closed empty full plastic wooden metal paper glass
single dark light plain clean
"""
_ADJECTIVES = frozenset(_KNOWN_ADJECTIVES.split())
_LIMITING = """
not except without but only never no unless if instead avoid leave
"""
_CHANGES_MEANING = frozenset(_LIMITING.split())


@dataclass(frozen=True, slots=True)
class Named:
    """Noun in an instruction, with the objects that it can refer to.

    Attributes:
        text: The noun in the singular ("juice box", "fruit").
        objects: Objects of the task that the noun can refer to, whether or not they are in the scene.
        every: Whether the noun refers to all of these objects, as in "the fruits". If not, it refers to at least one.
        is_class: Whether the noun is a class of objects ("fruit").
        is_target: Whether the noun follows a preposition, as in "into the lunchbox".
    """

    text: str
    objects: tuple[str, ...]
    every: bool
    is_class: bool
    is_target: bool


@dataclass(frozen=True, slots=True)
class Sentence:
    """Parsed instruction, with its known nouns.

    Attributes:
        text: Text of the instruction.
        nouns: Known nouns, in order.
        undecided: Reasons why the instruction cannot be compared with the goals. Empty if it can.
    """

    text: str
    nouns: tuple[Named, ...]
    undecided: tuple[str, ...]


class Lexicon:
    """Nouns that can refer to the objects of a task.

    Args:
        task: Task with the objects. Objects that are not in the scene have nouns too, so that an instruction that names
            them is recognized.
    """

    def __init__(self, task: ReleaseTask) -> None:
        self._nouns = {name: nouns_of(i, task.names.get(name, "")) for name, i in task.instances.items()}
        self._colors = {name: frozenset(_words_about(i)) & COLORS for name, i in task.instances.items()}
        self._phrases: dict[Noun, tuple[tuple[str, ...], bool]] = {}
        own: dict[Noun, dict[str, None]] = {}
        contained: dict[Noun, dict[str, None]] = {}
        for name, nouns in self._nouns.items():
            for noun in nouns:
                own.setdefault(noun, {})[name] = None
                for broader in classes_of(noun):
                    contained.setdefault(broader, {})[name] = None
        for phrase in self._known_phrases():
            if phrase in own:
                self._phrases[phrase] = tuple(own[phrase]), False
            else:
                self._phrases[phrase] = tuple(contained.get(phrase, ())), phrase in contained

    def noun(self, name: str) -> str:
        """Return the usual noun of an object ("juice box")."""
        return " ".join(self._nouns[name][0])

    def _known_phrases(self) -> Iterable[Noun]:
        yield from (noun for nouns in self._nouns.values() for noun in nouns)
        yield from (tuple(terms(category.replace("_", " "))) for category in categories())
        for phrase, others in word_list().items():
            yield phrase
            yield from (other for other, _ in others)

    def parse(self, text: str) -> Sentence:
        """Find the known nouns of an instruction, and the words that make its meaning unclear."""
        raw = re.findall(r"[^\W_]+|[,.;]", text.lower())
        words = [(terms(word) or [word])[0] for word in raw]
        undecided = [f"the word {word!r} may change the meaning" for word in raw if word in _CHANGES_MEANING]
        nouns: list[Named] = []
        modifiers: list[str] = []
        target, begins = False, True
        at = 0
        while at < len(words):
            word = words[at]
            length = self._longest(words, at)
            if begins and (word in _VERBS or not length) and word.isalpha() and word not in _PLAIN_WORDS:
                begins = word in _BEGINS_CLAUSE
                undecided += [] if word in _VERBS or begins else [f"the verb {raw[at]!r} is not known"]
                modifiers, target = [], False
                at += 1
            elif length:
                nouns.append(self._named(words, raw, at, length, modifiers, target=target))
                modifiers, begins = [], False
                at += length
            else:
                if word in ",.;":
                    modifiers, begins = [], word != ","
                elif word in _BEGINS_CLAUSE and word != "next":
                    modifiers = []
                    begins = at + 1 < len(words) and words[at + 1] in (_VERBS | _BEGINS_CLAUSE)
                elif word in _BEFORE_TARGETS:
                    target, modifiers = True, []
                elif word in _EVERY | _SOME | _ADJECTIVES | COLORS | _PLAIN_WORDS | _VERBS or not word.isalpha():
                    modifiers.append(word)
                elif not self._longest(words, at + 1):  # an unknown word before a noun is an adjective
                    undecided.append(f"the word {raw[at]!r} is not a known noun")
                at += 1
        if not nouns:
            undecided.append("no known noun")
        return Sentence(text, tuple(nouns), tuple(dict.fromkeys(undecided)))

    def _longest(self, words: list[str], at: int) -> int:
        """Return the number of words in the longest known noun at a position, or 0 if no noun begins there."""
        for length in range(min(4, len(words) - at), 0, -1):
            phrase = tuple(words[at : at + length])
            if phrase not in self._phrases or set(phrase) <= _PLAIN_WORDS | _VERBS | _ADJECTIVES:
                continue
            if set(phrase) <= COLORS and not (self._phrases[phrase][0] and self._ends_noun(words, at + length)):
                continue  # "the orange" is a fruit, but "the orange block" is not
            return length
        return 0

    def _ends_noun(self, words: list[str], at: int) -> bool:
        while at < len(words) and words[at] in _ADJECTIVES | COLORS:
            at += 1
        return not self._longest(words, at)

    def _named(
        self, words: list[str], raw: list[str], at: int, length: int, modifiers: list[str], *, target: bool
    ) -> Named:
        phrase = tuple(words[at : at + length])
        objects, is_class = self._phrases[phrase]
        said = set(modifiers) & COLORS
        of_color = tuple(name for name in objects if said & self._colors[name])
        plural = raw[at + length - 1] != words[at + length - 1]
        every = bool(set(modifiers) & _EVERY) or (plural and not set(modifiers) & _SOME)
        return Named(" ".join(phrase), of_color or objects, every, is_class, target)


@functools.cache
def classes_of(noun: Noun) -> tuple[Noun, ...]:
    """Return the sorted classes of a noun according to the word list ("fruit" for "banana")."""
    return tuple(sorted(phrase for phrase, others in word_list().items() if noun in dict(others) and phrase != noun))


def nouns_of(instance: ReleaseInstance, name: str = "") -> tuple[Noun, ...]:
    """Return the nouns of an object, starting with the usual noun: "juice box", "box".

    Args:
        instance: Object. The nouns are taken from its semantic name, or else from its query and description.
        name: Additional semantic name of the object, from the asset bindings.
    """
    semantic = tuple(terms(instance.semantic_name or ""))
    described = tuple(filter(None, map(_head, (instance.retrieval_query, instance.description))))
    found = [semantic, semantic[-1:]] if semantic else list(described)
    found.append(tuple(terms(name)))
    # "block" before "red block": the color is read from the words before the noun
    plain = [tuple(word for word in noun if word not in COLORS) or noun for noun in found if noun]
    return tuple(dict.fromkeys((*plain, *filter(None, found)))) or (
        tuple(terms(instance.instance_id)) or (instance.instance_id.lower(),),
    )


def _head(text: str) -> Noun:
    """Return the head noun of a description ("lunchbox" for "an open lunchbox"). Empty if there is none."""
    concepts = understood(text).concepts if text.strip() else ()
    return next((c.alternatives[0][0] for c in concepts if c.weight >= 1.0), ())


def _words_about(instance: ReleaseInstance) -> list[str]:
    return terms(" ".join((instance.semantic_name or "", instance.retrieval_query, instance.description)))


def color_of(instance: ReleaseInstance) -> str | None:
    """Return the color in the description of an object, or None if the description names no color or several colors."""
    colors = {word for word in _words_about(instance) if word in COLORS} - {noun[0] for noun in nouns_of(instance)[:1]}
    return next(iter(colors)) if len(colors) == 1 else None
