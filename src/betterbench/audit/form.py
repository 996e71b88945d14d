"""Reading a file of tables: each access checks what it takes and names the field that is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import Decimal

from betterbench.errors import InvalidInputError

MOST = 1_000_000
"""Largest count that a file may give: trials, choices, units."""


class Form:
    """An object of a JSON file whose fields are taken one by one.

    Args:
        where: What messages call it ("tables[2].rules[0]").
        fields: The object.

    Raises:
        InvalidInputError: If it is no object.
    """

    def __init__(self, where: str, fields: object) -> None:
        """Take in an object."""
        if not isinstance(fields, Mapping):
            raise InvalidInputError(where, "this is no JSON object", 'Write {"field": value, ...}')
        self.where = where
        self._fields: dict[str, object] = {str(name): value for name, value in fields.items()}
        self._left = set(self._fields)

    def has(self, name: str) -> bool:
        """Return whether a field is given."""
        return name in self._fields

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text."""
        value = self._take(name, default)
        if not isinstance(value, str) or not value:
            raise self.wrong(name, f"{value!r} is no text", "Write a text in quotes")
        return value

    def count(self, name: str, default: int | None = None) -> int:
        """Return a whole number of at least 1."""
        value = self._take(name, None if default is None else Decimal(default))
        if not isinstance(value, Decimal) or value.adjusted() > 6 or value != int(value) or not 1 <= value <= MOST:
            raise self.wrong(name, f"{value} is no whole number from 1 to {MOST}", "Write a number such as 20")
        return int(value)

    def flag(self, name: str) -> bool:
        """Return a yes or no; no if it is not given."""
        value = self._take(name, default=False)
        if not isinstance(value, bool):
            raise self.wrong(name, f"{value!r} is neither true nor false", "Write true or false")
        return value

    def names(self, name: str, known: Sequence[str], default: Sequence[str] | None = None) -> tuple[str, ...]:
        """Return a list of names that exist."""
        value = self._take(name, None if default is None else list(default))
        if not isinstance(value, list) or not value or not all(isinstance(v, str) for v in value):
            raise self.wrong(name, "this is no list of names", f"Write a list of {', '.join(known)}")
        for v in value:
            self._known(name, v, known)
        return tuple(value)

    def new_names(self, name: str) -> tuple[str, ...]:
        """Return a list of different names that are given here for the first time."""
        value = self._take(name, None)
        if not isinstance(value, list) or not value or not all(isinstance(v, str) and v for v in value):
            raise self.wrong(name, "this is no list of names", "Write a list of texts")
        if len(set(value)) < len(value):
            raise self.wrong(name, "a name is there twice", "Give each its own name")
        return tuple(value)

    def name(self, name: str, known: Sequence[str]) -> str:
        """Return a name that exists."""
        return self._known(name, self.text(name), known)

    def forms(self, name: str) -> tuple[Form, ...]:
        """Return a list of objects."""
        value = self._take(name, None)
        if not isinstance(value, list):
            raise self.wrong(name, "this is no list", "Write [...]")
        return tuple(Form(f"{self.where}.{name}[{i}]", v) for i, v in enumerate(value))

    def mapping(self, name: str) -> dict[str, object]:
        """Return an object as it stands."""
        value = self._take(name, None)
        if not isinstance(value, Mapping):
            raise self.wrong(name, "this is no JSON object", 'Write {"name": ...}')
        return dict(value)

    def done(self) -> None:
        """Refuse fields that nobody asked for: a misspelt one must not be ignored.

        Raises:
            InvalidInputError: If there is one.
        """
        if self._left:
            known = ", ".join(sorted(set(self._fields) - self._left))
            raise self.wrong(min(self._left), "this field is not known here", f"Known fields: {known}")

    def wrong(self, name: str, problem: str, cure: str) -> InvalidInputError:
        """Return the error about a field."""
        return InvalidInputError(f"{self.where}.{name}" if self.where else name, problem, cure)

    def _known(self, name: str, value: str, known: Sequence[str]) -> str:
        if value not in known:
            raise self.wrong(name, f"{value!r} does not exist", f"Use one of {', '.join(known)}")
        return value

    def _take(self, name: str, default: object) -> object:
        self._left.discard(name)
        value = self._fields.get(name, default)
        if value is None:
            raise self.wrong(name, "this field is missing", "Add it")
        return value
