"""YAML files that a person writes, read into plain values without what a stranger's file could do with aliases."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError
from betterbench.json_form import read_bounded

_MAX_BYTES = 64 * 1024


def read_yaml(path: Path, *, cure: str, deepest: int = 6) -> dict[str, Any]:
    """Return what a YAML file holds.

    Raises:
        InvalidInputError: If it is missing, larger than 64 KiB, no mapping, has aliases, or is nested too deep.
    """
    import yaml

    text = read_bounded(path, max_bytes=_MAX_BYTES, cure=cure)
    try:
        _require_plain(path, text, deepest, cure)
        found = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        problem = " ".join(str(error).split())[:200] or "it is nested too deep"
        raise InvalidInputError(str(path), f"is not YAML ({problem})", cure) from error
    if not isinstance(found, dict):
        raise InvalidInputError(str(path), "it holds no fields", f"Write lines like `name: value`. {cure}")
    return found


def _require_plain(path: Path, text: bytes, deepest: int, cure: str) -> None:
    """Refuse aliases and deep nesting at the first one, before anything is built."""
    import yaml

    depth = 0
    for token in yaml.scan(text):
        match token:
            case yaml.AliasToken():
                raise InvalidInputError(str(path), "it has an alias (*name)", "Write the value itself")
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
            raise InvalidInputError(str(path), "it is nested too deep", cure)
