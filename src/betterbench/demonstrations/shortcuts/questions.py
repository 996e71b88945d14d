"""Questions of the shortcut audit: pairs of variables that may be associated in demonstrations."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from betterbench.demonstrations.shortcuts.facts import EpisodeFacts
from betterbench.demonstrations.shortcuts.words import instruction_words

Pair = tuple[str, str]
"""Values of the two variables in one observation."""


@dataclass(frozen=True, slots=True)
class Question:
    """Question whether a policy could infer one variable from another.

    Attributes:
        name: Name that identifies the question in JSON files.
        title: The question in words.
        rule: Template for the text of a finding. ``{x}`` is the first value, and ``{y}`` is the second (inferred)
            value.
        pairs: Function that returns the observations (pairs of values) in a demonstration. Its second argument is the
            set of object kinds that are picked in any demonstration; None means all kinds.
        within: Whether the test permutes values within a demonstration instead of between demonstrations.
        either_way: Whether the first value can also be inferred from the second.
    """

    name: str
    title: str
    rule: str
    pairs: Callable[[EpisodeFacts, frozenset[str] | None], list[tuple[str, str, str]]]
    within: bool = False
    either_way: bool = False


def handled_kinds(episodes: Iterable[EpisodeFacts]) -> frozenset[str]:
    """Return the kinds of objects that are picked in at least one demonstration."""
    return frozenset(step.thing for facts in episodes for step in facts.steps if step.thing and step.origin)


def _word_place(facts: EpisodeFacts, handled: frozenset[str] | None) -> list[tuple[str, str, str]]:
    del handled
    return [(f"{facts.episode}:{i}", s.word, s.origin) for i, s in enumerate(facts.steps) if s.word and s.origin]


def _thing_place(facts: EpisodeFacts, handled: frozenset[str] | None) -> list[tuple[str, str, str]]:
    return [(facts.episode, kind, slot) for kind, slot in facts.standing if handled is None or kind in handled]


def _bystander_place(facts: EpisodeFacts, handled: frozenset[str] | None) -> list[tuple[str, str, str]]:
    return [(facts.episode, kind, slot) for kind, slot in facts.standing if handled is None or kind not in handled]


def _first_step(facts: EpisodeFacts, handled: frozenset[str] | None) -> list[tuple[str, str, str]]:
    del handled
    kinds = [step.thing for step in facts.steps if step.thing and step.origin]
    if len(set(kinds)) < 2:
        return []
    return [(facts.episode, kind, _ordinal(i)) for i, kind in enumerate(kinds, start=1)]


def _order(facts: EpisodeFacts, handled: frozenset[str] | None) -> list[tuple[str, str, str]]:
    del handled
    kinds = list(dict.fromkeys(step.thing for step in facts.steps if step.thing and step.origin))
    found = []
    for i, earlier in enumerate(kinds):
        for later in kinds[i + 1 :]:
            pair = " and ".join(sorted((earlier, later)))
            block = f"{facts.episode}:{pair}"
            found += [(block, f"{pair}: {earlier}", "earlier"), (block, f"{pair}: {later}", "later")]
    return found


def _thing_target(facts: EpisodeFacts, handled: frozenset[str] | None) -> list[tuple[str, str, str]]:
    del handled
    carried = [s for s in facts.steps if s.thing and s.origin and s.target]
    return [(f"{facts.episode}:{i}", s.thing, s.target) for i, s in enumerate(carried)]


def _landmark_place(facts: EpisodeFacts, handled: frozenset[str] | None) -> list[tuple[str, str, str]]:
    where = " and ".join(f"{kind} at {slot}" for kind, slot in facts.landmarks)
    if not where:
        return []
    return [(facts.episode, where, slot) for kind, slot in facts.standing if handled is None or kind in handled]


def _ordinal(number: int) -> str:
    return {1: "first", 2: "second", 3: "third", 4: "fourth"}.get(number, f"step {number}")


QUESTIONS = (
    Question("word_place", "word and place", "“{x}” is taken from {y}", _word_place),
    Question("thing_place", "thing and place", "{x} stands at {y}", _thing_place, within=True, either_way=True),
    Question(
        "bystander_place", "bystander and place", "{x} stands at {y}", _bystander_place, within=True, either_way=True
    ),
    Question("first_step", "object and step", "{x} is handled {y}", _first_step, within=True),
    Question("order", "order of two objects", "of {x} is handled {y}", _order, within=True),
    Question("thing_target", "object and target", "{x} is brought to {y}", _thing_target),
    Question("landmark_place", "place of the target and of objects", "with {x}, objects stand at {y}", _landmark_place),
)
"""Questions about named objects. They do not apply to external data sets, whose objects have no names."""


@dataclass(frozen=True, slots=True)
class WordOutcome:
    """Property of a demonstration that the words of its instruction may predict.

    Attributes:
        name: Name of the question about single words.
        what: Description of the property.
        rule: Template for the text of a finding. ``{y}`` is the value of the property.
        of: Function that returns the value of the property for a demonstration, or "" if the demonstration has none.
        missing: Reason to report if no demonstration has the property.
        is_place: Whether the property is a place, a direction or a side, so that a word such as "left" may refer to it.
    """

    name: str
    what: str
    rule: str
    of: Callable[[EpisodeFacts], str]
    missing: str
    is_place: bool = True

    def question(self, level: str) -> str:
        """Return the name of the question about single words, about word pairs, or about complete instructions.

        Args:
            level: What the question is about.
        """
        return self.name + level

    def title(self, level: str) -> str:
        """Return the title of the question about single words, about word pairs, or about complete instructions.

        Args:
            level: What the question is about.
        """
        return f"{_LEVELS[level]} and {self.what}"


def _arm(facts: EpisodeFacts) -> str:
    """Return the arm that acts first, or "" for facts about other subjects.

    Facts about the arm that acts first contain the name of the arm instead of an object, and their steps have no
    places.
    """
    step = facts.steps[0] if facts.steps and not facts.privileged else None
    return step.thing if step is not None and not step.origin and not step.target else ""


def _is_named(facts: EpisodeFacts) -> bool:
    """Return whether the objects have names.

    Facts about the arm that acts first contain names of arms instead of objects, so the result is False for these
    facts.
    """
    return facts.privileged or any(step.thing and step.origin for step in facts.steps)


def _first_object(facts: EpisodeFacts) -> str:
    """Return the first picked object.

    Return "" if only one object is picked and the instruction names it, because the outcome is then certain.
    """
    taken = [step for step in facts.steps if step.thing and step.origin]
    several = len({step.thing for step in taken}) > 1
    return taken[0].thing if taken and (several or not instruction_words(taken[0].word) & facts.words) else ""


def _sequence(facts: EpisodeFacts) -> str:
    """Return the picked objects in order. If the objects have no names, return their origins in order."""
    taken = [step.thing if _is_named(facts) else step.origin for step in facts.steps if step.origin]
    order = list(dict.fromkeys(name for name in taken if name))
    return ", then ".join(order) if len(order) > 1 else ""


COUNT, LANDMARK = "count", "landmark"
"""Names of the questions about constants: the initial number of objects, and the slot of a landmark.

