"""Asset certificate: checks that every imported or generated asset should pass before it is used in a task.

- ``certificate``: all checks of one asset. ``result``: the results and their JSON.
- ``check``, ``subject``: the registry of checks, and the measurements that they share.
- ``checks``: one topic per file: license, surfaces, size, upright, mass, collision, lying, holding, lifting.
- ``rest``, ``lift``: the simulations of one asset on a table and in a gripper.
- ``limits``: all limits, each with its unit and a reason.
"""

from betterbench.sim.asset_checks.certificate import certify_asset
from betterbench.sim.asset_checks.check import check_names
from betterbench.sim.asset_checks.result import AssetCertificate, CheckResult

__all__ = ["AssetCertificate", "CheckResult", "certify_asset", "check_names"]
