"""Static benchmarks, one file each.

To add a benchmark, write a file that defines a :class:`Benchmark`, and add the benchmark to :data:`BENCHMARKS`.
"""

from __future__ import annotations

from betterbench.errors import find_named
from betterbench.vlm.benchmarks.benchmark import Benchmark, DataFile, DataSource, Headline
from betterbench.vlm.benchmarks.better_vqa import BETTER_VQA
from betterbench.vlm.benchmarks.egoplan2 import EGOPLAN2
from betterbench.vlm.benchmarks.embspatial import EMBSPATIAL
from betterbench.vlm.benchmarks.refspatial import REFSPATIAL

BENCHMARKS: tuple[Benchmark, ...] = (BETTER_VQA, EMBSPATIAL, REFSPATIAL, EGOPLAN2)
"""All benchmarks. The first one does not need a download."""

__all__ = ["BENCHMARKS", "Benchmark", "DataFile", "DataSource", "Headline", "find_benchmark"]


def find_benchmark(name: str) -> Benchmark:
    """Return the benchmark with the given name. Raises UnknownNameError if there is no such benchmark."""
    return find_named("benchmark", name, BENCHMARKS)
