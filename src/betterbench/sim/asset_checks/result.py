"""The results of single checks and the certificates of assets. Both can be stored as JSON."""

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
        name: Name of the check, such as "rest_tilt".
        outcome: "passed", "failed" or "not_applicable".
        measured: Measured value, or None if nothing was measured.
        limit: Limit for the measured value, or None if nothing was measured.
        unit: Unit of ``measured`` and ``limit``, such as "mm", "degrees" or "share" (a fraction).
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
    """Certificate of one asset, which contains the results of all checks.

    Attributes:
        asset: Name or file of the asset.
        content_hash: Hash of all properties of the asset that affect physics or images.
        kind: Kind of object that determined the limits for size, mass and pose, or None if unknown.
        source: Where the asset comes from.
        license: License of the asset.
        checks: One result for each registered check, in order.
        refused: Error message of a failed import, or None if the import succeeded. After a failed import, there are no
            check results.
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
        """Whether the asset could be imported and passed all checks that apply."""
        return self.refused is None and not self.failed

    @property
    def failed(self) -> tuple[CheckResult, ...]:
        """Results of the checks that the asset has failed."""
        return tuple(check for check in self.checks if check.outcome == "failed")

    def check(self, name: str) -> CheckResult:
        """Return the result of the check with the given name. Raises KeyError if there is no such check."""
        return {check.name: check for check in self.checks}[name]

    def to_json(self) -> dict[str, Any]:
        """Return a JSON-serializable dict."""
        return {"version": SCHEMA_VERSION, "passed": self.passed, **asdict(self)}

    @classmethod
    def from_json(cls, form: Mapping[str, Any], where: str = "asset certificate") -> AssetCertificate:
        """Read a certificate from its JSON form.

        Raises:
            InvalidInputError: If the JSON is not a certificate of the supported version.
        """
        try:
            fields = {name: form[name] for name in cls.__dataclass_fields__ if name != "checks"}
            version, checks = form["version"], tuple(CheckResult(**check) for check in form["checks"])
        except (KeyError, TypeError) as error:
            raise InvalidInputError(where, "it is not an asset certificate", "Check the asset again") from error
        if version != SCHEMA_VERSION:
            problem = f"it has version {version!r}, expected {SCHEMA_VERSION}"
            raise InvalidInputError(where, problem, "Check the asset again")
        return cls(**fields, checks=checks)
