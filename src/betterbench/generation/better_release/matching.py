"""Search for library assets that represent the objects of a BeTTER release task."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from betterbench.errors import InvalidInputError, MissingDependencyError, UnknownNameError
from betterbench.generation.better_release.files import ReleaseInstance, ReleaseTask
from betterbench.generation.better_release.sentence import classes_of, color_of, nouns_of
from betterbench.sim.assets import Asset, build_unpainted, categories, colors, looks
from betterbench.sim.assets.catalogue.encoders import TextEncoder, open_encoder
from betterbench.sim.assets.catalogue.indexing import index_sources
from betterbench.sim.assets.catalogue.search import Catalogue, Filters, Hit
from betterbench.sim.assets.catalogue.sources import open_source
from betterbench.sim.assets.catalogue.sources.source import SourceOptions
from betterbench.sim.assets.catalogue.terms import terms

SOURCE = "procedural"
_HITS = 40
_LARGEST_ITEM_M = 0.17
"""Maximum extent of a carried object [m]. It is the size of the library's plates, which are grasped at the rim."""
_BY_CLASS = 0.25
"""Score factor for an asset that only belongs to the same class as the object ("fruit")."""
_OTHER_NOUN, _OTHER_COLOR, _SAME_CATEGORY, _SAME_ASSET = 0.6, 0.7, 0.7, 0.1
"""Score factors for less suitable assets, which only affect the choice and not the reported score."""
_LEAST_SCORE = 0.02
"""Minimum weighted score of a match."""


@dataclass(frozen=True)
class Match:
    """Asset that represents an object of the release.

    Attributes:
        category: Asset category of betterbench.
        color: Color, or None to use the default colors.
        score: Search score in [0, 1]; 1 for a category that the user has named.
        how: Origin of the match. "name": the noun of the object is the category. "search": the category was found by
            words or meaning. "class": the category only belongs to the same class as the object. "given": the user
            named the category.
        asset: First variant of the category. Sizes and regions are read from this asset.
        is_stand_in: Whether the noun of the object differs from the category, so that the asset may look like another
            object.
    """

    category: str
    color: str | None
    score: float
    how: str
    asset: Asset
    is_stand_in: bool


@contextmanager
def library_catalogue(folder: Path | None = None) -> Iterator[Catalogue]:
    """Open a catalogue of the library's assets. Without the text encoder, it can be searched only by words.

    Args:
        folder: Folder of an existing catalogue. If it is None, the built-in generators are indexed into a temporary
            catalogue.
    """
    try:
        encoder: TextEncoder | None = open_encoder()
    except MissingDependencyError:
        encoder = None

    def opened(_: str) -> TextEncoder:
        if encoder is None:
            raise AssertionError("a catalogue without a text encoder contains no vectors to compare")
        return encoder

    with ExitStack() as stack:
        if folder is None:
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="betterbench-")))
            source = open_source(SOURCE, SourceOptions())
            index_sources(folder, [source], encoder=encoder, on_progress=lambda _stage, _done, _total: None)
        yield stack.enter_context(Catalogue(folder, encoder=None if encoder is None else opened))


def match_instances(
    task: ReleaseTask, catalogue: Catalogue, *, given: Mapping[str, str] | None = None
) -> dict[str, Match]:
    """Return the library asset that represents each object. Objects without a similar asset are left out.

    Containers are represented by categories that objects can be put into or onto. All other objects are represented by
    categories that can be grasped. A category is used twice only if no unused category fits.

    Args:
        task: The release task.
        catalogue: Catalogue that contains the procedural library.
        given: Categories that the user named, by object.

    Raises:
        UnknownNameError: If a given object or category does not exist.
        InvalidInputError: If the catalogue lacks the procedural library.
    """
    wanted = dict(given or {})
    for name, category in wanted.items():
        if name not in task.instances:
            raise UnknownNameError("object of the task", name, task.instances)
        if category not in categories():
            raise UnknownNameError("asset category", category, categories())
    if SOURCE not in catalogue.sources:
        cure = "Run `better assets index procedural`, or leave out --catalogue"
        raise InvalidInputError("--catalogue", "the catalogue does not contain the procedural library", cure)
    matches: dict[str, Match] = {}
    targets = _targets(task)
    # exact names first, so that a substitute does not take the category of another object
    for only_exact in (True, False):
        for name, instance in task.instances.items():
            if name in matches:
                continue
            match = (
                _given(wanted[name], instance, task.names.get(name, ""))
                if name in wanted
                else _found(catalogue, task, instance, matches.values(), is_target=name in targets)
            )
            if match is not None and (not only_exact or not match.is_stand_in):
                matches[name] = match
    return {name: matches[name] for name in task.instances if name in matches}


