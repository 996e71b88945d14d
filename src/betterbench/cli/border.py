"""Checks of numeric options, output of a JSON document alone on standard output, and errors about other worlds."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import Any, get_type_hints

from betterbench.cli.console import document_alone
from betterbench.errors import BetterError, InvalidInputError, UnknownNameError, require_between

LIMITS: Mapping[str, tuple[float, float]] = {
    "alpha": (1e-9, 1.0),
    "at_once": (1, 256),
    "attempts": (1, 100),
    "batch": (1, 1024),
    "camera_rate_hz": (1, 1_000),
    "chunk": (1, 256),
    "clients": (1, 10_000),
    "demonstrations": (1, 100_000),
    "demos": (1, 100_000),
    "draws": (0, 100_000_000),
    "envs": (1, 256),
    "films": (0, 10_000),
    "fovy_deg": (10, 150),
    "frames": (0, 100_000),
    "gpus": (1, 1 << 20),
    "images": (1, 1_000_000),
    "limit": (1, 1_000),
    "mass_kg": (1e-6, 1e6),
    "max_attempts": (1, 100_000),
    "max_faces": (0, 2**31 - 1),
    "max_size": (0.0, 1e6),
    "max_tiles": (1, 1000),
    "max_tokens": (1, 1 << 20),
    "min_size": (0.0, 1e6),
    "noise": (0.0, 0.5),
    "num": (1, 10_000),
    "parameters": (1, 1e15),
    "policy_timeout": (0.001, 604_800),
    "power": (0, 1_000),
    "price_in": (0.0, 1e9),
    "price_out": (0.0, 1e9),
    "questions": (0, 10_000_000),
    "rate_hz": (1.0, 100.0),
    "replica_gpus": (0, 64),
    "replicas": (1, 256),
    "ruler_mm": (0.01, 10_000),
    "sample_tokens": (1, 1 << 20),
    "seed": (0, 2**31 - 1),
    "seeds": (1, 1_000),
    "size": (16, 4096),
    "size_m": (1e-6, 1e6),
    "sources": (0, 10_000),
    "steps": (1, 1_000_000_000),
    "time_limit_s": (1.0, 600.0),
    "tokens_per_gpu": (1, 1 << 30),
    "trials": (1, 10_000),
    "tries": (1, 20),
    "until": (1, 10_000),
    "validation": (0.0, 0.99),
    "variants": (1, 10_000),
    "workers": (1, 256),
}
"""Minimum and maximum of each numeric option, by option name.

Ports are not listed, because they are checked when they are bound.
"""


def guarded(function: Callable[..., None]) -> Callable[..., None]:
    """Wrap a subcommand so that its numeric options are checked before it runs.

    If ``--json`` is given, the wrapped subcommand prints nothing but its JSON document on standard output.
    """

    def verb(*args: object, **options: object) -> None:
        for name, value in _numbers(options):
            if name in LIMITS:
                require_between(f"--{name.replace('_', '-')}", value, *LIMITS[name])
        if options.get("json") is True:
            with document_alone():
                function(*args, **options)
        else:
            function(*args, **options)

    verb.__doc__ = function.__doc__
    verb.__annotations__ = get_type_hints(function, include_extras=True)
    vars(verb)["__signature__"] = inspect.signature(function)
    return verb


def _numbers(options: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the name and value of each numeric option, including the fields of option groups."""
    for name, value in options.items():
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            yield from _numbers({field.name: getattr(value, field.name) for field in dataclasses.fields(value)})
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield name, value


def in_other_world(error: BetterError) -> BetterError:
    """Return the given error, or an error that says that a command does not support the world of a task or suite."""
    if not isinstance(error, UnknownNameError) or error.kind not in ("task", "suite"):
        return error
    from betterbench.tasks.worlds.facts import OURS, facts_of_suite, facts_of_task

    world_of = facts_of_task if error.kind == "task" else facts_of_suite
    found = world_of(error.name)
    if found is None or found is OURS or any(world_of(name) is found for name in error.known):
        return error
    return InvalidInputError(
        f"{error.kind} {error.name!r}",
        f"it is a {error.kind} of {found.title}, but this command serves betterbench's own scenes only",
        f"Use one of {', '.join(error.known)}",
    )
