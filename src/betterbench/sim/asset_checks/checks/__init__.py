"""Checks of the asset certificate, one topic per file. Importing a file registers the checks in it.

The import order is the order of the results: cheap checks of the asset's description first, simulations last.
"""

from betterbench.sim.asset_checks.checks import license, surfaces, size, upright, mass, collision  # noqa: A004, F401, I001
from betterbench.sim.asset_checks.checks import lying, holding, lifting  # noqa: F401
