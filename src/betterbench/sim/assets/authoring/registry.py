"""Registry of asset generators.

Decorating one function registers a category. Everything else is derived from this function.
"""

import functools
import hashlib
import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.interface.state import Region
from betterbench.sim.assets.asset import Asset, CollisionPart, VisualPart
from betterbench.sim.assets.authoring.draft import Draft
from betterbench.sim.assets.authoring.mass import mass_properties
from betterbench.sim.assets.authoring.paint import unpainted
from betterbench.sim.assets.authoring.solids import surfaced
from betterbench.tasks.user_files import TaskFile, load_declared, loaded_files, registered

Generator = Callable[[np.random.Generator, str], Draft]


@dataclass(frozen=True, slots=True)
class _Entry:
    """Registered generator of a category, and the options of its registration."""

    make: Generator
    colors: tuple[str, ...]
    looks: int
    unseen_looks: int
    family: str
    keeps_upright: bool


_REGISTER: dict[str, _Entry] = {}
_FOLDER_READERS: list[Callable[[TaskFile], None]] = []
_folders_read: set[str] = set()


def read_folders_with(reader: Callable[[TaskFile], None]) -> None:
    """Set the function that registers the assets of a loaded folder, as listed in the folder's manifest."""
    _FOLDER_READERS.append(reader)


def _load_declared() -> None:
    """Load the plugins, task files and asset folders that the user has specified."""
    load_declared()
    for file in loaded_files():
        if file.is_asset_folder and file.path not in _folders_read:
            for reader in _FOLDER_READERS:
                reader(file)
            _folders_read.add(file.path)


def generator(
    category: str,
    *,
    colors: Sequence[str],
    looks: int = 8,
    unseen_looks: int = 4,
    family: str | None = None,
    keeps_upright: bool = False,
) -> Callable[[Generator], Generator]:
    """Register a function as the generator of a category. The function can be defined in any imported file.

    The function takes a random generator and a color word. All differences between variants of an object come from the
    random generator. The function must draw the same random numbers for every color, so that the color never changes
    the shape.

    Args:
        category: Name of the category.
        colors: Color words. The first one is the default.
        looks: Number of variants for training and test. They are numbered from 0.
        unseen_looks: Number of held-out variants. Their numbers start at ``looks``.
        family: Categories of the same family draw the same random numbers for a variant, so that related objects match
            (for example a cabinet and its drawers, or the plates of a set). If None, the category is its own family.
        keeps_upright: Whether objects of this category, such as drinks, must not lie on their side to count as inside a
            container.

    Raises:
        InvalidInputError: If there is no color, no variant or no held-out variant, or if a different function has
            already registered the category.
    """
    if not category or not colors or looks < 1 or unseen_looks < 1:
        problem = "a category needs a name, and at least one color, one look and one unseen look"
        raise InvalidInputError(
            f"asset category {category!r}", problem, 'Write, for example, @generator("kite", colors=("red",))'
        )

    def register(make: Generator) -> Generator:
        named = registered("asset", category, make, _REGISTER)
        known = _REGISTER.get(category)
        # a file that is loaded again may register the same function again
        if known is not None and _origin(known.make) != _origin(make):
            both = f"it is registered by both {_origin(make)} and {_origin(known.make)}"
            raise InvalidInputError(f"asset category {category!r}", both, "Rename one of them")
        _REGISTER[category] = _Entry(named, tuple(colors), looks, unseen_looks, family or category, keeps_upright)
        return make

    return register


def unregister(category: str) -> None:
    """Remove a category. This is meant for tests.

    Raises:
        UnknownNameError: If the category does not exist.
    """
    _entry(category)
    del _REGISTER[category]


def _origin(make: Generator) -> str:
    """Return the name of a generator and of the file that defines it, for use in messages."""
    code = getattr(inspect.unwrap(make), "__code__", None)
    return f"{getattr(make, '__qualname__', make)} in {getattr(code, 'co_filename', 'an unknown file')}"


def generator_of(category: str) -> Generator:
    """Return the generator of a category, so that a user's generator can modify its result.

    Raises:
        UnknownNameError: If the category does not exist.
    """
    return _entry(category).make


def categories() -> tuple[str, ...]:
    """Return the names of all categories, sorted."""
    _load_declared()
    return tuple(sorted(_REGISTER))


def _entry(category: str) -> _Entry:
    _load_declared()
    if category not in _REGISTER:
        raise UnknownNameError("asset category", category, _REGISTER)
    return _REGISTER[category]


def colors(category: str) -> tuple[str, ...]:
    """Return the possible colors of a category. The first one is the default.

    Raises:
        UnknownNameError: If there is no such category.
    """
    return _entry(category).colors


def looks(category: str) -> range:
    """Return the numbers of a category's variants that are used both for training and for test.

    The held-out variants are returned by :func:`unseen_looks`.

    Raises:
        UnknownNameError: If there is no such category.
    """
    return range(_entry(category).looks)


def unseen_looks(category: str) -> range:
    """Return the numbers of a category's held-out variants, which do not occur in demonstrations.

    Raises:
        UnknownNameError: If there is no such category.
    """
    entry = _entry(category)
    return range(entry.looks, entry.looks + entry.unseen_looks)


