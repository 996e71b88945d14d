"""Themes of a template: contexts with suitable objects."""

from __future__ import annotations

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
    """Pool of objects for a scenario.

    Attributes:
        categories: Categories of the library.
        count: Number of objects drawn for a scenario.
        colors: Allowed colors; all colors of the category if empty.
        by_color: Whether objects differ in color and may have the same category. Otherwise, they differ in category.
        only: Allowed kinds; all if empty.
    """

    categories: tuple[str, ...]
    count: int = 1
    colors: tuple[str, ...] = ()
    by_color: bool = False
    only: tuple[Kind, ...] = ()

    def kinds(self, category: str) -> list[Kind]:
        """Return the kinds of a category."""
        every = ((category, color) for color in colors(category) if not self.colors or color in self.colors)
        return [kind for kind in every if not self.only or kind in self.only]

    def choices(self) -> Iterator[tuple[Kind, ...]]:
        """Yield all choices of objects, ignoring order."""
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
    """Objects of a group of the template.

    Attributes:
        pools: Pools that contribute the objects.
        colors_differ: Whether all objects must have different colors. Otherwise, they must only not be identical.
        follows: Group whose color the objects share, such as the cabinet for its drawers.
    """

    pools: tuple[Pool, ...]
    colors_differ: bool = False
    follows: str = ""

    def color_after(self, before: Choice) -> str:
        """Return the color that the objects must share, or an empty text."""
        return before[self.follows][0][1] if self.follows else ""

    def choices(self, before: Choice) -> Iterator[tuple[Kind, ...]]:
        """Yield all choices, given those of the previous groups."""
        color = self.color_after(before)
        for parts in itertools.product(*(pool.choices() for pool in self.pools)):
            kinds = tuple(itertools.chain.from_iterable(parts))
            if color and any(own != color for _, own in kinds):
                continue
            if len({own for _, own in kinds} if self.colors_differ else set(kinds)) == len(kinds):
                yield kinds


@dataclass(frozen=True, slots=True)
class Theme:
    """Theme: a context of a template.

    Attributes:
        name: Name of its scenarios ("Packing a picnic").
        context: Place or situation ("park").
        instructions: Wordings of the instruction; ``{container}`` stands for the first object of that group.
        groups: Objects by ``group_id``, in the order of the template.
    """

    name: str
    context: str
    instructions: tuple[str, ...]
    groups: Mapping[str, Group]

    def choices(self, fits: Callable[[str, tuple[Kind, ...]], bool] = lambda _group, _kinds: True) -> Iterator[Choice]:
        """Yield all choices of objects that fit in each group."""
        known: dict[tuple[str, str], list[tuple[Kind, ...]]] = {}  # the choices of a group depend on a color alone

        def of_group(name: str, before: Choice) -> list[tuple[Kind, ...]]:
            key = name, self.groups[name].color_after(before)
            if key not in known:
                known[key] = [kinds for kinds in self.groups[name].choices(before) if fits(name, kinds)]
            return known[key]

        def extended(before: Choice, rest: list[str]) -> Iterator[Choice]:
            if not rest:
                yield before
                return
            for kinds in of_group(rest[0], before):
                yield from extended({**before, rest[0]: kinds}, rest[1:])

        yield from extended({}, list(self.groups))


@dataclass(frozen=True, slots=True)
class Grammar:
    """Themes of a template.

    Attributes:
        requested: Name for scenarios whose user-named objects fit no theme.
        general: Instruction for such scenarios.
        most_items: Maximum number of items supported by the template's pattern.
    """

    template: Template
    themes: tuple[Theme, ...]
    requested: str
    general: str
    most_items: int = 4

    def categories(self, group_id: str) -> tuple[str, ...]:
        """Return the categories that a group may have, in the order of the themes."""
        pools = (pool for theme in self.themes for pool in theme.groups[group_id].pools)
        return tuple(dict.fromkeys(category for pool in pools for category in pool.categories))


GRAMMARS: dict[str, Grammar] = {}
"""Grammars by the name of their template."""


def register(grammar: Grammar) -> Grammar:
    """Register the grammar of a template."""
    GRAMMARS[grammar.template.name] = grammar
    return grammar


def one(*categories: str, colors: Iterable[str] = ()) -> Group:
    """Return a group of one object."""
    return Group((Pool(categories, colors=tuple(colors)),))


def several(count: int, *categories: str) -> Group:
    """Return a group of objects of different categories."""
    return Group((Pool(categories, count),))
