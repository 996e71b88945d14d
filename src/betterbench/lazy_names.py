"""Public names of a package that are imported from its modules when they are first used."""

import importlib
from collections.abc import Callable, Mapping, Sequence


def lazy_names(package: str, names: Mapping[str, Sequence[str]]) -> Callable[[str], object]:
    """Return a ``__getattr__`` function for a package that imports each public name when it is first used.

    Assign the result to ``__getattr__`` in an ``else`` branch of ``if TYPE_CHECKING``, and import the names in the
    other branch. Type checkers then report unknown names.

    Args:
        package: Name of the package.
        names: Names to import from each module. Module names are relative to the package.
    """
    homes = {name: module for module, of_module in names.items() for name in of_module}

    def get(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(f"{package}.{homes[name]}"), name)

    return get
