"""Certification of one asset by running all checks on it."""

from __future__ import annotations

from betterbench.sim.asset_checks import checks as _checks  # noqa: F401 - imported to register the checks
from betterbench.sim.asset_checks.check import check_names, run_check
from betterbench.sim.asset_checks.result import AssetCertificate
from betterbench.sim.asset_checks.subject import Subject
from betterbench.sim.assets import Asset
from betterbench.sim.assets.importing.kinds import Kind, kind_of


def certify_asset(asset: Asset, *, name: str | None = None, kind: Kind | None = None) -> AssetCertificate:
    """Run all checks on an asset.

    Args:
        asset: The asset, from a generator or a mesh file.
        name: Name of the asset in the certificate. If None, it is the asset's identity, such as "mug-red#3".
        kind: Kind of object, which determines the limits for size, mass and pose. If None, the kind declared by the
            asset is used. If the asset declares no kind, checks that need one do not apply.
    """
    judged = kind or kind_of(str(asset.parameters.get("kind", "")))
    subject = Subject(asset, judged)
    return AssetCertificate(
        asset=name or asset.identity,
        content_hash=asset.content_hash(),
        kind=None if judged is None else judged.name,
        source=asset.source,
        license=asset.license,
        checks=tuple(run_check(each, subject) for each in check_names()),
    )
