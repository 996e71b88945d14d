"""Reproductions of upstream scorers, including their faults, for comparison with published numbers.

Each scorer reproduces an upstream program at a fixed commit, and gives the same score for the same replies. The table
"Official scoring" in ``docs/vlm.md`` lists how these scores differ from those of betterbench.
"""

from __future__ import annotations

from betterbench.vlm.official.egoplan2 import EGOPLAN2_EVAL, EGOPLAN2_LMMS_EVAL
from betterbench.vlm.official.embspatial import EMBSPATIAL_LMMS_EVAL
from betterbench.vlm.official.refspatial import REFSPATIAL_EASI, REFSPATIAL_LMMS_EVAL, REFSPATIAL_ROBOREFER
from betterbench.vlm.official.upstream import UpstreamScore, UpstreamScorer, upstream_scores

UPSTREAM: dict[str, tuple[UpstreamScorer, ...]] = {
    "embspatial": (EMBSPATIAL_LMMS_EVAL,),
    "refspatial": (REFSPATIAL_ROBOREFER, REFSPATIAL_LMMS_EVAL, REFSPATIAL_EASI),
    "egoplan2": (EGOPLAN2_EVAL, EGOPLAN2_LMMS_EVAL),
}
"""Upstream scorers of each benchmark. If the authors published a scorer, it comes first."""

__all__ = ["UPSTREAM", "UpstreamScore", "UpstreamScorer", "upstream_scores"]
