"""Checks that the names and texts of a task are valid in file names, on terminals and in documents."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass

from betterbench.errors import UNPRINTABLE, InvalidInputError, one_line
from betterbench.tasks.authoring.task import Task

LONGEST_TEXT = 2000
"""Maximum number of characters in a task text, such as the instruction."""

_NAME = re.compile(r"[^\W_][\w .-]{0,99}")


def require_readable(task: Task) -> None:
    """Check a task's names, its objects, slots, steps and variations, and all texts.

    Raises:
        InvalidInputError: If a name is empty, longer than 100 characters or contains characters other than letters,
            digits, spaces, ``_``, ``-`` and ``.``, or a text is too long or contains an unprintable character.
    """
    for place, text in _texts(task, ""):
        where = f"task {one_line(task.id, most=100)}: {place}"
        shown = one_line(repr(text), most=60)
        if (place == "id" or place.endswith(".name")) and not _NAME.fullmatch(text):
            cure = "Use up to 100 letters, digits, spaces, '_', '-' and '.', the first a letter or digit"
            raise InvalidInputError(where, f"{shown} cannot be a name", cure)
        if UNPRINTABLE.search(text):
            raise InvalidInputError(where, f"{shown} contains an unprintable character", "Remove it")
        if len(text) > LONGEST_TEXT:
            raise InvalidInputError(where, f"has {len(text)} characters", f"Use at most {LONGEST_TEXT}")


def _texts(value: object, at: str) -> Iterator[tuple[str, str]]:
    """Yield every text in a value with its place ("training[0].objects[1].name")."""
    if isinstance(value, str):
        yield at, value
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _texts(key, at)
            yield from _texts(inner, f"{at}[{one_line(repr(key), most=40)}]")
    elif isinstance(value, tuple | list):
        for i, inner in enumerate(value):
            yield from _texts(inner, f"{at}[{i}]")
    elif is_dataclass(value):
        for field in fields(value):
            yield from _texts(getattr(value, field.name), f"{at}.{field.name}".lstrip("."))
