"""SciPy's special functions. SciPy is imported when one of them is first used, because workers do not need it."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scipy.special import (
        bdtr,
        bdtrc,
        bdtrik,
        betaincinv,
        gammaln,
        ndtr,
        ndtri,
        xlog1py,
        xlogy,
    )

__all__ = ["bdtr", "bdtrc", "bdtrik", "betaincinv", "gammaln", "ndtr", "ndtri", "xlog1py", "xlogy"]


def __getattr__(name: str) -> object:
    """Return SciPy's function with the given name."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found: object = getattr(importlib.import_module("scipy.special"), name)
    globals()[name] = found  # so that this function is called once for each
    return found
