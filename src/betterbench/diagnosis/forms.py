"""Files that a diagnosis reads: checked field by field, with one line that names the file, the field and the cure."""

from __future__ import annotations

from typing import Annotated, TypeVar

from pydantic import ConfigDict, PlainValidator, TypeAdapter, with_config

from betterbench.errors import InvalidInputError, RecordError, UnknownNameError
from betterbench.json_form import read_form
from betterbench.tasks.labels import Label

file_form = with_config(ConfigDict(strict=True, allow_inf_nan=False))
"""Class decorator: fields have exactly their type and numbers are finite; keys of other versions are left alone."""

Form = TypeVar("Form")


def read_file_form(adapter: TypeAdapter[Form], raw: bytes, *, where: str, cure: str) -> Form:
    """Return what a JSON document holds; ``where`` names its file and ``cure`` says what to do about a wrong one.

    Raises:
        RecordError: If it is no JSON, or a field is missing or wrong.
    """
    try:
        return read_form(adapter, raw, where=where, cure=cure)
    except InvalidInputError as error:
        raise RecordError(str(error)) from error


def _label(name: object) -> Label:
    try:
        return Label(str(name))
    except UnknownNameError as error:
        raise ValueError(str(error).rstrip(".")) from error


LabelField = Annotated[Label, PlainValidator(_label)]
"""A label by its name."""
