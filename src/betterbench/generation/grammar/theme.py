"""Themes of a template. A theme is a context, such as a kitchen, with objects that fit it."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from betterbench.sim.assets import colors
from betterbench.tasks.authoring.template import Template

Kind = tuple[str, str]
"""Category and color of an object."""

Choice = Mapping[str, tuple[Kind, ...]]
"""Chosen objects by ``group_id``."""


@dataclass(frozen=True, slots=True)
class Pool:
    """Set of library objects. Some of them are drawn for each scenario.

    Attributes:
        categories: Asset categories of the library.
        count: Number of objects drawn for a scenario.
        colors: Allowed colors. If it is empty, all colors of the category are allowed.
        by_color: Whether the drawn objects must differ in color but may have the same category. If it is false, they
            must differ in category.
        only: Allowed kinds (category and color). If it is empty, all kinds are allowed.
    """

    categories: tuple[str, ...]
    count: int = 1
    colors: tuple[str, ...] = ()
    by_color: bool = False
    only: tuple[Kind, ...] = ()

    def kinds(self, category: str) -> list[Kind]:
        """Return the allowed kinds (category and color) of a category."""
        every = ((category, color) for color in colors(category) if not self.colors or color in self.colors)
        return [kind for kind in every if not self.only or kind in self.only]

    def choices(self) -> Iterator[tuple[Kind, ...]]:
        """Yield all choices of objects from the pool, ignoring their order."""
        if self.by_color:
            every = [kind for category in self.categories for kind in self.kinds(category)]
            chosen = itertools.combinations(every, self.count)
            yield from (kinds for kinds in chosen if len({color for _, color in kinds}) == self.count)
            return
        kinds = {category: self.kinds(category) for category in self.categories}
        for categories in itertools.combinations(self.categories, self.count):
            yield from itertools.product(*(kinds[category] for category in categories))


@dataclass(frozen=True, slots=True)
class Group:
    """Objects that a theme provides for an object group of the template.

    Attributes:
        pools: Pools that the objects are drawn from.
        colors_differ: Whether all objects must have different colors. If it is false, no two objects may be identical,
            but colors can repeat.
        follows: Name of the group whose color the objects must have. For example, drawers have the color of the
            cabinet.
    """

    pools: tuple[Pool, ...]
    colors_differ: bool = False
    follows: str = ""

    def color_after(self, before: Choice) -> str:
        """Return the color that all objects of the group must have, or an empty string if any color is allowed."""
        return before[self.follows][0][1] if self.follows else ""

    def choices(self, color: str) -> Iterator[tuple[Kind, ...]]:
        """Yield all choices of objects for the group, given their color (see :meth:`color_after`)."""
        for parts in itertools.product(*(pool.choices() for pool in self.pools)):
            kinds = tuple(itertools.chain.from_iterable(parts))
            if color and any(own != color for _, own in kinds):
                continue
            if len({own for _, own in kinds} if self.colors_differ else set(kinds)) == len(kinds):
                yield kinds


@functools.cache
def _choices_of(group: Group, color: str) -> tuple[tuple[Kind, ...], ...]:
    """Return all choices of objects for a group. Several themes and many sentences of a user share them."""
    return tuple(group.choices(color))


@dataclass(frozen=True, slots=True)
class Theme:
    """A context of a template with objects that fit it.

    Attributes:
        name: Name of the scenarios with this theme ("Packing a picnic").
        context: Place or situation ("park").
        instructions: Wordings of the instruction. A placeholder such as ``{container}`` stands for the first object of
            that group.
        groups: Objects by ``group_id``, in the order of the template.
    """

    name: str
    context: str
    instructions: tuple[str, ...]
    groups: Mapping[str, Group]

    def choices(self, fits: Callable[[str, tuple[Kind, ...]], bool] = lambda _group, _kinds: True) -> Iterator[Choice]:
        """Yield all choices of objects for the theme in which the objects of every group pass ``fits``."""
        known: dict[tuple[str, str], list[tuple[Kind, ...]]] = {}  # by group and color

        def of_group(name: str, before: Choice) -> list[tuple[Kind, ...]]:
            key = name, self.groups[name].color_after(before)
            if key not in known:
                known[key] = [kinds for kinds in _choices_of(self.groups[name], key[1]) if fits(name, kinds)]
            return known[key]

        def extended(before: Choice, rest: list[str]) -> Iterator[Choice]:
            if not rest:
                yield before
                return
            name, *later = rest
            for kinds in of_group(name, before):
                yield from extended({**before, name: kinds}, later)

        yield from extended({}, list(self.groups))


@dataclass(frozen=True, slots=True)
class Grammar:
    """Themes of a template. The offline author uses them to write scenarios.

    Attributes:
        template: Template that the scenarios fill.
        themes: Themes of the template.
        requested: Name of a scenario whose objects were named by the user and occur together in no theme.
        general: Instruction for these scenarios.
        most_items: Maximum number of items that the pattern of the template supports.
    """

    template: Template
    themes: tuple[Theme, ...]
    requested: str
    general: str
    most_items: int = 4

    def categories(self, group_id: str) -> tuple[str, ...]:
        """Return the categories that a group may contain, in the order of the themes."""
        pools = (pool for theme in self.themes for pool in theme.groups[group_id].pools)
        return tuple(dict.fromkeys(category for pool in pools for category in pool.categories))


GRAMMARS: dict[str, Grammar] = {}
"""Grammar of each template, by the name of the template."""


def register(grammar: Grammar) -> Grammar:
    """Register the grammar of a template, and return it."""
    GRAMMARS[grammar.template.name] = grammar
    return grammar


def one(*categories: str, colors: Iterable[str] = ()) -> Group:
    """Return a group with one object of the given categories."""
    return Group((Pool(categories, colors=tuple(colors)),))


def several(count: int, *categories: str) -> Group:
    """Return a group with some objects, each of a different category."""
    return Group((Pool(categories, count),))
