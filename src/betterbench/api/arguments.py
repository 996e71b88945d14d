"""Translation of command-line options into argument names in error messages."""

from collections.abc import Iterator
from contextlib import contextmanager

from betterbench.errors import InvalidInputError

_OTHER_NAMES = {"name": "names", "policy_timeout": "policy_timeout_s"}
"""Python arguments whose names differ from their command-line options: lists are plural, and quantities name their
unit.
"""


@contextmanager
def options_as_arguments() -> Iterator[None]:
    """Replace command-line options in error messages ("--until-decided") with Python arguments ("until_decided")."""
    try:
        yield
    except InvalidInputError as error:
        if not error.where.startswith("--"):
            raise
        argument = error.where.removeprefix("--").replace("-", "_")
        raise InvalidInputError(_OTHER_NAMES.get(argument, argument), error.problem, error.cure) from error
