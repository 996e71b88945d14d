"""JSON-serializable results of the asset certificate, per check and per asset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from betterbench.errors import InvalidInputError

Outcome = Literal["passed", "failed", "not_applicable"]
SCHEMA_VERSION = 1
"""Version of the JSON format."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of one check.

    Attributes:
        name: Name of the check ("rest_tilt").
        outcome: "passed", "failed" or "not_applicable".
        measured: Measured value, or None if nothing was measured.
        limit: Limit for ``measured``, or None if nothing was measured.
        unit: Unit of both ("mm", "degrees", "share").
        sentence: Description of the finding, with a remedy if the check failed.
    """

    name: str
    outcome: Outcome
    measured: float | None
    limit: float | None
    unit: str
    sentence: str


@dataclass(frozen=True, slots=True)
class AssetCertificate:
    """Certificate of one asset, with all results.

    Attributes:
        asset: Name or file of the asset.
        content_hash: Hash of all data that affect physics or images.
        kind: Kind that determined the limits of size, mass and pose, or None if unknown.
        source: Source of the asset.
        license: License of the asset.
        checks: One result per registered check, in order.
        refused: Import error. There are no checks if the import failed.
    """

    asset: str
    content_hash: str
    kind: str | None
    source: str
    license: str
    checks: tuple[CheckResult, ...]
    refused: str | None = None

    @property
    def passed(self) -> bool:
        """Whether the import succeeded and no check failed."""
        return self.refused is None and not self.failed

    @property
    def failed(self) -> tuple[CheckResult, ...]:
        """The failed checks."""
        return tuple(check for check in self.checks if check.outcome == "failed")

    def check(self, name: str) -> CheckResult:
        """Return the result of a check by name. An unknown name raises a KeyError."""
        return {check.name: check for check in self.checks}[name]

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {"version": SCHEMA_VERSION, "passed": self.passed, **asdict(self)}

    @classmethod
    def from_json(cls, form: Mapping[str, Any], where: str = "asset certificate") -> AssetCertificate:
        """Read a certificate from JSON.

        Raises:
            InvalidInputError: If the JSON is not a certificate of this version.
        """
        try:
            fields = {name: form[name] for name in cls.__dataclass_fields__ if name != "checks"}
            version, checks = form["version"], tuple(CheckResult(**check) for check in form["checks"])
        except (KeyError, TypeError) as error:
            raise InvalidInputError(where, "it is not an asset certificate", "Make it again") from error
        if version != SCHEMA_VERSION:
            problem = f"it has version {version!r}, expected {SCHEMA_VERSION}"
            raise InvalidInputError(where, problem, "Make it again")
        return cls(**fields, checks=checks)
