"""Clauses about the direction of cutlery in an instruction. An instruction may not state any other direction."""

from __future__ import annotations

import re

from betterbench.generation.scenario import Scenario
from betterbench.generation.sentence_words import sentence_tokens
from betterbench.generation.vocabulary import known_nouns
from betterbench.tasks.relations.beside import CUTLERY

ARRANGED = "patterned_arrangement"
_COLLECTIVES = frozenset({"cutlery", "silverware", "flatware"})
_ANCHORS = frozenset({"plate", "dish", "saucer", "platter", "laptop"})
_CLAUSE = re.compile(
    r",?\s*(?:and )?with (?P<whose>its|their|the) handles?(?: of (?P<of>the \w+(?:(?:,| and)+ the \w+)*))?"
    r"(?: pointing| facing| turned)? (?:to|toward|towards) the front(?: edge)?(?: of the table)?"
    r"(?:,?(?: and)? not to (?:a|the|either) side)?(?=[,.]| and\b|$)",
    re.IGNORECASE,
)


def without_direction(text: str) -> str:
    """Remove clauses about cutlery such as "with its handle to the front" from an instruction.

    All cutlery next to a plate points in this direction, so the clause adds nothing to the goal. Clauses about other
    objects or other directions are not removed.
    """
    return _CLAUSE.sub(lambda found: "" if _is_of_cutlery(found) else found[0], text)


def read_text(scenario: Scenario) -> str:
    """Return the part of a scenario's instruction that is parsed word by word.

    Clauses about the direction of cutlery are removed from instructions for place settings and similar arrangements.
    """
    text = scenario.instruction
    return without_direction(text) if scenario.template == ARRANGED else text


def _is_of_cutlery(found: re.Match[str]) -> bool:
    if found["of"]:
        owners = [word for word in sentence_tokens(found["of"]) if word not in ("the", "and", ",")]
    else:
        before = sentence_tokens(found.string[: found.start()])
        owners = [noun[-1] for at, noun in known_nouns(before) if at and noun[-1] not in _ANCHORS]
        owners = owners if found["whose"].lower() == "their" else owners[-1:]
    return bool(owners) and set(owners) <= CUTLERY | _COLLECTIVES
