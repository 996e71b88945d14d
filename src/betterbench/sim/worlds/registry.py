"""Registry of the built-in worlds and of worlds defined in user files.

A built-in world is a folder next to this file that has the same name as the world. Its ``__init__`` registers the world
and is imported when the name is first used. A user file registers its worlds when it is loaded.
"""

from __future__ import annotations

import copyreg
import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar, get_args

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.interface import observation_spec
from betterbench.interface.actions import action_space
from betterbench.sim.worlds.world import World
from betterbench.tasks.user_files import TaskFile, code_of, load_declared, load_sources, loaded_files, registered
from betterbench.tasks.worlds.facts import (
    OURS,
    Reading,
    Suite,
    WorldFacts,
    facts_of_suite,
    forget_facts,
    register_facts,
)

AnyWorld = TypeVar("AnyWorld", bound=World)

_PACKAGE = "betterbench.sim.worlds"
_WORLDS: dict[str, World] = {}


def register_world(world: AnyWorld) -> AnyWorld:
    """Register a world and the facts that describe it, and return the world.

    Raises:
        InvalidInputError: If the name of the world or of one of its suites is already used, or if the facts are wrong.
        UnknownNameError: If the facts contain an unknown ``reading``, or the world an unknown observation preset or
            action space.
    """
    given: object = world
    if isinstance(given, type):
        name = given.__name__
        raise InvalidInputError(f"world {name}", "this is a class", f"Register an instance: register_world({name}())")
    _require_facts(world)
    registered("world", world.name, type(world), {**_WORLDS, **dict.fromkeys(_built_in())})
    if world.name in _WORLDS:
        raise InvalidInputError(f"world {world.name!r}", "this name is already registered", "Register each world once")
    register_facts(world.facts)
    copyreg.pickle(type(world), _by_name)  # type: ignore[arg-type]
    _WORLDS[world.name] = world
    return world


def _require_facts(world: World) -> None:
    """Check the facts that the author of a world has written."""
    facts: object = getattr(world, "facts", None)
    where = f"facts of {type(world).__name__}"
    if not isinstance(facts, WorldFacts):
        raise InvalidInputError(where, f"they are a {type(facts).__name__}", "Set facts to an instance of WorldFacts")
    if facts.reading not in get_args(Reading):
        raise UnknownNameError("reading", str(facts.reading), get_args(Reading))
    for preset in world.observations.values():
        observation_spec(preset)
    for space in world.action_spaces:
        action_space(space)
    for key, suite in facts.suites.items():
        place = f"{where}, suite {key!r}"
        if not isinstance(suite, Suite):
            raise InvalidInputError(place, f"it is a {type(suite).__name__}", "Use an instance of Suite")
        if suite.name != key:
            raise InvalidInputError(place, f"its key differs from its name, {suite.name!r}", "Use the name as the key")
        if suite.change is None and suite.base != suite.name:
            cure = "Set the base to the name of the suite, or set change to the name of the change"
            raise InvalidInputError(place, f"it has no change, but its base is {suite.base!r}", cure)


def forget_world(name: str) -> None:
    """Remove a world and its facts from the registry. Only tests need this."""
    _WORLDS.pop(name, None)
    forget_facts(name)


def world_names() -> tuple[str, ...]:
    """Return the names of all worlds, starting with betterbench's own."""
    load_declared()
    return (OURS.name, *(name for name in dict.fromkeys((*_built_in(), *_WORLDS)) if name != OURS.name))


def world_named(name: str) -> World:
    """Return the world with the given name. Raises UnknownNameError if there is none."""
    load_declared()
    if name not in _WORLDS and name in _built_in():
        importlib.import_module(f"{_PACKAGE}.{name}")
    if name not in _WORLDS:
        raise UnknownNameError("world", name, world_names())
    return _WORLDS[name]


def all_worlds() -> tuple[World, ...]:
    """Return all worlds, starting with betterbench's own."""
    return tuple(map(world_named, world_names()))


def world_of_suite(suite: str) -> World:
    """Return the world to which a suite belongs. Raises UnknownNameError if no world has the suite."""
    load_declared()
    facts = facts_of_suite(suite)
    if facts is not None:
        return world_named(facts.name)
    worlds = {name: world for world in all_worlds() for name in world.facts.suites}
    if suite not in worlds:
        raise UnknownNameError("suite", suite, worlds)
    return worlds[suite]


def _built_in() -> list[str]:
    """Return the names of the built-in worlds, which are the folders next to this file."""
    package = importlib.import_module(_PACKAGE)
    return [module.name for module in pkgutil.iter_modules(package.__path__) if module.ispkg]


def _by_name(world: World) -> tuple[Callable[..., World], tuple[object, ...]]:
    """Return the pickle form of a world: its name, its field values, and the user files that define it.

    When the world is unpickled, these files are loaded first.
    """
    files = loaded_files() if code_of("world", world.name) else ()
    return _unpickled, (world.name, files, {f.name: getattr(world, f.name) for f in fields(world)})  # type: ignore[arg-type]


def _unpickled(name: str, files: tuple[TaskFile, ...], values: Mapping[str, Any]) -> World:
    load_sources(files)
    return replace(world_named(name), **values)  # type: ignore[type-var]
