"""Contracts that hold for every case of many: one test that loops, and names the cases that broke it."""

from __future__ import annotations

import functools
import inspect
import reprlib
from collections.abc import Callable, Iterable
from typing import Any


def each(
    arguments: str, cases: Iterable[Any] | Callable[[], Iterable[Any]], name: Callable[..., object] | None = None
) -> Callable[[Any], Any]:
    """Makes a test run over all cases, one after the other; the tracebacks of those that fail name them.

    A case costs nothing but its check, while a case of ``parametrize`` costs some 3 ms of CPU more. The cases of a test
    share its fixtures.

    The attribute ``only`` of the test is a function that says of the values of a case whether it is run: all are, until
    a caller who wants fewer replaces it.

    Args:
        arguments: Names of the arguments that a case stands for, separated by commas, as for ``parametrize``.
        cases: The cases: values, or tuples of values where there are several arguments. A function makes them when the
            first test needs them; each process of the tests collects all tests and runs few of them.
        name: Returns what a case is called, from its values. Without it, a case is called by its arguments.
    """
    names = [part.strip() for part in arguments.split(",")]

    @functools.cache
    def listed() -> list[tuple[Any, ...]]:
        found = [tuple(case) if len(names) > 1 else (case,) for case in (cases() if callable(cases) else cases)]
        assert found, f"no case for {arguments}"
        return found

    if not callable(cases):
        listed()

    def called(values: tuple[Any, ...]) -> object:
        if name is not None:
            return name(*values)
        return ", ".join(f"{n} = {_SHORT.repr(value)}" for n, value in zip(names, values, strict=True))

    def decorate(check: Callable[..., None]) -> Callable[..., None]:
        parameters = inspect.signature(check).parameters.values()

        @functools.wraps(check)
        def test(**fixtures: object) -> None:
            failed: list[Exception] = []
            for values in filter(lambda case: test.only(*case), listed()):
                try:
                    check(**dict(zip(names, values, strict=True)), **fixtures)
                except BaseException as error:
                    error.add_note(f"in the case {called(values)}")
                    if not isinstance(error, Exception):
                        raise
                    failed.append(error)
            if len(failed) == 1:
                raise failed[0]
            if failed:
                raise ExceptionGroup(f"{len(failed)} cases failed", failed)

        kept = [parameter for parameter in parameters if parameter.name not in names]
        test.only = lambda *_: True
        test.__signature__ = inspect.Signature(kept)
        del test.__wrapped__
        return test

    return decorate


_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 100
