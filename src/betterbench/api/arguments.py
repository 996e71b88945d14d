"""Names of arguments in errors that name options of the command line."""

from collections.abc import Iterator
from contextlib import contextmanager

from betterbench.errors import InvalidInputError

_OTHER_NAMES = {"name": "names", "policy_timeout": "policy_timeout_s"}
"""Arguments that are called otherwise than their option: lists in the plural, quantities with their unit."""


@contextmanager
def options_as_arguments() -> Iterator[None]:
    """Name the argument where an error names an option of the command line ("--until-decided")."""
    try:
        yield
    except InvalidInputError as error:
        if not error.where.startswith("--"):
            raise
        argument = error.where.removeprefix("--").replace("-", "_")
        raise InvalidInputError(_OTHER_NAMES.get(argument, argument), error.problem, error.cure) from error
