"""Reader for hand-written YAML files. Aliases are rejected because their expansion can exhaust memory."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from betterbench.errors import InvalidInputError, one_line
from betterbench.json_form import read_bounded

if TYPE_CHECKING:
    import yaml

_MAX_BYTES = 64 * 1024
_EXPONENT = re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$")


def read_yaml(path: Path, *, cure: str, deepest: int = 6, max_bytes: int = _MAX_BYTES) -> dict[str, Any]:
    """Read a YAML file and return its fields.

    Args:
        path: YAML file.
        cure: Remedy to include in error messages.
        deepest: Maximum depth of nesting.
        max_bytes: Maximum size of the file.

    Raises:
        InvalidInputError: If the file is missing, larger than ``max_bytes`` or not a mapping, has aliases, contains a
            field twice, or is nested too deeply.
    """
    import yaml

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """YAML loader that parses 1e-3 as a number, as in YAML 1.2.

        In YAML 1.1, such a number needs a decimal point.
        """

    Loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("-+0123456789"))

    text = read_bounded(path, max_bytes=max_bytes, cure=cure)
    try:
        _require_plain(path, text, deepest, cure)
        loader = Loader(text)
        node = loader.get_single_node()
        _require_once(path, node)
        found = None if node is None else loader.construct_document(node)
    except InvalidInputError:
        raise
    except Exception as error:  # PyYAML raises any exception for a value that does not match its tag
        problem = "it is nested too deep" if isinstance(error, RecursionError) else one_line(error, most=200)
        raise InvalidInputError(str(path), f"the file is not YAML ({problem})", cure) from error
    if not isinstance(found, dict):
        raise InvalidInputError(str(path), "the file contains no fields", f"Write lines like `name: value`. {cure}")
    return found


def _require_once(path: Path, node: yaml.Node | None) -> None:
    """Reject duplicate fields. PyYAML would silently keep only the last of them."""
    if node is None or isinstance(node.value, str):
        return
    fields = [key.value for key, _ in node.value] if node.tag.endswith(":map") else []
    twice = next((str(name) for i, name in enumerate(fields) if name in fields[:i]), None)
    if twice is not None:
        line = next(k.start_mark.line for k, _ in reversed(node.value) if k.value == twice)
        raise InvalidInputError(str(path), f"{twice} is given twice (line {line + 1})", "Keep only one of these lines")
    for child in node.value:
        for one in child if isinstance(child, tuple) else (child,):
            _require_once(path, one)


def _require_plain(path: Path, text: bytes, deepest: int, cure: str) -> None:
    """Reject aliases and deep nesting while the file is parsed, before any value is built from it."""
    import yaml

    depth = 0
    for token in yaml.scan(text):
        match token:
            case yaml.AliasToken():
                raise InvalidInputError(
                    str(path), "the file uses a YAML alias (*name)", "Write the value in place of the alias"
                )
            case (
                yaml.FlowSequenceStartToken()
                | yaml.FlowMappingStartToken()
                | yaml.BlockSequenceStartToken()
                | yaml.BlockMappingStartToken()
            ):
                depth += 1
            case yaml.FlowSequenceEndToken() | yaml.FlowMappingEndToken() | yaml.BlockEndToken():
                depth -= 1
        if depth > deepest:
            raise InvalidInputError(str(path), "the file is nested too deeply", cure)
