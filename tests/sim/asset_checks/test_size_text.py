"""The sentence of the size check, where a size is next to a limit."""

from __future__ import annotations

import re
from types import SimpleNamespace

from tests.looping import each

from betterbench.sim.asset_checks import limits
from betterbench.sim.asset_checks.checks.size import size
from betterbench.sim.assets.importing.kinds import kinds

KINDS = [*kinds(), None]


@each("factor", [0.9, 0.9999, 1.0001, 1.1])
@each("end", ["low", "high"])
def test_a_size_outside_the_limits_is_outside_the_printed_limits(end, factor):
    for kind in KINDS:
        low = limits.LEAST_M if kind is None else kind.low_m / limits.SIZE_FACTOR
        high = limits.MOST_M if kind is None else kind.high_m * limits.SIZE_FACTOR
        longest = factor * (low if end == "low" else high)
        found = size(SimpleNamespace(kind=kind, longest_m=longest))
        said, *usual = (float(number) for number in re.findall(r"[\d.]+(?= cm| to)", found.said))
        assert found.fails == (not low <= longest <= high)
        assert found.fails == (not usual[0] <= said <= usual[1]), found.said
