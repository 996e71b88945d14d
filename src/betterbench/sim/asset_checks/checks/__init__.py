"""Checks of the asset certificate, one topic per file. Importing a file registers its checks.

Results are in import order, with cheap checks of the description first and simulations last.
"""

from betterbench.sim.asset_checks.checks import license, surfaces, size, upright, mass, collision  # noqa: A004, F401, I001
from betterbench.sim.asset_checks.checks import lying, holding, lifting  # noqa: F401
