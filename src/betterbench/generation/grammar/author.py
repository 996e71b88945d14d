"""Author that writes scenarios without a language model. It draws them at random from the themes of a template."""

from __future__ import annotations

import functools
import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from betterbench.errors import InvalidInputError, UnknownNameError, require_between
from betterbench.generation.grammar.nouns import described, phrase_of, short_name
from betterbench.generation.grammar.theme import GRAMMARS, Choice, Grammar, Group, Kind, Pool, Theme
from betterbench.generation.scenario import DescribedObject, Scenario
from betterbench.sim.assets.catalogue.terms import terms

MOST_SCENARIOS = 10_000
"""Maximum number of scenarios that one call may request."""
_COMPARED = 400
"""Number of candidate scenarios drawn from a theme. The candidate least similar to earlier scenarios is used."""

GoalKey = tuple[tuple[str, tuple[Kind, ...]], ...]
"""Key of the objects chosen for each group, ignoring the order of the objects.

Near-duplicate choices have equal keys.
"""


@dataclass(frozen=True, slots=True)
class Wanted:
    """Object that the user names in a sentence.

    Attributes:
        group_id: Object group of the template that the object belongs to.
        kinds: Kinds (category and color) of library objects that the noun may refer to.
        noun: Noun used by the user, with its color.
    """

    group_id: str
    kinds: tuple[Kind, ...]
    noun: str


def grammar_of(template: str) -> Grammar:
    """Return the grammar of a template.

    Raises:
        UnknownNameError: If the template has no grammar.
    """
    if template not in GRAMMARS:
        raise UnknownNameError("template", template, GRAMMARS)
    return GRAMMARS[template]


def goal_key(choice: Choice) -> GoalKey:
    """Return a key that identifies a choice of objects.

    Choices with the same categories and colors in each group have the same key.
    """
    return tuple((group, tuple(sorted(kinds))) for group, kinds in sorted(choice.items()))


@functools.cache
def distinct_goals(template: str) -> int:
    """Return the number of scenarios that the grammar of a template can generate.

    Near-duplicates are counted only once.
    """
    return len({goal_key(choice) for theme in grammar_of(template).themes for choice in theme.choices()})


def write_scenarios(
    template: str, count: int, *, seed: int = 0, wanted: Sequence[Wanted] = (), about: str = ""
) -> tuple[Scenario, ...]:
    """Return different scenarios of a template.

    The themes are used in turn, in an order drawn from the seed. Each theme contributes the scenario that is least
    similar to the earlier scenarios, so categories vary before colors do. The first scenarios do not depend on
    ``count``.

    Args:
        template: Name of the template.
        count: Number of scenarios.
        seed: Seed of all choices.
        wanted: Objects that each scenario must contain.
        about: Sentence of the user. Only the themes that share the most words with it are used.

    Raises:
        UnknownNameError: If the template does not exist.
        InvalidInputError: If the grammar has fewer scenarios than requested, or none with the wanted objects.
    """
    require_between("--num", count, 1, MOST_SCENARIOS)
    grammar = grammar_of(template)
    rng = np.random.default_rng([seed, *template.encode()])
    themes = _nearest(_themes_with(grammar, wanted), about)
    drawn = list(itertools.islice(_drawn(themes, wanted, rng), count))
    if not drawn:
        nouns = ", ".join(want.noun for want in wanted)
        problem = f"the offline author has no scenario of {template} with all these objects: {nouns}"
        cure = "Use fewer objects, use objects of other kinds or colors, or use a model with --model"
        twice = [want.noun for k, want in enumerate(wanted) if want in wanted[:k] and len(want.kinds) == 1]
        if twice:
            problem = f"has the {twice[0]} twice, but all objects must differ in kind or color"
            cure = "Use it once, or use another object or color"
        raise InvalidInputError("sentence", problem, cure)
    if len(drawn) < count:
        which = " with these objects" if wanted else ""
        problem = f"the offline author has {len(drawn)} different scenarios of {template}{which}, not {count}"
        raise InvalidInputError(
            "--num", problem, f"Use --num {max(1, len(drawn))} or less, or choose a model with --model"
        )
    return tuple(scenario_of(template, theme, choice, rng) for theme, choice in drawn)


