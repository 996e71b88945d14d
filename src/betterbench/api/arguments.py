"""Adaptation of error messages to the Python API: command-line options are replaced by names of arguments."""

from collections.abc import Iterator
from contextlib import contextmanager

from betterbench.errors import InvalidInputError

_OTHER_NAMES = {"name": "names", "policy_timeout": "policy_timeout_s"}
"""Python argument for each command-line option with a different name.

Arguments that are lists have plural names, and names of quantities contain the unit.
"""


@contextmanager
def options_as_arguments() -> Iterator[None]:
    """Context manager that replaces an option ("--until-decided") in an error by the argument ("until_decided")."""
    try:
        yield
    except InvalidInputError as error:
        if not error.where.startswith("--"):
            raise
        argument = error.where.removeprefix("--").replace("-", "_")
        raise InvalidInputError(_OTHER_NAMES.get(argument, argument), error.problem, error.cure) from error