def family_of(category: str) -> str:
    """Return the family of a category. A category without a family is its own family.

    Raises:
        UnknownNameError: If there is no such category.
    """
    return _entry(category).family


def build(category: str, *, look: int = 0, color: str | None = None) -> Asset:
    """Make an asset. The same arguments give a bit-identical asset in every process. The color never changes the shape.

    Args:
        category: Name of the category.
        look: Number of the variant, from :func:`looks` or :func:`unseen_looks`.
        color: Color word. If None, the first color of the category is used (see :func:`colors`).

    Raises:
        UnknownNameError: If the category or the color is not known.
        InvalidInputError: If there is no variant with this number.
    """
    entry, color = _checked(category, look, color)
    return _with_moved_regions(_build(category, entry, look, color))


def build_unpainted(category: str, *, look: int = 0, color: str | None = None) -> Asset:
    """Make an asset without textures, for measurements. This takes about a third of the time of :func:`build`.

    Shape, mass, grasps and regions are the same as with :func:`build`. The asset must not be used in a scene, because
    it would be drawn without its textures.

    Raises:
        UnknownNameError: If the category or the color is not known.
        InvalidInputError: If there is no variant with this number.
    """
    entry, color = _checked(category, look, color)
    return _with_moved_regions(_build_unpainted(category, entry, look, color))


def _checked(category: str, look: int, color: str | None) -> tuple[_Entry, str]:
    """Check that a category has the given color and variant.

    Return the entry of the category, and the color, which is by default the first color of the category.
    """
    entry = _entry(category)
    chosen = entry.colors[0] if color is None else color
    if chosen not in entry.colors:
        raise UnknownNameError(f"color of {category}", chosen, entry.colors)
    total = entry.looks + entry.unseen_looks
    if look not in range(total):
        cure = f"Use a number from 0 to {total - 1}"
        raise InvalidInputError(f"look of {category}", f"{look!r} does not exist", cure)
    return entry, chosen


_moved_regions: dict[str, Mapping[str, Region]] = {}


@contextmanager
def moved_regions(moved: Mapping[str, Mapping[str, Region]]) -> Iterator[None]:
    """Context manager that replaces regions of all assets that are built while it is active.

    The new regions are keyed by category and region name.
    """
    before = dict(_moved_regions)
    _moved_regions.update(moved)
    try:
        yield
    finally:
        _moved_regions.clear()
        _moved_regions.update(before)


def _with_moved_regions(asset: Asset) -> Asset:
    moved = _moved_regions.get(asset.category)
    if not moved:
        return asset
    return replace(asset, regions=tuple(moved.get(region.name, region) for region in asset.regions))


@functools.lru_cache(maxsize=512)
def _build(category: str, entry: _Entry, look: int, color: str) -> Asset:
    """Make an asset with the generator of an entry. The caller has already checked the arguments.

    Assets stay in the cache when other categories are registered. A generator that is registered again has another
    entry.
    """
    seed = int.from_bytes(hashlib.sha256(f"betterbench asset {entry.family} {look}".encode()).digest()[:8], "big")
    draft = entry.make(np.random.default_rng(seed), color)
    return asset_of(draft, category, look=look, color=color, keeps_upright=entry.keeps_upright)


@functools.lru_cache(maxsize=4096)
def _build_unpainted(category: str, entry: _Entry, look: int, color: str) -> Asset:
    """Make an asset without textures. The caller has already checked the arguments."""
    with unpainted():
        asset = _build.__wrapped__(category, entry, look, color)
    return replace(asset, visual=tuple(replace(part, texture=None) for part in asset.visual))


def asset_of(draft: Draft, category: str, *, look: int = 0, color: str, keeps_upright: bool = False) -> Asset:
    """Make an asset from the draft that a generator has returned.

    Raises:
        InvalidInputError: If the draft has no visual part or no collision part.
    """
    visual = tuple(p for p in draft.parts if isinstance(p, VisualPart))
    collision = tuple(p for p in draft.parts if isinstance(p, CollisionPart))
    if draft.material is not None:
        collision = surfaced(collision, draft.material, only_plain=True)
    if not visual or not collision:
        raise InvalidInputError(
            f"asset {category!r}", "it has no visual part or no collision part", "Add the missing part"
        )
    points = np.concatenate([part.vertices for part in visual]).astype(float)
    x, y, z = (round(float(e), 6) for e in np.ptp(points, axis=0))
    body = draft.body or mass_properties(collision, draft.mass_kg, densities=draft.densities)
    return Asset(
        category=category,
        look=look,
        color=color,
        shape=draft.shape,
        description=draft.description,
        tags=(*draft.tags, color),
        traits=draft.traits,
        size_m=(x, y, z),
        mass_kg=body.mass_kg,
        center_of_mass=body.center_of_mass,
        inertia=body.inertia,
        visual=visual,
        collision=collision,
        grasps=draft.grasps,
        regions=draft.regions,
        source=draft.source,
        license=draft.license,
        parameters=draft.parameters,
        keeps_upright=keeps_upright,
    )
