"""What tells an address of the independent family from others, without importing its habits."""

from __future__ import annotations

from betterbench.errors import UnknownNameError
from betterbench_calibration.independent.address import PREFIX


def is_independent(address: str) -> bool:
    """Tell whether an address is one of the family; an unknown policy of it raises an UnknownNameError."""
    if not address.startswith(PREFIX):
        return False
    # Imported here: the habits are a quarter of what a worker would import, and most runs have none.
    from betterbench_calibration.independent.registry import INDEPENDENT  # noqa: PLC0415

    if address not in INDEPENDENT:
        raise UnknownNameError("policy of the independent family", address, INDEPENDENT)
    return True
