"""JSON from files, checked field by field: one line that names the file, the field and the cure."""

from __future__ import annotations

from typing import Annotated, TypeVar

from pydantic import ConfigDict, PlainValidator, TypeAdapter, ValidationError

from betterbench.errors import RecordError, UnknownNameError
from betterbench.tasks.labels import Label

STRICT = ConfigDict(strict=True, allow_inf_nan=False)
"""A field has exactly its type; numbers are finite; further fields are left alone."""

Form = TypeVar("Form")


def read_form(adapter: TypeAdapter[Form], raw: bytes | str, *, where: str, cure: str) -> Form:
    """Return what a JSON document holds.

    Args:
        adapter: What it has to hold.
        raw: The document; it may come from anybody.
        where: Name of the file.
        cure: What to do about a problem, a sentence without a full stop.

    Raises:
        RecordError: If it is no JSON, or a field is missing or wrong.
    """
    try:
        return adapter.validate_json(raw)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        if first["type"] == "json_invalid":
            raise RecordError(f"{where}: is corrupt ({first['msg']}). {cure}.") from error
        path = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"]).lstrip(".")
        raise RecordError(f"{where}: {path or 'the document'}: {first['msg']}. {cure}.") from error


def _label(name: object) -> Label:
    try:
        return Label(str(name))
    except UnknownNameError as error:
        raise ValueError(str(error).rstrip(".")) from error


LabelField = Annotated[Label, PlainValidator(_label)]
"""A label by its name."""
