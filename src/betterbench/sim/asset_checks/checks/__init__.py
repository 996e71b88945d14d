"""Checks of the asset certificate, one topic per file. Importing a file registers the checks in it.

The results are listed in the order of the imports below. Cheap checks of the asset's description come first, and
simulations come last.
"""

from betterbench.sim.asset_checks.checks import license, surfaces, size, upright, mass, collision  # noqa: A004, F401, I001
from betterbench.sim.asset_checks.checks import lying, holding, lifting  # noqa: F401
