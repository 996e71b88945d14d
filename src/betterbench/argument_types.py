"""Check of the arguments of public functions, for users of the Python interface who do not run a type checker."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from collections.abc import Set as AbstractSet
from numbers import Integral, Real
from pathlib import Path
from types import GenericAlias, NoneType, UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from betterbench.errors import InvalidInputError, UnknownNameError, one_line

_P = ParamSpec("_P")
_R = TypeVar("_R")

_WORDS: Mapping[object, str] = {
    str: "text", Path: "a path", int: "a whole number", float: "a number", bool: "True or False", NoneType: "None",
    Callable: "a function", Mapping: "a mapping",
}  # fmt: skip


def checked_arguments(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorator that checks the types of a function's arguments. A wrong type is an error that names the argument.

    Numbers of NumPy are accepted. The function gets a tuple for each argument that may be a sequence, also if a
    single text or path is given, and paths in which "~" is replaced by the home directory.

    Raises:
        InvalidInputError: If an argument has a wrong type or is missing.
        UnknownNameError: If there is no argument with a given name.
    """
    signature = inspect.signature(function)
    name = function.__qualname__.removesuffix(".__init__")

    @functools.cache
    def hints() -> dict[str, Any]:
        return get_type_hints(function)

    @functools.wraps(function)
    def checked(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        for given in kwargs:
            if given not in signature.parameters:
                raise UnknownNameError(f"argument of {name}", given, signature.parameters.keys() - {"self"})
        try:
            bound = signature.bind(*args, **kwargs)
        except TypeError as error:
            raise InvalidInputError(f"{name}()", str(error), f"Give the arguments as in help({name})") from None
        for argument, value in bound.arguments.items():
            if argument in hints():
                hint = hints()[argument]
                if signature.parameters[argument].kind is inspect.Parameter.VAR_POSITIONAL:
                    hint = GenericAlias(tuple, (hint, ...))
                bound.arguments[argument] = _accepted(argument, value, hint)
        return function(*bound.args, **bound.kwargs)

    return checked


def _accepted(where: str, value: object, hint: object) -> object:
    """Return a value as the function gets it. Raise InvalidInputError if it does not have the type of the hint."""
    parts = list(_parts(hint))
    entries = next((get_args(part)[0] for part in parts if _is_sequence(part)), None)
    if entries is not None and value is not None:
        if isinstance(value, str | Path):
            value = (value,)
        if isinstance(value, Iterable) and not isinstance(value, bytes | AbstractSet | Mapping):
            return tuple(_accepted(f"{where}[{i}]", entry, entries) for i, entry in enumerate(value))
    if not any(_fits(value, part) for part in parts if not _is_sequence(part)):
        shown = one_line(repr(value), most=60)
        problem = "it is None" if value is None else f"{shown} is of type {type(value).__name__}"
        raise InvalidInputError(where, problem, f"Use {' or '.join(dict.fromkeys(map(_words, parts)))}")
    return Path(str(value)).expanduser() if Path in parts and str(value).startswith("~") else value


def _parts(hint: object) -> Iterator[object]:
    if get_origin(hint) in (Union, UnionType):
        for part in get_args(hint):
            yield from _parts(part)
    else:
        yield hint


def _is_sequence(hint: object) -> bool:
    kind = get_origin(hint)
    return isinstance(kind, type) and issubclass(kind, Iterable) and not issubclass(kind, Mapping)


def _fits(value: object, hint: object) -> bool:
    kind: Any = get_origin(hint) or hint
    if kind in (int, float):
        return isinstance(value, Integral if kind is int else Real) and not isinstance(value, bool)
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind is Callable:
        return callable(value)
    # A protocol is checked by the function, which can tell the missing members.
    return getattr(kind, "_is_protocol", False) or isinstance(value, kind)


def _words(hint: object) -> str:
    kind: Any = get_origin(hint) or hint
    if _is_sequence(hint):
        return "a list of " + " or ".join(f"{_WORDS[part].split()[-1]}s" for part in _parts(get_args(hint)[0]))
    return _WORDS.get(kind, f"a {kind.__name__}")
