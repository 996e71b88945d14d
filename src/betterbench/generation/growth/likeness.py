"""Detection of near-duplicates, which are tasks with the same template and the same categories of objects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Literal

from betterbench.generation.building.casting import choices
from betterbench.generation.grammar.theme import Kind
from betterbench.generation.scenario import Scenario
from betterbench.sim.assets import colors
from betterbench.sim.assets.catalogue.search import Catalogue
from betterbench.tasks import Condition, ObjectSpec, Task
from betterbench.tasks.authoring.templates import TEMPLATES
from betterbench.tasks.condition import Role

Distinct = Literal["categories", "colors"]
"""Smallest difference that makes two tasks count as different instead of near-duplicates.

With "categories", at least one object must have a different category. With "colors", a different color is enough.
"""

_RECEIVERS: tuple[Role, ...] = ("container", "fixture")


def key_of(template: str, kinds: Iterable[tuple[Role, Kind]], distinct: Distinct = "categories") -> str:
    """Return the key shared by near-duplicate tasks, such as "loose_packing: apple, lemon, orange; lunchbox".

    The key contains the distinct categories of the items and of the container, anchor or fixture. It does not depend on
    variants, names, numbers, sides, order, distractors or drawers.

    Args:
        template: Name of the template.
        kinds: Role, category and color of each object that is moved or receives other objects.
        distinct: Whether the key contains only categories ("categories") or also colors ("colors").
    """
    found: dict[bool, set[str]] = {False: set(), True: set()}
    for role, (category, color) in kinds:
        if role == "item" or role in _RECEIVERS:
            colored = distinct == "colors" and color and len(colors(category)) > 1
            found[role in _RECEIVERS].add(f"{color} {category}" if colored else category)
    parts = [", ".join(sorted(names)) for names in (found[False], found[True]) if names]
    return f"{template}: {'; '.join(parts)}"


def key_of_choice(template: str, choice: Mapping[str, Iterable[Kind]], distinct: Distinct = "categories") -> str:
    """Return the near-duplicate key for the objects that the grammar chose for each group."""
    roles = _roles(template)
    return key_of(template, ((roles[group], kind) for group, kinds in choice.items() for kind in kinds), distinct)


def key_of_scenario(scenario: Scenario, catalogue: Catalogue, distinct: Distinct = "categories") -> str:
    """Return the near-duplicate key of a scenario. It is computed from the assets that a search finds.

    Raises:
        InvalidInputError: If a description has no suitable asset.
    """
    roles = _roles(scenario.template)
    found = choices(scenario, catalogue)
    kinds = ((roles[choice.group], (choice.entry.category, choice.entry.color)) for choice in found)
    return key_of(scenario.template, kinds, distinct)


def key_of_task(task: Task, distinct: Distinct = "categories") -> str:
    """Return the near-duplicate key of a task. It is computed from all training instructions."""
    objects = (spec for condition in task.training for spec in _used(condition))
    return key_of(task.template.name, ((o.role, (o.category, o.color or "")) for o in objects), distinct)


def _used(condition: Condition) -> Iterator[ObjectSpec]:
    for subgoal in condition.instruction.subgoals:
        yield from map(condition.object, (*condition.resolve(subgoal.reference), subgoal.target))


def _roles(template: str) -> Mapping[str, Role]:
    return {group.group_id: group.role for group in TEMPLATES[template].groups}
