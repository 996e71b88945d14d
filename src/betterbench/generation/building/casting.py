"""Casting: the choice of assets for the descriptions of a scenario, and of distractors that look like its items.

Assets are found by searching the catalogue. An asset must meet the requirements of its group: a container needs the
region that the template's relation requires, and an item needs a grasp that fits the gripper.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

from betterbench.errors import InvalidInputError
from betterbench.generation.building.choice import Choice, asset_of
from betterbench.generation.building.look_alikes import look_alikes_in
from betterbench.generation.building.names import SYNONYMS, kinds_of
from betterbench.generation.cast import Cast
from betterbench.generation.measures import WIDEST_GRASP_M
from betterbench.generation.scenario import DescribedObject, Scenario
from betterbench.sim.assets import Asset, build_unpainted, categories, colors
from betterbench.sim.assets.catalogue.entry import CatalogueEntry
from betterbench.sim.assets.catalogue.expansion import COLORS, understood
from betterbench.sim.assets.catalogue.search import Catalogue, Filters, Hit
from betterbench.sim.assets.catalogue.sources.procedural import NAME
from betterbench.sim.assets.catalogue.terms import terms
from betterbench.tasks import authoring as a
from betterbench.tasks.authoring.template import ObjectGroup, Template
from betterbench.tasks.authoring.templates import TEMPLATES
from betterbench.tasks.condition import ObjectSpec, Role
from betterbench.tasks.relations import RELATIONS
from betterbench.tasks.words import is_plural

LEAST_SCORE = 0.2
"""Minimum search score accepted for a description."""
_SEARCHED = 40
_BUILDABLE = Filters(license="any", source=NAME)
_ALMOST = 0.8
"""Minimum score of an asset, relative to the best suitable asset, at which the asset is considered almost as good."""
_FIXED = ("on_ring", "in_hole", "closed")
"""Relations whose target is fixed to the table, because objects are pushed into the target."""
_ADJECTIVES = """
big bright ceramic clean compact cylindrical dark deep empty flat folded fresh full glass glossy heavy juicy large
leather light little long matte metal metallic modern narrow new old open ordinary paper plain plastic porcelain ripe
rectangular round rubber shallow shiny short simple single slim small smooth soft solid square stainless standard steel
striped sturdy tall thick thin tiny typical unopened whole wide wooden
"""
ADJECTIVES = frozenset(_ADJECTIVES.split())
"""Words of a query that describe an object without naming it."""

_COUNTS = frozenset({"both", "couple", "dozen", "five", "four", "pair", "several", "six", "three", "two"})
"""Query words that denote several objects."""


def unsuitable(asset: Asset, group: ObjectGroup, template: Template) -> str:
    """Return the reason why an asset does not suit an object group of a template, or an empty string if it does."""
    regions = {region.name for region in asset.regions}
    relation = RELATIONS[template.relation]
    needed = relation.needs
    if group.role == "drawer":
        return "" if {"inside", "knob"} <= regions else "it is not a drawer"
    if group.role == "fixture" and "closed" in template.also:
        return "" if set(RELATIONS["closed"].needs) <= regions else "it has no drawers"
    if group.role in ("container", "fixture"):
        if "knob" in regions:
            return "it is a drawer"
        # An anchor needs at least one of the regions (sides). Other groups need all of them ("ring" and "spout").
        there = any(name in regions for name in needed) if len(needed) > 2 else set(needed) <= regions
        return "" if there else f"it has no region {' or '.join(map(repr, needed[:3]))}"
    if not asset.grasps:
        return "it has no grasp"
    narrowest = min(grasp.width_m for grasp in asset.grasps)
    if narrowest > WIDEST_GRASP_M:
        return f"it is {1000.0 * narrowest:.0f} mm wide, but the gripper grasps up to {1000.0 * WIDEST_GRASP_M:.0f} mm"
    if template.relation == "on_plate" and group.role == "item" and not set(needed) <= regions:
        return "nothing can be stacked on it"
    return ""


def choices(scenario: Scenario, catalogue: Catalogue, *, attempt: int = 0) -> list[Choice]:
    """Choose an asset for each description of a scenario, in the order of the template's groups.

    Args:
        scenario: Scenario with the descriptions.
        catalogue: Catalogue of generators and imported assets.
        attempt: Index of the attempt. Among assets that match almost equally well, each attempt uses a different one.

    Raises:
        InvalidInputError: If a description has no suitable asset; the message names the best search results.
    """
    template = TEMPLATES[scenario.template]
    found: list[Choice] = []
    for group in template.groups:
        for i, described in enumerate(scenario.groups.get(group.group_id, ())):
            taken = {(choice.entry.category, choice.entry.color) for choice in found}
            suiting, passed = fitting(described, group, template, catalogue, taken)
            if not suiting:
                shown = "; ".join(passed[:3]) or "the search finds nothing"
                raise InvalidInputError(
                    f"instantiation.{group.group_id}[{i}]",
                    f"no asset suits {described.asset_query!r} ({shown})",
                    "Describe another object, or import one with --asset-dir",
                )
            hit = suiting[attempt % len(suiting)]
            found.append(Choice(group.group_id, described, hit.entry, round(hit.score, 4), tuple(passed[:3])))
    return found


def fitting(
    described: DescribedObject,
    group: ObjectGroup,
    template: Template,
    catalogue: Catalogue,
    taken: set[tuple[str, str]],
) -> tuple[list[Hit], list[str]]:
    """Return the search results for a description that are suitable for its group, starting with the best match.

    Also return the better results that were rejected, with the reasons.
    """
    wanted = _colors_in(described)
    query = f"{described.asset_query} {' '.join(wanted)}".strip()
    found = catalogue.search(query, limit=_SEARCHED, filters=_BUILDABLE)
    hits = [hit for hit in found if hit.score >= LEAST_SCORE]
    colored = [hit for hit in hits if hit.entry.color in wanted]
    passed: list[str] = []
    suiting: list[Hit] = []
    for hit in colored or hits:
        known = (hit.entry.category, hit.entry.color) in taken
        problem = "it is already in the scene" if known else unsuitable(asset_of(hit.entry), group, template)
        problem = name_problem(described.asset_query, hit.entry) or problem or _size_problem(described, hit.entry)
        if problem:
            passed.append(f"{hit.entry.id}: {problem}")
        elif not suiting or hit.score >= _ALMOST * suiting[0].score:
            suiting.append(hit)
    return suiting, passed


def name_problem(query: str, entry: CatalogueEntry) -> str:
    """Return a message if a noun of a query matches neither the names nor the text of an asset.

    Otherwise, return an empty string.
    """
    words = query.lower().split()
    if _COUNTS & set(words) or (words and is_plural(words[-1]) and not _is_word_of(words[-1], entry)):
        return "it is one object, but the query asks for several"
    known = set(terms(f"{entry.name} {' '.join(entry.tags)} {entry.description} {entry.color}"))
    uncolored = tuple(word for word in terms(query) if word not in COLORS) or tuple(terms(query))
    named = (*(word for word in uncolored[:-1] if word not in ADJECTIVES), *uncolored[-1:])
    if len(named) == 1 and uncolored not in _phrases(entry.tags) and not _is_named(named, entry):
        return f"it is not called {named[0]!r}"
    for concept in understood(query).concepts:
        phrases = [phrase for phrase, _ in concept.alternatives]
        said = set(phrases[0]) - ADJECTIVES
        if said and not any(set(phrase) <= known for phrase in (tuple(said), *phrases)):
            return f"it is not called {' '.join(phrases[0])!r}"
    return ""


@functools.cache
def _traits() -> frozenset[tuple[str, ...]]:
    """Return the tags in the library that name a material, a place or a use, such as "glass" for a jar.

    Each tag is a tuple of normalized words.
    """
    return frozenset(tuple(terms(tag)) for category in categories() for tag in build_unpainted(category).traits)


def _is_word_of(word: str, entry: CatalogueEntry) -> bool:
    return word in f"{entry.name} {' '.join(entry.tags)}".lower().split()


def _phrases(tags: Sequence[str]) -> set[tuple[str, ...]]:
    """Return the tags of an asset that name the object itself, each as a tuple of normalized words.

    Tags that only name a material, a place or a use are left out.
    """
    return {tuple(terms(tag)) for tag in tags[:SYNONYMS]} | ({tuple(terms(tag)) for tag in tags} - _traits())


def _is_named(word: tuple[str, ...], entry: CatalogueEntry) -> bool:
    """Return whether a word or one of its synonyms names an asset.

    The word must be the last word of the asset's name, or a tag that names the object rather than its material, place
    or use.
    """
    names = _phrases(entry.tags) | {tuple(terms(entry.name)[-1:])}
    if word in names or word in _traits():
        return word in names
    synonyms = {phrase for concept in understood(word[0]).concepts for phrase, _ in concept.alternatives}
    return bool((synonyms - {word}) & (names | {tuple(terms(entry.name))}))


def _colors_in(described: DescribedObject) -> tuple[str, ...]:
    """Return the distinct color words in a description, starting with the color words in its search query."""
    said = [*terms(described.asset_query), *terms(described.description)]
    return tuple(dict.fromkeys(word for word in said if word in COLORS))


def _size_problem(described: DescribedObject, entry: CatalogueEntry) -> str:
    """Return a message if an asset is less than half or more than twice as large as the description estimates.

    Otherwise, return an empty string.
    """
    size, (low, high) = entry.largest_m, described.size_m
    if size is None or 0.5 * low <= size <= 2.0 * high:
        return ""
    return f"it is {100.0 * size:.0f} cm long, but {100.0 * low:.0f} to {100.0 * high:.0f} cm were estimated"


def cast_of(scenario: Scenario, catalogue: Catalogue, *, seed: int = 0, attempt: int = 0) -> tuple[Cast, list[Choice]]:
    """Choose an asset for each description of a scenario. Return the scenario with its assets, and the list of choices.

    Args:
        scenario: Scenario with the descriptions.
        catalogue: Catalogue of generators and imported assets.
        seed: Seed of the choices that are made when a task is derived from the scenario.
        attempt: Index of the attempt, as in :func:`choices`.

    Raises:
        InvalidInputError: If a description has no suitable asset.
    """
    chosen = choices(scenario, catalogue, attempt=attempt)
    template = TEMPLATES[scenario.template]
    kinds = kinds_of(chosen)
    roles = {group.group_id: group.role for group in template.groups}
    groups: dict[str, list[ObjectSpec]] = {group.group_id: [] for group in template.groups}
    cabinet: ObjectSpec | None = None
    for choice, kind in zip(chosen, kinds, strict=True):
        spec = _spec(choice, kind, roles[choice.group], template, cabinet)
        if spec.role == "fixture":
            cabinet = spec
        groups[choice.group].append(spec)
    cast = Cast(scenario, {name: tuple(specs) for name, specs in groups.items()}, seed=seed)
    rows = {choice.described.instance_name: choice.entry for choice in chosen}
    return dataclasses.replace(cast, look_alikes=dict(look_alikes_in(cast, rows, catalogue))), chosen


def _spec(choice: Choice, kind: str, role: Role, template: Template, cabinet: ObjectSpec | None) -> ObjectSpec:
    entry, name = choice.entry, choice.described.instance_name
    color = entry.color if len(colors(entry.category)) > 1 else None
    if role == "drawer":
        if cabinet is None:
            raise InvalidInputError("instantiation", f"{name!r} has no cabinet", "Describe a cabinet with drawers")
        made = a.drawer(entry.category.partition("_")[0], entry.category, cabinet)
        return dataclasses.replace(made, color=cabinet.color)
    fixed = role == "fixture" and any(name in _FIXED for name in (template.relation, *template.also))
    return ObjectSpec(name, kind, entry.category, color, role, fixed)
