"""SciPy's special functions, imported without the parts of SciPy and NumPy that they do not need."""

from __future__ import annotations

import importlib
import sys

import pytest
import scipy.special
from tests.prepared_process import OTHERS, prepared

from betterbench.statistics import special

CHECK = """
import sys
from betterbench.statistics import special
found = {name: getattr(special, name) for name in special.__all__}
assert not {"scipy.special", "numpy.f2py"} & set(sys.modules), "slow to import"
import scipy.special, scipy.stats
assert all(getattr(scipy.special, name) is function for name, function in found.items())
assert scipy.special.softmax([0.0, 0.0]).tolist() == [0.5, 0.5]
"""


def test_they_are_the_functions_of_the_package_which_is_imported_afterwards_as_usual():
    done = prepared(*OTHERS).run("-c", CHECK)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def fresh(monkeypatch):
    """The module as it is before the first use of a function."""
    for name in special.__all__:
        monkeypatch.delitem(vars(special), name, raising=False)
    special._compiled.cache_clear()
    yield special
    special._compiled.cache_clear()


def test_a_package_that_is_imported_already_is_used(fresh):
    assert "scipy.special" in sys.modules
    assert fresh.bdtr is scipy.special.bdtr


def test_a_version_of_scipy_with_other_modules_offers_the_same_functions(fresh, monkeypatch):
    usual = importlib.import_module

    def other(name):
        if name == "scipy.special._ufuncs":
            raise ModuleNotFoundError(name)
        return usual(name)

    monkeypatch.delitem(sys.modules, "scipy.special")
    monkeypatch.setattr(importlib, "import_module", other)
    assert fresh._compiled() is None
    assert "scipy.special" not in sys.modules
    monkeypatch.setitem(sys.modules, "scipy.special", scipy.special)
    assert fresh.gammaln is scipy.special.gammaln
