"""The register of checks: a check is one decorated function, in a file of the package ``checks``."""

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
    """What a check found.

    Attributes:
        measured: The measured number, None if there is nothing to measure.
        limit: The number that it is compared with, None likewise.
        unit: Unit of both.
        fails: Whether the check fails; None if it does not apply.
        said: What was found, one sentence.
        cure: What to do if it fails, one sentence.
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
    """Register a function as the check of its own name.

    Raises:
        InvalidInputError: If there is such a check already.
    """
    name = function.__name__
    if name in _CHECKS:
        raise InvalidInputError(f"check {name!r}", "the name is taken", "Name the function otherwise")
    _CHECKS[name] = function
    return function


def check_names() -> tuple[str, ...]:
    """Return the names of all checks in the order in which they run."""
    return tuple(_CHECKS)


def run_check(name: str, subject: Subject) -> CheckResult:
    """Run a check by name; a check that cannot measure the asset fails."""
    try:
        with np.errstate(all="ignore"):  # a number that is not finite fails its check
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
    """Return the finding of a number that may not exceed a limit; a number that is not finite exceeds it."""
    return Finding(measured, limit, unit, not measured <= limit, said, cure)


def at_least(measured: float, limit: float, unit: str, said: str, cure: str) -> Finding:
    """Return the finding of a number that may not fall below a limit."""
    return Finding(measured, limit, unit, not measured >= limit, said, cure)


def not_applicable(why: str) -> Finding:
    """Return the finding of a check that does not apply."""
    return Finding(None, None, "", None, why)
