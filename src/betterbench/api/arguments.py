"""Conversion of error messages of the command line to the Python API: options are replaced by argument names."""

from collections.abc import Iterator
from contextlib import contextmanager

from betterbench.errors import InvalidInputError

_OTHER_NAMES = {"name": "names", "policy_timeout": "policy_timeout_s"}
"""Python arguments that are named differently from their command-line options: lists have plural names, and names of
quantities contain the unit.
"""


@contextmanager
def options_as_arguments() -> Iterator[None]:
    """In error messages, replace a command-line option ("--until-decided") by the Python argument ("until_decided")."""
    try:
        yield
    except InvalidInputError as error:
        if not error.where.startswith("--"):
            raise
        argument = error.where.removeprefix("--").replace("-", "_")
        raise InvalidInputError(_OTHER_NAMES.get(argument, argument), error.problem, error.cure) from error
