"""Run files, which are YAML files with options of ``better eval`` that can be stored with the results."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from betterbench.cli.yaml_file import read_yaml
from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.json_form import read_form, strict_form

_OPTION = "--run-file"
_MAX_DEPTH = 4
_CURE = "Correct the run file; docs/command-line.md shows an example"

Name = Annotated[str, Field(min_length=1, max_length=4096)]


@strict_form
@dataclass(frozen=True, slots=True)
class RunFile:
    """Content of a run file: options of ``better eval`` by name, with the values they can have on the command line."""

    policy: Name | None = None
    out: Name | None = None
    suite: Name | None = None
    tasks: tuple[Name, ...] = ()
    variations: tuple[Name, ...] = ()
    trials: int | None = None
    seed: int | None = None
    action_space: Name | None = None
    observation: Name | None = None
    quality: Name | None = None
    looks: Name | None = None
    until_decided: bool | None = None
    workers: int | None = None
    envs: int | None = None
    engine: Literal["local", "ray"] | None = None
    ray_address: Name | None = None
    replicas: int | None = None
    replica_gpus: float | None = None
    policy_timeout: float | None = None
    certificate: Name | None = None
    uncertified: bool | None = None
    explain_power: bool | None = None
    task_file: tuple[Name, ...] = ()
    asset_dir: tuple[Name, ...] = ()


_FORM = TypeAdapter(RunFile)


def with_run_file(words: Sequence[str]) -> list[str]:
    """Return command-line arguments with ``--run-file FILE`` replaced by the options in that file.

    An option on the command line takes precedence over the file.

    Raises:
        InvalidInputError: If the file is missing, is not YAML, or has a malformed field; if two files are named; or if
            the file runs code or sends a secret and ``--trust`` is not given.
        UnknownNameError: If the file has a field that is not an option.
    """
    path, rest = _named(words)
    if path is None:
        return rest
    run = read_run_file(path)
    given = {re.sub(r"^--(no-)?", "", word.partition("=")[0]).replace("-", "_") for word in rest if word[:2] == "--"}
    chosen = [(f.name, getattr(run, f.name)) for f in fields(run) if f.name not in given]
    if "trust" not in given:
        _refuse_dangers(path, dict(chosen))
    return [*(word for name, value in chosen for word in _words(path, name, value)), *rest]


def read_run_file(path: Path) -> RunFile:
    """Read a run file.

    Raises:
        InvalidInputError: If the file is missing, is not YAML, or has a malformed field.
        UnknownNameError: If the file has a field that is not an option.
    """
    form = read_yaml(path, cure=_CURE, deepest=_MAX_DEPTH)
    names = [str(key).replace("-", "_") for key in form]
    for i, name in enumerate(names):
        if name not in RunFile.__dataclass_fields__:
            raise UnknownNameError(f"option in {path}", name, RunFile.__dataclass_fields__)
        if name in names[:i]:
            raise InvalidInputError(f"{path}: {name}", "the option occurs twice", "Set each option only once")
    return read_form(_FORM, dict(zip(names, form.values(), strict=True)), where=str(path), cure=_CURE)


def _named(words: Sequence[str]) -> tuple[Path | None, list[str]]:
    """Return the run file given on the command line, and the other arguments."""
    found: list[str] = []
    rest: list[str] = []
    waiting = iter(words)
    for word in waiting:
        option, equals, value = word.partition("=")
        if option.replace("_", "-") != _OPTION:
            rest.append(word)
            continue
        value = value if equals else next(waiting, "")
        if not value:
            raise InvalidInputError(_OPTION, "no file is given", f"Pass a file, as in {_OPTION} FILE.yaml")
        found.append(value)
    if len(found) > 1:
        raise InvalidInputError(_OPTION, f"{len(found)} files are given", "Pass a single run file")
    return (Path(found[0]) if found else None), rest


def _words(path: Path, name: str, value: object) -> Iterator[str]:
    """Yield the command-line arguments of one option."""
    option = f"--{name.replace('_', '-')}"
    if value is None or value == ():
        return
    if isinstance(value, bool):
        yield option if value else option.replace("--", "--no-", 1)
        return
    values = [str(v) for v in value] if isinstance(value, tuple) else [str(value)]
    for text in values:
        if text.startswith("-") and isinstance(value, str | tuple):
            raise InvalidInputError(
                f"{path}: {name}", f"{text!r} begins with a dash", "If this is a path, write it as ./NAME"
            )
    if name in ("task_file", "asset_dir"):  # repeat these options for each path
        yield from (word for text in values for word in (option, text))
    else:
        yield from (option, *values)


def _refuse_dangers(path: Path, chosen: dict[str, object]) -> None:
    """Reject options in a run file that run code or send a secret.

    Raises:
        InvalidInputError: If the file has such an option.
    """
    from betterbench.evaluation.planning.trust import require_trust

    if chosen.get("policy"):
        require_trust(str(chosen["policy"]), where=str(path))
    files = chosen.get("task_file")
    if isinstance(files, tuple) and files:
        cure = "Inspect the file and add --trust, or pass this option on the command line"
        raise InvalidInputError(f"{path}: task_file", f"loading {files[0]} runs its Python code", cure)
