"""What the audit asks of a dataset: which two things could go together, and what each demonstration says of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from betterbench.shortcuts.facts import EpisodeFacts

Pair = tuple[str, str]
"""What goes together with what in one observation."""


@dataclass(frozen=True, slots=True)
class Question:
    """One thing that a learner could go by.

    Attributes:
        name: Its name in files.
        title: What is asked, for people.
        rule: How a finding is worded: what is known, and what follows from it.
        pairs: The observations of a demonstration; the kinds that are ever handled, or None to leave out none.
        within: Whether observations are exchanged within a demonstration and not between demonstrations.
        either_way: Whether the second value also tells the first.
    """

    name: str
    title: str
    rule: str
    pairs: Callable[[EpisodeFacts, frozenset[str] | None], list[tuple[str, str, str]]]
    within: bool = False
    either_way: bool = False


def handled_kinds(episodes: Iterable[EpisodeFacts]) -> frozenset[str]:
    """Return the kinds of thing that are ever taken from a place."""
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
    Question("first_step", "thing and step", "{x} is handled {y}", _first_step, within=True),
    Question("order", "order of two things", "of {x} is handled {y}", _order, within=True),
    Question("thing_target", "thing and target", "{x} is brought to {y}", _thing_target),
    Question("landmark_place", "place of the target and of things", "with {x}, things stand at {y}", _landmark_place),
)
"""The questions about named things; those of a stranger's dataset have no names, and only its words are asked about."""


def _arm(facts: EpisodeFacts) -> str:
    """Return the arm that acts first; facts about arms alone have steps without places."""
    step = facts.steps[0] if facts.steps and not facts.privileged else None
    return step.thing if step is not None and not step.origin and not step.target else ""


COUNT, LANDMARK = "count", "landmark"
"""The questions whether the number of things at the start, or the place of a landmark, ever differs.

They are no associations and need no test.
"""
FIRST_PLACE, LAST_PLACE, HEADING = "words_first_place", "words_last_place", "words_heading"
ARM = "words_arm"
"""Questions about every word of the instructions: where the gripper goes first and last, how it sets out, which arm."""
WORD_OUTCOMES: dict[str, tuple[str, str, Callable[[EpisodeFacts], str]]] = {
    FIRST_PLACE: ("words and first place", "first taken from {y}", lambda f: f.steps[0].origin if f.steps else ""),
    LAST_PLACE: ("words and last target", "last brought to {y}", lambda f: f.steps[-1].target if f.steps else ""),
    HEADING: ("words and first motion", "the gripper sets out {y}", lambda f: f.heading),
    ARM: ("words and arm", "the {y} closes its gripper first", _arm),
}
"""Per question its title, how a finding is worded, and the outcome of a demonstration ("" if it has none)."""
