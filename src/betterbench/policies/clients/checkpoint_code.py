"""Security check that rejects LeRobot checkpoints which would run arbitrary code when they are loaded.

LeRobot creates its processor steps from ``policy_preprocessor.json`` and ``policy_postprocessor.json``. A step with a
``registry_name`` is part of LeRobot. A step with a ``class`` can name any function in any module, for example
``os.system``, and LeRobot calls this function with the arguments in the file (``_resolve_step_class`` in
``lerobot/processor/pipeline.py``). Some policy types also load a tokenizer with ``trust_remote_code`` from a repository
that the checkpoint names. Both are rejected unless the user adds ``trust=true`` to the policy address.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from betterbench.errors import InvalidInputError, one_line
from betterbench.json_form import parse_json, read_bounded

PROCESSORS = ("policy_preprocessor.json", "policy_postprocessor.json")

_MAX_BYTES = 64 * 1024 * 1024
_CURE = "Add ?trust=true to the policy address if you trust the author of the checkpoint"
_CODE_OF: Mapping[str, str] = {
    "action_tokenizer_name": "physical-intelligence/fast",
    "action_tokenizer_path": "physical-intelligence/fast",
    "text_tokenizer_name": "google/paligemma-3b-pt-224",
    "paligemma_tokenizer_name": "google/paligemma-3b-pt-224",
    "tokenizer_assets_repo": "lerobot/eagle2hg-processor-groot-n1p5",
}
"""Configuration fields that name a repository from which code is loaded, each with the only allowed value.

The allowed values are LeRobot's defaults.
"""


def require_no_code(config: object, files: Mapping[str, Path], where: str) -> None:
    """Raise an error if loading a checkpoint would run code that is not part of LeRobot.

    Args:
        config: Configuration of the policy, as read by LeRobot.
        files: Paths of the processor files, by name.
        where: Name of the checkpoint for error messages.

    Raises:
        InvalidInputError: If the checkpoint refers to code outside LeRobot, or if a processor file cannot be read.
    """
    for name in _CODE_OF:
        _require_known(name, getattr(config, name, None), f"its {name}", where)
    for name, path in files.items():
        for number, step in enumerate(_steps(path, name, where)):
            place = f"step {number} of {name}"
            if not isinstance(step.get("registry_name"), str):
                called = one_line(repr(step.get("class")), most=80)
                problem = f"{place} names the class {called}, which is not one of LeRobot's registered steps"
                raise InvalidInputError(
                    where, f"{problem}: loading it would run code chosen by the checkpoint's author", _CURE
                )
            for key, value in _entries(step):
                _require_known(key, value, f"{key} in {place}", where)


def _require_known(name: str, value: object, place: str, where: str) -> None:
    known = _CODE_OF.get(name)
    if known is not None and value is not None and value != known:
        shown = one_line(repr(value), most=80)
        raise InvalidInputError(
            where,
            f"{place} is {shown} instead of {known!r}, so loading the checkpoint would run code from that repository",
            _CURE,
        )


def _steps(path: Path, name: str, where: str) -> list[Mapping[str, Any]]:
    """Return the processor steps listed in a processor file."""
    cure = "Save the checkpoint again"
    text = read_bounded(path, max_bytes=_MAX_BYTES, cure=cure)
    try:
        form = parse_json(text, unique=True)
    except (ValueError, InvalidInputError) as error:
        raise InvalidInputError(where, f"{name} cannot be read ({one_line(error, most=200)})", cure) from error
    steps = form.get("steps") if isinstance(form, dict) else None
    if not isinstance(steps, list) or not all(isinstance(step, dict) for step in steps):
        raise InvalidInputError(where, f"{name} does not contain a list of steps", cure)
    return steps


def _entries(value: object) -> Iterator[tuple[str, object]]:
    """Yield all key-value pairs of the maps in a nested JSON value."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield key, inner
            yield from _entries(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _entries(inner)
