"""Asset certificate: checks that an imported or generated asset should pass before a task uses it.

- ``certificate``: runs all checks on one asset. ``result``: the results and their JSON form.
- ``check``, ``subject``: the registry of checks, and the measurements that several checks share.
- ``checks``: the checks, one topic per file: license, surfaces, size, upright, mass, collision, lying, holding,
  lifting.
- ``rest``, ``lift``: simulations of an asset that rests on a table or is lifted by a gripper.
- ``limits``: all limits, each with its unit and a reason.
"""

from betterbench.sim.asset_checks.certificate import certify_asset
from betterbench.sim.asset_checks.check import check_names
from betterbench.sim.asset_checks.result import AssetCertificate, CheckResult

__all__ = ["AssetCertificate", "CheckResult", "certify_asset", "check_names"]
