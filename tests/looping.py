"""Contracts that hold for every member of a registry: one test that loops, and names the case that broke it."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any


def each(
    arguments: str, cases: Iterable[Any] | Callable[[], Iterable[Any]], name: Callable[..., object] = str
) -> Callable[[Any], Any]:
    """Makes a test run over all cases, one after the other; the first that fails is named in the traceback.

    The attribute ``only`` of the test is a function that says of the values of a case whether it is run: all are, until
    a caller who wants fewer replaces it.

    Args:
        arguments: Names of the arguments that a case stands for, separated by commas, as for ``parametrize``.
        cases: The cases: values, or tuples of values where there are several arguments. A function makes them when the
            first test needs them; each process of the tests collects all tests and runs few of them.
        name: Returns what a case is called, from its values.
    """
    names = [part.strip() for part in arguments.split(",")]

    @functools.cache
    def listed() -> list[tuple[Any, ...]]:
        found = [case if len(names) > 1 else (case,) for case in (cases() if callable(cases) else cases)]
        assert found, f"no case for {arguments}"
        return found

    if not callable(cases):
        listed()

    def decorate(check: Callable[..., None]) -> Callable[..., None]:
        parameters = inspect.signature(check).parameters.values()

        @functools.wraps(check)
        def test(**fixtures: object) -> None:
            for values in filter(lambda case: test.only(*case), listed()):
                try:
                    check(**dict(zip(names, values, strict=True)), **fixtures)
                except BaseException as error:
                    error.add_note(f"in the case {name(*values)}")
                    raise

        kept = [parameter for parameter in parameters if parameter.name not in names]
        test.only = lambda *_: True
        test.__signature__ = inspect.Signature(kept)
        del test.__wrapped__
        return test

    return decorate
