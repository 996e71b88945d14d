"""Trust in a policy named by a file: the risks of evaluating it on this machine, and the required consent."""

from __future__ import annotations

from urllib.parse import parse_qsl

from betterbench.errors import InvalidInputError, one_line
from betterbench.policies.kinds import find_kind

_VARIABLE = "_env"  # ends the name of each option that names an environment variable


def risks_of(address: str) -> tuple[str, ...]:
    """Return the risks of evaluating a policy that need consent: running code, or sending a secret."""
    found = []
    kind = find_kind(address)
    head, _, query = address.partition("?")
    target = head.partition(":")[2]
    if kind is not None and kind.risk:
        found.append(kind.risk.replace("{target}", one_line(target, most=200)))
    for name, value in parse_qsl(query, keep_blank_values=True):
        if name.endswith(_VARIABLE):
            server = one_line(target.removeprefix("//"), most=200)
            found.append(f"sends the environment variable {one_line(value, most=100)} to {server}")
    return tuple(found)


def require_trust(address: str, *, where: str) -> None:
    """Check that a policy named by a file runs no code and sends no secret.

    ``where`` is the file, for the error.

    Raises:
        InvalidInputError: If it does; the message says which.
    """
    risks = risks_of(address)
    if risks:
        raise InvalidInputError(
            where,
            f"its policy {one_line(address)} {' and '.join(risks)}",
            "Give --trust if you trust whoever wrote this file, or --policy to evaluate another policy",
        )
