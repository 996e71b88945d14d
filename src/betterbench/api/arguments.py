"""Argument names for errors that name options of the command line."""

from collections.abc import Iterator
from contextlib import contextmanager

from betterbench.errors import InvalidInputError

_OTHER_NAMES = {"name": "names", "policy_timeout": "policy_timeout_s"}
"""Arguments whose names differ from their option: lists in the plural, quantities with their unit."""


@contextmanager
def options_as_arguments() -> Iterator[None]:
    """Replace an option of the command line in an error ("--until-decided") by the argument."""
    try:
        yield
    except InvalidInputError as error:
        if not error.where.startswith("--"):
            raise
        argument = error.where.removeprefix("--").replace("-", "_")
        raise InvalidInputError(_OTHER_NAMES.get(argument, argument), error.problem, error.cure) from error
