"""Risks of evaluating a policy whose address comes from a file written by someone else."""

from __future__ import annotations

from urllib.parse import parse_qsl

from betterbench.errors import InvalidInputError, one_line
from betterbench.policies.kinds import find_kind

_VARIABLE = "_env"  # suffix of all options whose value is the name of an environment variable


def risks_of(address: str) -> tuple[str, ...]:
    """Return the risks of evaluating a policy (it runs code, or sends a secret), to which the user must agree."""
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
    """Reject a policy address from a file if evaluating the policy would run code or send a secret.

    ``where`` is the name of the file, for the error message.

    Raises:
        InvalidInputError: If the policy runs code or sends a secret. The message names the risk.
    """
    risks = risks_of(address)
    if risks:
        raise InvalidInputError(
            where,
            f"the policy {one_line(address)} {' and '.join(risks)}",
            "Use --trust if you trust the author of this file, or --policy to evaluate another policy",
        )
