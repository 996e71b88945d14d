"""Check that the license of an asset is stated."""

from betterbench.sim.asset_checks.check import Finding, check
from betterbench.sim.asset_checks.subject import Subject

_UNKNOWN = frozenset({"", "unknown", "none", "?", "-"})


@check
def license_known(subject: Subject) -> Finding:
    """Check that the asset states a license."""
    name = subject.asset.license.strip()
    fails = name.lower() in _UNKNOWN
    said = "its license is not known" if fails else f"license {name}"
    return Finding(None, None, "", fails, said, "Find the license of its source and give it with --license")
