"""Families of learners, with their inputs, sizes and the parts of the network that can be frozen.

A user's file can add a family. This module does not import torch. :mod:`networks` creates the network of a family.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import Field

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.json_form import strict_form
from betterbench.tasks.user_files import load_declared, registered

Sees = Literal["objects", "pixels"]
"""Input of a learner: the objects, as a perfect detector would report them, or images."""
Option = bool | int | float | str
MakerT = TypeVar("MakerT", bound=Callable[..., Any])

_SEES = get_args(Sees)
_SIZES = ("small", "base", "large")
_HEAD = "head"


@strict_form
@dataclass(frozen=True, slots=True)
class Capacity:
    """Size of a transformer: width of the tokens, number of layers, and number of attention heads per layer."""

    width: Annotated[int, Field(ge=8, le=1024)]
    layers: Annotated[int, Field(ge=1, le=24)]
    heads: Annotated[int, Field(ge=1, le=32)]

    def __post_init__(self) -> None:
        """Reject a width that is not divisible by the number of heads."""
        if self.width % self.heads:
            raise InvalidInputError(
                "width",
                f"{self.width} is not divisible by {self.heads} heads",
                "Use a multiple of the number of heads",
            )


@dataclass(frozen=True, slots=True)
class Family:
    """Family of learners that have the same kind of input and the same network architecture.

    Attributes:
        name: Name of the family in recipes.
        sees: Input of the learners.
        capacities: Size of the transformer for each of the names ``small``, ``base`` and ``large``.
        parts: Parts of the network that recipes may freeze.
        options: Options that only this family has and that recipes may set, with their defaults.
        make: Function that creates the network from a recipe and a vocabulary, or None for a built-in family.
    """

    name: str
    sees: Sees
    capacities: Mapping[str, Capacity]
    parts: tuple[str, ...]
    options: Mapping[str, Option] = field(default_factory=dict)
    make: Callable[..., Any] | None = None


_FAMILIES = {
    "objects": Family(
        "objects",
        "objects",
        # These sizes have 0.2, 0.9 and 2.8 million parameters.
        {"small": Capacity(64, 3, 4), "base": Capacity(128, 4, 4), "large": Capacity(192, 6, 6)},
        ("words", "objects", "state", "trunk", _HEAD),
    ),
    "pixels": Family(
        "pixels",
        "pixels",
        # These sizes have 0.2, 0.6 and 1.5 million parameters, since the convolutions grow with the width.
        {"small": Capacity(64, 2, 4), "base": Capacity(96, 3, 4), "large": Capacity(144, 4, 4)},
        ("words", "eyes", "state", "trunk", _HEAD),
    ),
}


def learner(
    name: str,
    *,
    sees: Sees,
    capacities: Mapping[str, Capacity] | None = None,
    parts: tuple[str, ...] = (),
    options: Mapping[str, Option] | None = None,
) -> Callable[[MakerT], MakerT]:
    """Register a network class as a family of learners. The decorator may be used in any file that is imported.

    The decorated class must be a subclass of :class:`~betterbench.policies.learned.network.LearnerNetwork`.

    Args:
        name: Name of the family, for the field ``family`` of recipes.
        sees: Input of the learner: ``objects``, or ``pixels`` for the images that the recipe selects with ``eyes``.
        capacities: Size of the transformer for each of the names ``small``, ``base`` and ``large``. By default, the
            sizes of the built-in family with the same input.
        parts: Names of modules of the network that recipes may freeze. The head can always be frozen.
        options: Options that recipes may set in the field ``options``, with their default values. The type of an option
            is that of its default value.

    Raises:
        InvalidInputError: If the name is already used, or an argument is missing or invalid.
    """

    def register(make: MakerT) -> MakerT:
        where = f"learner {name!r}"
        sizes = _FAMILIES[sees].capacities if capacities is None and sees in _SEES else capacities
        wrong = next(_wrong(name, sees, sizes, parts, {} if options is None else options), None)
        if wrong is not None:
            raise InvalidInputError(where, *wrong)
        made = registered("family", name, make, _FAMILIES)
        if name in _FAMILIES and made is not make:
            raise InvalidInputError(where, "the name is defined twice", "Rename one of the two families")
        if name in _FAMILIES and _FAMILIES[name].make is None:
            raise InvalidInputError(where, "this is the name of a built-in family", "Choose another name")
        _FAMILIES[name] = Family(name, sees, dict(sizes or {}), (*parts, _HEAD), dict(options or {}), made)
        return make

    return register


def _wrong(name: object, sees: object, capacities: object, parts: object, options: object) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with the arguments with which a user file registers a family, each with a remedy."""
    if not isinstance(name, str) or not name or sees not in _SEES:
        yield (
            f"expected a name and sees='objects' or 'pixels', got {name!r} and {sees!r}",
            'Write @learner("mine", sees="objects") or sees="pixels"',
        )
    if not isinstance(capacities, Mapping) or set(capacities) != set(_SIZES):
        yield f"its capacities have the names {_listed(capacities)}", f"Use the names {', '.join(_SIZES)}"
    elif not all(isinstance(size, Capacity) for size in capacities.values()):
        yield f"its capacities are {_listed(capacities.values())}", "Use a Capacity object for each size"
    if not isinstance(parts, tuple | list) or not all(isinstance(part, str) and part for part in parts):
        yield f"its parts are {parts!r}", 'List the names of modules: parts=("trunk",)'
    if not isinstance(options, Mapping) or not all(isinstance(option, str) for option in options):
        yield f"its options are {options!r}", 'Map names to default values: options={"depth": 2}'
        return
    for option, default in options.items():
        if not isinstance(default, bool | int | float | str) or (isinstance(default, float) and not isfinite(default)):
            yield f"the default of its option {option!r} is {default!r}", "Use a finite number, a string or a boolean"


def _listed(given: object) -> str:
    return repr(list(given) if isinstance(given, Iterable) else given)


def learner_family(name: str) -> Family:
    """Return the family with the given name.

    Raises UnknownNameError if neither betterbench nor a user's file defines it.
    """
    load_declared()
    if name not in _FAMILIES:
        raise UnknownNameError("family", name, _FAMILIES)
    return _FAMILIES[name]
