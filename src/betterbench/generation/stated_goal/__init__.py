"""Parser for the goal that an instruction states.

It also finds the parts of this goal that the template does not support.

An instruction may state more than the objects: a side of the laptop, a hole of the rack, a number, an order.
:func:`stated_goal` parses these parts. Supported parts are stored in :class:`StatedGoal`, where the patterns look up
sides, drawers, holes and plates. Each unsupported part is reported as a problem together with its words. Every accepted
instruction therefore states exactly the goal of the task.

- ``relations``: the vocabulary.
- ``reading``: nouns with the objects they refer to, and relations between them.
- ``held``: relations that each pattern supports. ``demands``: negations, numbers, orders and poses, which no pattern
  supports.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from betterbench.generation.scenario import Scenario
from betterbench.generation.stated_goal.demands import number_problems, word_problems
from betterbench.generation.stated_goal.held import read_goal
from betterbench.generation.stated_goal.reading import Reader
from betterbench.generation.stated_goal.relations import READ_WORDS
from betterbench.tasks.authoring.template import Template
from betterbench.tasks.authoring.templates import TEMPLATES

__all__ = ["READ_WORDS", "StatedGoal", "example_about", "goal_problems", "stated_goal"]

_CAN = {
    "patterned_arrangement": "each item goes to a side of the anchor: left, right, and behind a laptop or at the upper "
    "right of a plate",
    "loose_packing": "items go into the container",
    "constrained_positioning": "one item goes on the ring of the fixture",
    "container_loading": "one item goes into the upper drawer and one into the lower drawer",
    "logical_assembly": "layers go onto the base, one on the other",
    "precision_insertion": "each item goes into a hole of the rack: left, middle or right",
    "recursive_stacking": "plates go on plates",
}
"""Relations that the pattern of each template supports."""


@dataclass(frozen=True, slots=True)
class StatedGoal:
    """Goal that an instruction states, limited to the parts that the template supports.

    Attributes:
        regions: Side, drawer ("upper") or hole ("hole_1") that each item goes to, by the item's ``instance_name``.
        onto: Pairs of an upper and a lower plate, by ``instance_name``.
        problems: Words of the unsupported parts, each with the reason.
    """

    regions: Mapping[str, str] = field(default_factory=dict)
    onto: tuple[tuple[str, str], ...] = ()
    problems: tuple[tuple[str, str], ...] = ()

    @property
    def placed(self) -> frozenset[str]:
        """Names of the objects with a target region in the instruction."""
        return frozenset(self.regions) | frozenset(name for pair in self.onto for name in pair)

    @property
    def is_specific(self) -> bool:
        """Whether the instruction states a side, drawer, hole or plate that the template does not determine."""
        return bool(self.regions or self.onto)


def goal_problems(scenario: Scenario, template: Template) -> Iterator[tuple[str, str]]:
    """Yield a problem and a remedy for each part of the stated goal that the template does not support."""
    for word, reason in stated_goal(scenario).problems:
        can = _CAN.get(template.name, template.description)
        cure = f"Write a sentence such as {example_about(scenario)!r}" if template.name in _CAN else "Leave it out"
        yield f"asks for {word!r}, but {reason}; in {template.name}, {can}", cure


def stated_goal(scenario: Scenario) -> StatedGoal:
    """Parse the goal that the instruction of a scenario states."""
    if scenario.template not in _CAN or not scenario.groups:
        return StatedGoal()
    reader = Reader(scenario)
    regions, onto, problems = read_goal(reader)
    found = (*word_problems(reader), *number_problems(reader), *problems)
    return StatedGoal(regions, onto, tuple(dict.fromkeys(found)))


def example_about(scenario: Scenario) -> str:
    """Return an example of a supported instruction, about the objects of a scenario."""
    template = TEMPLATES[scenario.template]
    roles = {group.group_id: group.role for group in template.groups}
    nouns = {
        role: [
            o.instance_name.replace("_", " ")
            for g, objects in scenario.groups.items()
            if roles[g] == role
            for o in objects
        ]
        for role in ("item", "container", "fixture")
    }
    items = nouns["item"] or ["item"]
    target = next((names[0] for names in (nouns["container"], nouns["fixture"]) if names), "")
    match scenario.template:
        case "patterned_arrangement":
            return f"Put the {items[0]} to the left of the {target}."
        case "loose_packing":
            return f"Put the {items[0]} into the {target}."
        case "constrained_positioning":
            return f"Put the {items[0]} on the ring of the {target}."
        case "container_loading":
            return f"Put the {items[0]} into the upper drawer."
        case "logical_assembly":
            made = "tower of blocks" if any("block" in item for item in items) else "burger"
            return f"Build a {made} on the {target}."
        case "precision_insertion":
            return f"Put the {items[0]} into the left hole of the {target}."
        case _:
            plates = sorted(scenario.groups["plates"], key=lambda o: sum(o.size_m))
            upper, lower = (o.instance_name.replace("_", " ") for o in (plates[0], plates[-1]))
            return f"Put the {upper} on the {lower}."
