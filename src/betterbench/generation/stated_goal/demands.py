"""Detection of words that a goal cannot express, such as negations, choices, orders, poses and numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from betterbench.generation.sentence_words import COUNTS, NUMBERS, RESULTS, number_before, words_of_object
from betterbench.generation.stated_goal.reading import Mention, Reader
from betterbench.generation.stated_goal.relations import (
    AGAIN,
    CHOICES,
    COMPARED,
    NEGATIONS,
    OPEN,
    ORDER,
    POSES,
    RELATIONS,
    THEN,
)
from betterbench.generation.vocabulary import COLLECTIVES

_LOADS = frozenset({"in", "into", "inside"})
_MAY_CHAIN = ("loose_packing", "logical_assembly")
"""Templates in which the order of the named objects matters. Their training conditions contain two steps."""


_NEVER = (
    (NEGATIONS, "goals cannot exclude objects"),
    (CHOICES, "goals cannot contain a choice or a condition"),
    (AGAIN, "steps cannot be repeated"),
)
_UNLESS_DESCRIBED = (
    (POSES, "poses of objects are not judged"),
    (OPEN, "goals cannot ask to open an object or to leave it open"),
)


def word_problems(r: Reader) -> Iterator[tuple[str, str]]:
    """Yield the words with a meaning that the goal of a task cannot express, and the reason for each.

    Such words state a negation, a choice, an order, a pose, or a number that does not count objects.
    """
    described = frozenset().union(*map(words_of_object, r.objects.values()))
    items = [m for m in r.mentions.values() if r.is_item(m)]
    for i, word in enumerate(r.tokens):
        if word in COMPARED:
            yield r.raw[i], "objects are distinguished by kind and color"
        if made := _result(r, i):
            yield r.raw[i], made
        if i in r.taken:
            continue
        reasons = [reason for words, reason in _NEVER if word in words]
        reasons += [reason for words, reason in _UNLESS_DESCRIBED if word in words and word not in described]
        reasons += [reason for read in (_closing, _number, _returning) if (reason := read(r, i))]
        if (word in THEN or word in ORDER or word == "first") and not _order_is_held(r, i, items):
            reasons.append("the goal has no such order")
        yield from ((r.raw[i], reason) for reason in reasons)


def _closing(r: Reader, at: int) -> str:
    """Return the reason why a request to close something is rejected, or an empty string.

    Only drawers can be closed, and only after something is put into them.
    """
    if r.tokens[at] not in ("close", "shut") or r.tokens[at + 1 : at + 2] == ["to"]:
        return ""
    if r.scenario.template != "container_loading":
        return "no object is closed in this template"
    return "" if _LOADS & set(r.tokens) else "a drawer is closed after something was put into it"


def _returning(r: Reader, at: int) -> str:
    """Return the reason why a request to put an object "back" or "away" is rejected, or an empty string.

    Such a request is rejected if it names no target.
    """
    if r.tokens[at] not in ("back", "away") or not any(r.is_item(m) and m.end == at for m in r.mentions.values()):
        return ""
    is_last = not r.tokens[at + 1 :] or r.tokens[at + 1] in (",", ".", "and")
    return "this is not part of the goal" if is_last and any((word,) in RELATIONS for word in r.tokens[:at]) else ""


def _result(r: Reader, at: int) -> str:
    """Return the reason why the named result of an assembly is rejected, or an empty string.

    A result is rejected if the layers do not make it, or if several results are requested.
    """
    if r.scenario.template != "logical_assembly" or r.tokens[at] not in RESULTS:
        return ""
    if number_before(r.raw, at) or r.raw[at] != r.tokens[at]:
        return "the layers make one"
    has_blocks = any("block" in words_of_object(layer) for layer in r.scenario.groups.get("layers", ()))
    return "layers of the goal are blocks" if has_blocks and r.tokens[at] != "tower" else ""


def _number(r: Reader, at: int) -> str:
    """Return the reason why a number is rejected, or an empty string.

    A number is rejected if it is too large for a scene, or does not refer to objects.
    """
    raw = r.raw[at]
    if raw in NUMBERS:
        return "" if _counts_a_noun(r, at) else "it does not refer to objects of the goal"
    if raw.isdigit() or r.tokens[at] in COUNTS:
        return "a scene has up to four objects of a kind, and their exact number must be stated"
    return ""


def _counts_a_noun(r: Reader, at: int) -> bool:
    """Return whether a number refers to objects or holes."""
    counted = (m.at for m in r.mentions.values() if m.at - 4 <= at < m.at)
    return any(number_before(r.raw, i) for i in counted) or "hole" in r.tokens[at + 1 : at + 3]


def _order_is_held(r: Reader, at: int, items: Sequence[Mention]) -> bool:
    """Return whether a stated order is supported.

    Supported orders concern the first two objects, or the closing of a drawer after loading it.
    """
    word = r.tokens[at]
    if r.scenario.template == "container_loading":
        return word == "then" and bool({"close", "shut"} & set(r.tokens[at + 1 : at + 3]))
    if r.scenario.template not in _MAY_CHAIN or word in ORDER or len(items) > 2:
        return False
    if word == "first":
        return len(items) < 2 or at < items[1].at
    return len(items) == 2 and items[0].end <= at <= items[1].at


def number_problems(r: Reader) -> Iterator[tuple[str, str]]:
    """Yield each number in the instruction that differs from the number of objects in the scenario, with the reason."""
    for mention in r.mentions.values():
        items = [n for n in mention.objects if r.role_of[n] in ("item", "drawer")]
        noun = r.raw[mention.end - 1]
        if not mention.number or not items or r.tokens[mention.end - 1] in COLLECTIVES:
            continue
        stated = number_before(r.raw, mention.at)
        number = 1 if r.scenario.template == "constrained_positioning" else len(items)
        if r.scenario.template == "logical_assembly" and stated:
            number = len(r.scenario.groups.get("layers", ())) - 1
        if mention.number > number or (stated and mention.number != number):
            yield stated or noun, f"the goal has {number} of the {noun}"
