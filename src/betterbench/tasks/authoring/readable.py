"""Check that the names and texts of a task can be used in file names, on terminals and in documents."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass

from betterbench.errors import UNPRINTABLE, InvalidInputError, one_line
from betterbench.tasks.authoring.task import Task

LONGEST_TEXT = 2000
"""Maximum length of a text in a task, such as the instruction [characters]."""

_NAME = re.compile(r"[^\W_][\w .-]{0,99}")


def require_readable(task: Task) -> None:
    """Check the names of a task and of its objects, slots, steps and variations, and all texts of the task.

    Raises:
        InvalidInputError: If a name is empty, has more than 100 characters, or contains characters other than letters,
            digits, spaces, ``_``, ``-`` and ``.``. It is also raised if a text is too long or contains an unprintable
            character.
    """
    for at, text in _texts(task):
        if at is not None and at.is_name and not _NAME.fullmatch(text):
            cure = "Use up to 100 letters, digits, spaces, '_', '-' and '.', and begin with a letter or digit"
            raise InvalidInputError(_where(task, at), f"{_shown(text)} cannot be a name", cure)
        if UNPRINTABLE.search(text):
            raise InvalidInputError(
                _where(task, at), f"{_shown(text)} contains an unprintable character", "Remove this character"
            )
        if len(text) > LONGEST_TEXT:
            raise InvalidInputError(
                _where(task, at), f"has {len(text)} characters", f"Use at most {LONGEST_TEXT} characters"
            )


@dataclass(frozen=True, slots=True)
class _At:
    """Location of a text within a task.

    Attributes:
        before: Location of the value that contains this value.
        step: Field, index or key that leads from ``before`` to this location.
        is_key: Whether the step is a key of a mapping. If so, the text is in the value at this key.
    """

    before: _At | None
    step: object
    is_key: bool = False

    @property
    def is_name(self) -> bool:
        """Whether a text at this location is a name: the id of the task, or the name of one of its parts."""
        return not self.is_key and self.step == (".id" if self.before is None else ".name")


def _place(at: _At | None) -> str:
    """Return a location as a string ("training[0].objects[1].name")."""
    steps = []
    while at is not None:
        steps.append(f"[{one_line(repr(at.step), most=40)}]" if at.is_key else str(at.step))
        at = at.before
    return "".join(reversed(steps)).lstrip(".")


def _where(task: Task, at: _At | None) -> str:
    return f"task {one_line(task.id, most=100)}: {_place(at)}"


def _shown(text: str) -> str:
    return one_line(repr(text), most=60)


def _texts(task: Task) -> Iterator[tuple[_At | None, str]]:
    """Yield every string in a task, with the location where it first occurs.

    Each value is read only once. Since conditions share most of their objects, a task contains about 20,000 texts, but
    only 2,000 different ones.
    """
    left: list[tuple[_At | None, object]] = [(None, task)]
    seen: dict[int, object] = {}
    while left:
        at, value = left.pop()
        if isinstance(value, str):
            yield at, value
            continue
        if id(value) in seen:
            continue
        inner: list[tuple[_At | None, object]] = []
        if isinstance(value, Mapping):
            for key, content in value.items():
                inner += ((at, key), (_At(at, key, is_key=True), content))
        elif isinstance(value, tuple | list):
            inner = [(_At(at, f"[{i}]"), content) for i, content in enumerate(value)]
        elif is_dataclass(value):
            kind: type = type(value)
            inner = [(_At(at, f".{name}"), getattr(value, name)) for name in _fields_of(kind)]
        else:
            continue
        seen[id(value)] = value  # kept alive, so that no other object gets its id
        left += reversed(inner)


@functools.cache
def _fields_of(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind))