def _targets(task: ReleaseTask) -> frozenset[str]:
    """Return the objects that may be targets: members of the container group, and containers named by variations."""
    named = (v.container_instance_id for v in (task.base, *task.variations.values()))
    return frozenset((*task.groups["container"], *filter(None, named)))


def _given(category: str, instance: ReleaseInstance, name: str) -> Match:
    color = color_of(instance)
    is_named = _noun_of(category) in nouns_of(instance, name)
    return _match(category, color if color in colors(category) else None, 1.0, "given", is_stand_in=not is_named)


def _noun_of(category: str) -> tuple[str, ...]:
    return tuple(terms(category.replace("_", " ")))


def _match(category: str, color: str | None, score: float, how: str, *, is_stand_in: bool) -> Match:
    asset = build_unpainted(category, look=looks(category)[0], color=color or colors(category)[0])
    return Match(category, color, round(score, 4), how, asset, is_stand_in)


def _found(
    catalogue: Catalogue, task: ReleaseTask, instance: ReleaseInstance, taken: Iterable[Match], *, is_target: bool
) -> Match | None:
    """Return the best match for an object.

    The catalogue is searched for the object's query, its noun, and the classes of its noun.
    """
    nouns = nouns_of(instance, task.names.get(instance.instance_id, ""))
    color, used = color_of(instance), {(m.category, m.color) for m in taken}
    queries = [(instance.retrieval_query, 1.0), (" ".join(nouns[0]), 1.0)]
    queries += [(f"{color or ''} {' '.join(one)}", _BY_CLASS) for noun in nouns for one in classes_of(noun)]
    for query, factor in queries:
        if not query.strip():
            continue
        best, value = None, _LEAST_SCORE
        for hit in catalogue.search(query, limit=_HITS, filters=Filters(source=SOURCE)):
            if hit.entry.category in categories() and _fits(hit, is_target=is_target):
                found = factor * hit.score * _suitability(hit, used, nouns, color)
                best, value = (hit, found) if found > value else (best, value)
        if best is not None:
            category = best.entry.category
            exact = _noun_of(category) in nouns
            again = any(category == other for other, _ in used)
            shown = best.entry.color if again or best.entry.color == color else None
            how = "name" if exact else "search" if factor == 1.0 else "class"
            return _match(category, shown, factor * best.score, how, is_stand_in=not exact)
    return None


def _suitability(
    hit: Hit, used: set[tuple[str, str | None]], nouns: Sequence[tuple[str, ...]], color: str | None
) -> float:
    """Return a factor in (0, 1] for the search score of an asset.

    The factor is below 1 if the asset's noun or color differs from the object's, or if its category is already in use.
    """
    exact = _noun_of(hit.entry.category) in nouns
    category, own = hit.entry.category, hit.entry.color
    taken = (category, own) in used or ((category, None) in used and own == colors(category)[0])
    factor = 1.0 if exact else _OTHER_NOUN
    if color is not None and own != color:
        factor *= _OTHER_COLOR
    if taken:
        factor *= _SAME_ASSET
    elif any(category == other for other, _ in used):
        factor *= _SAME_CATEGORY
    return factor


def _fits(hit: Hit, *, is_target: bool) -> bool:
    """Return whether an asset is suitable as a target, or as an object that is carried."""
    category = hit.entry.category
    asset = build_unpainted(category, look=looks(category)[0], color=hit.entry.color or colors(category)[0])
    regions = {region.name for region in asset.regions}
    if is_target:
        return bool(regions & {"inside", "ring", "floor", "top", "left"})
    return bool(asset.grasps) and "inside" not in regions and max(asset.size_m) <= _LARGEST_ITEM_M