There is no test for these questions, because a constant is not an association.
"""
FIRST_PLACE, LAST_PLACE, HEADING = "words_first_place", "words_last_place", "words_heading"
FIRST_OBJECT, SEQUENCE, ARM = "words_first_object", "words_order", "words_arm"
"""Names of the questions about the words of the instruction.

Their outcomes are, in this order, the place where the gripper first closes, the place where it last opens, its first
direction, the first picked object, the order of the picked objects, and the arm that acts first.
"""

WORDS, PAIRS, WHOLE = "", "_together", "_whole"
"""Suffixes in the names of questions about single words, word pairs and complete instructions."""
_LEVELS = {WORDS: "words", PAIRS: "two words", WHOLE: "whole instruction"}

_NO_GRASP = "no demonstration has this outcome"
WORD_OUTCOMES = {
    outcome.name: outcome
    for outcome in (
        WordOutcome(
            FIRST_PLACE,
            "first place",
            "first taken from {y}",
            lambda f: f.steps[0].origin if f.steps else "",
            _NO_GRASP,
        ),
        WordOutcome(
            LAST_PLACE, "last target", "last brought to {y}", lambda f: f.steps[-1].target if f.steps else "", _NO_GRASP
        ),
        WordOutcome(HEADING, "first motion", "the gripper sets out {y}", lambda f: f.heading, _NO_GRASP),
        WordOutcome(
            FIRST_OBJECT, "first object", "{y} is handled first", _first_object, "objects have no names", is_place=False
        ),
        WordOutcome(
            SEQUENCE, "order", "the order is {y}", _sequence, "no demonstration takes two or more", is_place=False
        ),
        WordOutcome(ARM, "arm", "the {y} closes its gripper first", _arm, "no arms are compared"),
    )
}
"""Outcomes with which words, word pairs and complete instructions are compared."""


def base_of(question: str) -> str:
    """Return the question about single words that corresponds to a question about word pairs or complete instructions.

    The names of other questions are returned unchanged.
    """
    return question.removesuffix(PAIRS).removesuffix(WHOLE)
