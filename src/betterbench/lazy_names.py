"""Public package names that are imported at first use."""

import importlib
from collections.abc import Callable, Mapping, Sequence


def lazy_names(package: str, names: Mapping[str, Sequence[str]]) -> Callable[[str], object]:
    """Return the ``__getattr__`` for a package whose names are imported from other modules at first use.

    Assign it outside ``TYPE_CHECKING``, so that unknown names stay errors for type checkers, and import the names under
    ``TYPE_CHECKING``.

    Args:
        package: Package name.
        names: Names by module; modules are relative to the package.
    """
    homes = {name: module for module, of_module in names.items() for name in of_module}

    def get(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(f"{package}.{homes[name]}"), name)

    return get