def _drawn(
    themes: Sequence[Theme], wanted: Sequence[Wanted], rng: np.random.Generator
) -> Iterator[tuple[Theme, Choice]]:
    """Yield different choices of objects until none is left.

    The themes take turns, each contributing one choice at a time.
    """
    left = [_shuffled(list(_choices_with(theme, wanted)), rng) for theme in themes]
    turns = rng.permutation(len(themes)).tolist()
    keys: set[GoalKey] = set()
    uses: Counter[object] = Counter()
    # Cache by the identity of the choice, because most choices are compared many times.
    known: dict[int, tuple[tuple[object, int], ...]] = {}

    def repetition(choice: Choice) -> int:
        if id(choice) not in known:
            known[id(choice)] = tuple(_traits(choice))
        return sum(uses.get(trait, 0) * weight for trait, weight in known[id(choice)])

    while turns:
        for turn in list(turns):
            fresh = list(itertools.islice((c for c in left[turn] if goal_key(c) not in keys), _COMPARED))
            if not fresh:
                turns.remove(turn)
                continue
            choice = min(fresh, key=repetition)
            left[turn].remove(choice)
            keys.add(goal_key(choice))
            uses.update(trait for trait, _ in _traits(choice))
            yield themes[turn], choice


def _traits(choice: Choice) -> Iterator[tuple[object, int]]:
    """Yield the features of a choice of objects. Each has a weight, which is the penalty for repeating it.

    The weight is high for categories and low for colors.
    """
    for group, kinds in choice.items():
        yield (group, tuple(sorted(category for category, _ in kinds))), 100
        yield (group, tuple(sorted(kinds))), 20
        yield from (((group, kind), 1) for kind in kinds)


def _shuffled(items: list[Choice], rng: np.random.Generator) -> list[Choice]:
    return [items[i] for i in rng.permutation(len(items))]


def _choices_with(theme: Theme, wanted: Iterable[Wanted]) -> Iterator[Choice]:
    """Yield the choices that contain a separate object for each wanted object."""
    of_group: dict[str, list[Wanted]] = {}
    for want in sorted(wanted, key=lambda w: len(w.kinds)):
        of_group.setdefault(want.group_id, []).append(want)
    if not of_group.keys() <= theme.groups.keys():
        return iter(())
    return theme.choices(lambda group, kinds: group not in of_group or _has(kinds, of_group[group]))


def _has(kinds: tuple[Kind, ...], wanted: Iterable[Wanted]) -> bool:
    """Return whether each wanted object of a group can be matched with a different object in the group."""
    free = list(kinds)
    for want in wanted:
        found = next((kind for kind in free if kind in want.kinds), None)
        if found is None:
            return False
        free.remove(found)
    return True


def _themes_with(grammar: Grammar, wanted: Sequence[Wanted]) -> tuple[Theme, ...]:
    """Return the themes that contain all wanted objects. If there are none, return a new theme with these objects."""
    if not wanted:
        return grammar.themes
    fitting = tuple(
        theme
        for theme in grammar.themes
        if all(_may_have(theme, want) for want in wanted) and any(True for _ in _choices_with(theme, wanted))
    )
    return fitting or (_theme_for(grammar, wanted),)


def _theme_for(grammar: Grammar, wanted: Sequence[Wanted]) -> Theme:
    """Return a new theme with the wanted objects. If a group needs more objects, other objects are added.

    Raises:
        InvalidInputError: If a group has too many wanted objects.
    """
    model = grammar.themes[0]
    limits = {group.group_id: group.count_range for group in grammar.template.groups}
    groups: dict[str, Group] = {}
    for group_id, usual in model.groups.items():
        mine = [want for want in wanted if want.group_id == group_id]
        needed = sum(pool.count for pool in usual.pools)
        most = min(limits[group_id][1], grammar.most_items) if group_id in ("items", "layers") else needed
        if len(mine) > most:
            nouns = ", ".join(want.noun for want in mine)
            raise InvalidInputError(
                "sentence",
                f"has {len(mine)} objects for the group {group_id!r} ({nouns})",
                f"Use at most {most} objects",
            )
        if not mine:
            groups[group_id] = usual
            continue
        pools = [Pool(tuple(dict.fromkeys(c for c, _ in want.kinds)), only=want.kinds) for want in mine]
        named = {category for want in mine for category, _ in want.kinds}
        more = needed - len(mine)
        others = _others(_with_receiver(grammar, wanted), grammar.categories(group_id), group_id, named, more)
        groups[group_id] = Group(
            (*pools, *([Pool(others, more)] if more > 0 else [])), usual.colors_differ, usual.follows
        )
    return Theme(grammar.requested, "table", (grammar.general,), groups)


