"""Policy kind ``python``: Python classes written by the user.

The address is ``python:module:Class`` or ``python:path/to/file.py:Class``, followed by arguments as ``?key=value``.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import unquote

from betterbench.errors import BetterError, InvalidInputError, PolicyProcessError, described
from betterbench.interface import Policy
from betterbench.interface.policy import require_policy
from betterbench.ordinary_file import read_ordinary
from betterbench.policies.address import AddressForm, PolicyAddress
from betterbench.policies.kinds.kind import OWN_PROCESS, PolicyKind, register


def load_plugin(address: str) -> Policy:
    """Create an instance of a user's class.

    The address is "module:Class" or "file.py:Class". Arguments for the class follow in the same format as in a URL
    ("?checkpoint=a/b&k=8"). A value that is valid JSON (8, 0.5, true, null, "8") is parsed as JSON. Any other value is
    passed as a string.

    Raises InvalidInputError if the module, the class or one of its methods does not exist, if an argument is missing or
    unknown, or if the class cannot be instantiated.
    """
    where, name, arguments = _parts(address)
    module = _load_file(Path(where)) if where.endswith(".py") else _load_module(where)
    try:
        made = getattr(module, name)
    except AttributeError:
        raise InvalidInputError(
            f"policy python:{address}", f"{where} has no {name!r}", "Use the name of a class in that module"
        ) from None
    policy = _instance(address, name, made, arguments)
    require_policy(policy, f"policy python:{address}")
    return policy


def source_of(address: str) -> str:
    """Return the name and SHA-256 of the file from which this process loaded a plugin.

    Return an empty string if the plugin was not loaded from a file.
    """
    where = address.partition("?")[0].rpartition(":")[0]
    path = where if where.endswith(".py") else getattr(sys.modules.get(where), "__file__", None)
    if not path or not Path(path).is_file():
        return ""
    return f"{Path(path).name}, sha256 {hashlib.sha256(read_ordinary(Path(path))).hexdigest()}"


def _parts(address: str) -> tuple[str, str, dict[str, Any]]:
    """Split an address into the module or file, the class, and the arguments by name."""
    path, _, query = address.partition("?")
    where, separator, name = path.rpartition(":")
    if not separator or not where or not name:
        raise InvalidInputError(
            f"policy python:{address}",
            "the class name is missing from the address",
            "Write python:module:Class or python:file.py:Class",
        )
    arguments: dict[str, Any] = {}
    for part in query.split("&") if query else ():
        key, separator, value = part.partition("=")
        key = unquote(key)
        if not separator or not key.isidentifier() or key in arguments:
            problem = f"argument {key!r} is given twice" if key in arguments else f"{part!r} is not an argument"
            raise InvalidInputError(
                f"policy python:{address}", problem, "Write ?key=value&key=value, with each key once"
            )
        arguments[key] = _value(unquote(value))
    return where, name, arguments


def _value(text: str) -> Any:  # noqa: ANN401 - any JSON value
    from betterbench.json_form import parse_json  # imported here, because a policy's process should not import pydantic

    try:
        return parse_json(text)
    except ValueError:
        return text


def _instance(address: str, name: str, made: Callable[..., Policy], arguments: dict[str, Any]) -> Policy:
    """Create an instance of a plugin's class with the arguments in the address."""
    takes = "none"
    try:
        signature = inspect.signature(made)
        takes = ", ".join(signature.parameters) or takes
        signature.bind(**arguments)
    except (TypeError, ValueError) as error:
        how = "with these arguments" if arguments else "without arguments"
        cure = f"It takes these arguments: {takes}. Write python:…:{name}?key=value, or add defaults to the class"
        raise InvalidInputError(f"policy python:{address}", f"{name} cannot be called {how} ({error})", cure) from None
    try:
        return made(**arguments)
    except BetterError:
        raise
    except (Exception, SystemExit) as error:
        raise PolicyProcessError(f"policy python:{address}: {name} cannot be created: {described(error)}") from error


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
    except (Exception, SystemExit) as error:
        raise InvalidInputError(
            f"policy python:{name}",
            f"the module cannot be imported: {described(error)}",
            "Install the module, or run the command in its folder",
        ) from error


def _load_file(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"betterbench_plugin_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise InvalidInputError(
            f"policy python:{path}", "the file does not exist", "Use the path of an existing Python file"
        )
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)  # as Python does for a script, so that the file can import modules in its folder
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look up the module of their class in sys.modules
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise InvalidInputError(
            f"policy python:{path}", f"the file cannot be loaded: {described(error)}", "Correct the error in the file"
        ) from error
    return module


_FORM = AddressForm(scheme="python", example="python:FILE.py:CLASS")


def _rest(text: str) -> str:
    return text.removeprefix(f"{_FORM.scheme}:")


def _read(text: str, world: str) -> PolicyAddress:
    """Parse an address whose options are arguments of the user's class.

    The class checks them when it is instantiated.
    """
    _parts(_rest(text))
    return PolicyAddress(text, _FORM, _rest(text).partition("?")[0], {}, world)


def _make(address: PolicyAddress) -> Policy:
    return load_plugin(_rest(address.text))


def _source_of(address: PolicyAddress) -> str:
    return source_of(_rest(address.text))


PYTHON = register(
    PolicyKind(
        form=_FORM,
        shown="python:FILE.py:CLASS",
        summary="Your own class with info, reset and act; arguments follow as ?key=value.",
        needs=OWN_PROCESS,
        make=_make,
        read=_read,
        source_of=_source_of,
        risk="runs the Python code of {target}",
    )
)
