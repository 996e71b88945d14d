"""Registry of checks. A check is a decorated function in a file of the package ``checks``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from betterbench.errors import InvalidInputError, one_line
from betterbench.sim.asset_checks.result import CheckResult, Outcome
from betterbench.sim.asset_checks.subject import Subject

MEASURED_DIGITS = 4


@dataclass(frozen=True, slots=True)
class Finding:
    """Finding of one check about an asset.

    Attributes:
        measured: Measured value, or None if the check does not measure a value.
        limit: Limit for the measured value, or None if the check measures no value.
        unit: Unit of ``measured`` and ``limit``.
        fails: Whether the asset fails the check. None if the check does not apply.
        said: Description of the finding, in one sentence.
        cure: What to do if the asset fails the check, in one sentence.
    """

    measured: float | None
    limit: float | None
    unit: str
    fails: bool | None
    said: str
    cure: str = ""


CheckFunction = Callable[[Subject], Finding]

_CHECKS: dict[str, CheckFunction] = {}


def check(function: CheckFunction) -> CheckFunction:
    """Register a function as a check. The name of the function is the name of the check.

    Raises:
        InvalidInputError: If a check with this name already exists.
    """
    name = function.__name__
    if name in _CHECKS:
        raise InvalidInputError(f"check {name!r}", "a check with this name already exists", "Rename the function")
    _CHECKS[name] = function
    return function


def check_names() -> tuple[str, ...]:
    """Return the names of all checks in the order in which they run."""
    return tuple(_CHECKS)


def run_check(name: str, subject: Subject) -> CheckResult:
    """Run the check with the given name. If the asset cannot be measured, it fails the check."""
    try:
        with np.errstate(all="ignore"):  # a value that is not finite fails the check
            found = _CHECKS[name](subject)
    except Exception as error:  # noqa: BLE001 - geometry and MuJoCo raise many kinds for a broken asset
        said = f"it cannot be measured ({type(error).__name__}: {one_line(error, most=120)})"
        found = Finding(None, None, "", True, said, "Repair its mesh, or import it again")
    outcome: Outcome = "not_applicable" if found.fails is None else "failed" if found.fails else "passed"
    said = f"{found.said}. {found.cure}." if found.fails else f"{found.said}."
    numbers = (None if v is None else float(f"{v:.{MEASURED_DIGITS}g}") for v in (found.measured, found.limit))
    measured, limit = numbers
    return CheckResult(name, outcome, measured, limit, found.unit, said)


def at_most(measured: float, limit: float, unit: str, said: str, cure: str) -> Finding:
    """Return the finding for a value that must not exceed a limit. A value that is NaN or infinite fails the check."""
    return Finding(measured, limit, unit, not measured <= limit, said, cure)


def at_least(measured: float, limit: float, unit: str, said: str, cure: str) -> Finding:
    """Return the finding for a value that must not fall below a limit.

    A value that is NaN or infinite fails the check.
    """
    return Finding(measured, limit, unit, not measured >= limit, said, cure)


def not_applicable(why: str) -> Finding:
    """Return the finding for a check that does not apply to the asset, with the reason."""
    return Finding(None, None, "", None, why)