def _with_receiver(grammar: Grammar, wanted: Sequence[Wanted]) -> list[Theme]:
    """Return the themes that contain the container, fixture, base or anchor that the user named."""
    receivers = [want for want in wanted if want.group_id not in ("items", "layers")]
    return [theme for theme in grammar.themes if all(_may_have(theme, want) for want in receivers)]


def _may_have(theme: Theme, want: Wanted) -> bool:
    """Return whether a theme may contain a wanted object.

    Only the pools of the theme are checked, because enumerating the thousands of choices would take too long.
    """
    group = theme.groups.get(want.group_id)
    return group is not None and any(
        kind in want.kinds for pool in group.pools for category in pool.categories for kind in pool.kinds(category)
    )


def _others(
    themes: Sequence[Theme], every: Sequence[str], group_id: str, named: set[str], least: int
) -> tuple[str, ...]:
    """Return the categories that share a theme with at least one of the named categories.

    If there are too few of them, return all categories except the named ones.
    """
    found: dict[str, None] = {}
    for theme in themes:
        there = [category for pool in theme.groups[group_id].pools for category in pool.categories]
        if named & set(there):
            found |= dict.fromkeys(category for category in there if category not in named)
    return tuple(found) if len(found) >= least else tuple(c for c in every if c not in named)


def _nearest(themes: tuple[Theme, ...], about: str) -> tuple[Theme, ...]:
    """Return the themes that share the most words with a text. If none shares a word, return all themes."""
    words = set(terms(about))
    shared = [len(words & theme_words(theme)) for theme in themes]
    return tuple(theme for theme, count in zip(themes, shared, strict=True) if count == max(shared))


def theme_words(theme: Theme) -> frozenset[str]:
    """Return the words that characterize a theme: the content words of its name, its context and its instructions."""
    return frozenset(terms(" ".join((theme.name, theme.context, *theme.instructions)))) - _SAY_LITTLE


_SAY_LITTLE_WORDS = """
a an the in into on onto of for to with at and around under away arrange assemble build fill lay pack place put set
stack stock store throw up packing preparing setting laying stacking putting serving making taking building
assembling filling storing tidying container anchor fixture cabinet base rack plate drawer hole ring item items
table
"""
_SAY_LITTLE = frozenset(_SAY_LITTLE_WORDS.split())


def scenario_of(template: str, theme: Theme, choice: Choice, rng: np.random.Generator) -> Scenario:
    """Return a scenario with the chosen objects and a randomly chosen instruction of the theme."""
    wording = theme.instructions[int(rng.integers(len(theme.instructions)))]
    firsts = {group: _named(kinds) for group, kinds in choice.items() if kinds}
    groups = {group: _with_names([described(*kind) for kind in kinds]) for group, kinds in choice.items()}
    return Scenario(template, theme.name, wording.format(**firsts), theme.context, groups)


def _named(kinds: tuple[Kind, ...]) -> str:
    return short_name(*kinds[0])


def _with_names(objects: list[DescribedObject]) -> tuple[DescribedObject, ...]:
    """Make the instance names of objects unique by appending a number to repeated names."""
    seen: Counter[str] = Counter()
    found = []
    for described_object in objects:
        name = described_object.instance_name
        seen[name] += 1
        found.append(
            replace(described_object, instance_name=f"{name}_{seen[name]}") if seen[name] > 1 else described_object
        )
    return tuple(found)


def nouns_of_library(template: str) -> dict[str, tuple[str, ...]]:
    """Return the nouns of the objects in a template's grammar, by group.

    A model with a closed vocabulary may use only these nouns.
    """
    grammar = grammar_of(template)
    found: dict[str, tuple[str, ...]] = {}
    for group_id in grammar.themes[0].groups:
        kinds = {
            kind
            for theme in grammar.themes
            for pool in theme.groups[group_id].pools
            for category in pool.categories
            for kind in pool.kinds(category)
        }
        found[group_id] = tuple(sorted({phrase_of(*kind).query.format(color=kind[1]) for kind in kinds}))
    return found


def shown_colors(template: str) -> dict[str, dict[str, tuple[str, ...]]]:
    """Return the colors in a template's grammar, by group and category."""
    grammar = grammar_of(template)
    return {
        group_id: {
            category: tuple(
                dict.fromkeys(
                    color
                    for theme in grammar.themes
                    for pool in theme.groups[group_id].pools
                    if category in pool.categories
                    for _, color in pool.kinds(category)
                )
            )
            for category in grammar.categories(group_id)
        }
        for group_id in grammar.themes[0].groups
    }
