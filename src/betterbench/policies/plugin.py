"""Plain Python policies: ``python:module:Class`` or ``python:path/to/file.py:Class``."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from betterbench.errors import InvalidInputError
from betterbench.interface import Policy, PolicyInfo


def load_plugin(address: str) -> Policy:
    """Return an instance of a class that a user wrote ("module:Class" or "file.py:Class"), made without arguments.

    Raises InvalidInputError if the module, the class or one of the methods is missing.
    """
    where, separator, name = address.rpartition(":")
    if not separator or not where or not name:
        raise InvalidInputError(
            f"policy python:{address}", "it names no class", "Write python:module:Class or python:file.py:Class"
        )
    module = _load_file(Path(where)) if where.endswith(".py") else _load_module(where)
    try:
        made = getattr(module, name)
    except AttributeError:
        raise InvalidInputError(
            f"policy python:{address}", f"{where} has no {name!r}", "Name a class of that module"
        ) from None
    policy = _instance(address, name, made)
    for needed in ("info", "reset", "act"):
        if not hasattr(policy, needed):
            raise InvalidInputError(
                f"policy python:{address}",
                f"{name} has no {needed!r}",
                "Give it info, reset(start) and act(observation)",
            )
    if not isinstance(policy.info, PolicyInfo):
        raise InvalidInputError(
            f"policy python:{address}",
            f"info of {name} is a {type(policy.info).__name__}",
            "Make it a betterbench.interface.PolicyInfo",
        )
    return policy


def source_of(address: str) -> str:
    """Return name and fingerprint of the file that a plugin was loaded from in this process; empty if there is none."""
    where = address.rpartition(":")[0]
    path = where if where.endswith(".py") else getattr(sys.modules.get(where), "__file__", None)
    if not path or not Path(path).is_file():
        return ""
    return f"{Path(path).name}, sha256 {hashlib.sha256(Path(path).read_bytes()).hexdigest()}"


def _instance(address: str, name: str, made: Callable[[], Policy]) -> Policy:
    """Call a plugin's class without arguments; what it raises itself is its author's to see."""
    try:
        inspect.signature(made).bind()
    except (TypeError, ValueError) as error:
        raise InvalidInputError(
            f"policy python:{address}", f"{name} cannot be called without arguments ({error})", "Give defaults to all"
        ) from None
    return made()


def _load_module(name: str) -> ModuleType:
    if not all(part.isidentifier() for part in name.split(".")):
        raise InvalidInputError(
            f"policy python:{name}",
            f"{name!r} is not a module name",
            "Write python:module:Class or python:file.py:Class",
        )
    if str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
    try:
        return importlib.import_module(name)
    except (ImportError, SyntaxError) as error:
        raise InvalidInputError(
            f"policy python:{name}", f"the module cannot be imported ({error})", "Install it or run beside it"
        ) from error


def _load_file(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"betterbench_plugin_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise InvalidInputError(f"policy python:{path}", "there is no such file", "Name an existing Python file")
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)  # as for a script: what lies beside the file can be imported
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look the module of their class up there
    try:
        spec.loader.exec_module(module)
    except (ImportError, SyntaxError) as error:
        raise InvalidInputError(
            f"policy python:{path}", f"it cannot be loaded ({error})", "Correct the file"
        ) from error
    return module
