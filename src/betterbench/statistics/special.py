"""SciPy's special functions. SciPy is imported when one of them is first used, because workers do not need it."""

from __future__ import annotations

import functools
import importlib
import importlib.util
import sys
from types import ModuleType
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

_PACKAGE = "scipy.special"


def __getattr__(name: str) -> object:
    """Return SciPy's function with the given name."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = _compiled()
    found: object = getattr(home if hasattr(home, name) else importlib.import_module(_PACKAGE), name)
    globals()[name] = found  # so that this function is called once for each
    return found


@functools.cache
def _compiled() -> ModuleType | None:
    """Return SciPy's module with the compiled functions, or None if this version of SciPy has no such module.

    The package ``scipy.special`` offers the same functions, and variants for other array libraries. The variants import
    almost all of NumPy, which takes 0.17 of 0.19 s of CPU (SciPy 1.17, NumPy 2.4) at the start of ``better eval``,
    ``diagnose`` and ``report``. Therefore, an empty package takes its place while the compiled module is imported.
    """
    spec = importlib.util.find_spec(_PACKAGE)
    if spec is None or _PACKAGE in sys.modules:
        return None
    sys.modules[_PACKAGE] = importlib.util.module_from_spec(spec)
    try:
        return importlib.import_module(f"{_PACKAGE}._ufuncs")
    except ImportError:
        return None
    finally:
        del sys.modules[_PACKAGE]
